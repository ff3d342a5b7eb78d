/// Benchmarks run with the memory settings of the program.

#include <benchmark/benchmark.h>

#include "core/process_memory.h"

int main(int argc, char** argv) {
  segsim::core::keep_freed_memory();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
}
