// Latency budgets and traces (experiments/specs/budget_file.h). Input that begins with "!"
// is a trace.
#include "experiments/specs/budget_file.h"

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  if (bytes.starts_with('!')) {
    (void)experiments::specs::read_trace_csv(in_file(bytes.substr(1), "trace.csv"));
  } else {
    (void)experiments::specs::parse_budget(bytes, work_folder() / "budget.yaml");
  }
}

std::vector<std::string> seeds() {
  return {project_file("experiments/budgets/example-edge.yaml"),
          project_file("experiments/budgets/worked-timeline.yaml"),
          "!stage,index,duration_ns\ndetect,0,30000000\ndetect,1,31000000\n"};
}

}  // namespace segsim::fuzz
