// Places of cameras as lines of text (worlds/capture/capture_plan.h).
#include "tests/fuzz/fuzz_target.h"
#include "worlds/capture/capture_plan.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) { (void)worlds::read_trajectory(in_file(bytes)); }

std::vector<std::string> seeds() {
  return {"# x y z yaw pitch\n1.5 1.5 1.2 0 0\n2.0 1.5 1.2 1.57 0.1\n",
          "1305031102.1 1 2 3 0 0 0 1\n\n1305031102.2 1 2 3 0 0.6 0 0.8\n"};
}

}  // namespace segsim::fuzz
