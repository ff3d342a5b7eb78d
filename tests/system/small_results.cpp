// Writes small results for the test of start-up times: small_results FILE
#include "small_results.h"

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  segsim::tests::write_small_results(argv[1]);
  return 0;
}
