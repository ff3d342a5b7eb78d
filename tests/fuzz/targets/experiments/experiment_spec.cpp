// Specs of experiments (experiments/specs/spec.h).
#include "experiments/specs/spec.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/targets/experiments/copied_budgets.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  copy_budgets();
  experiments::specs::SpecFolders folders{work_folder(), work_folder() / "out"};
  (void)experiments::specs::parse_spec(bytes, work_folder() / "specs/spec.yaml", folders);
}

std::vector<std::string> seeds() {
  return {experiments::TinySpec{}.text(), project_file("experiments/specs/quirks.yaml"),
          project_file("experiments/specs/sensors.yaml"),
          project_file("experiments/specs/latency.yaml"),
          project_file("experiments/specs/policies.yaml")};
}

}  // namespace segsim::fuzz
