// Drives by a script (experiments/scripted_trials/scripted_trial.h).
#include "experiments/scripted_trials/scripted_trial.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/targets/experiments/copied_budgets.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  copy_budgets();
  static const auto path = in_file(
      project_file("experiments/trials/paths/living-room.geojson"), "living-room.geojson");
  (void)experiments::scripted_trials::parse_scripted_trial(
      bytes, work_folder() / "trials/t.yaml", work_folder());
}

std::vector<std::string> seeds() {
  std::string drive = project_file("experiments/trials/drive.yaml");
  drive.replace(drive.find("paths/"), 6, "../");
  return {drive, project_file("experiments/trials/late.yaml")};
}

}  // namespace segsim::fuzz
