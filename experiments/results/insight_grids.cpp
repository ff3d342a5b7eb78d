#include "experiments/results/insight_grids.h"

#include <algorithm>

#include "core/formatted.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::results::internal {

std::string share_text(int part, int whole) {
  return whole > 0 ? core::print("%.2f", static_cast<double>(part) / whole) : "-";
}

support::internal::Grid causes_grid(const std::vector<GroupSummary>& groups) {
  support::internal::Grid grid{"Why trials failed", {"Scene", "Arm", "Failed"}, {}};
  std::vector<std::string> causes;
  for (int k = 0; k < records::kCauses; ++k) {
    const std::string cause = records::to_string(static_cast<records::Cause>(k));
    const bool occurs = std::any_of(groups.begin(), groups.end(), [&](const auto& group) {
      return std::any_of(group.arms.begin(), group.arms.end(), [&](const ArmSummary& arm) {
        const auto& counts = arm.insights.causes;
        return std::any_of(counts.begin(), counts.end(),
                           [&](const auto& entry) { return entry.first == cause; });
      });
    });
    if (occurs) causes.push_back(cause);
  }
  grid.header.insert(grid.header.end(), causes.begin(), causes.end());
  for (const GroupSummary& group : groups) {
    for (const ArmSummary& arm : group.arms) {
      if (causes.empty() || arm.insights.trials == 0) continue;
      int failed = 0;
      for (const auto& [cause, count] : arm.insights.causes) failed += count;
      std::vector<std::string> row{
          group.title, arm.arm,
          std::to_string(failed) + "/" + std::to_string(arm.insights.trials)};
      for (const std::string& cause : causes) {
        std::string cell = "-";
        for (const auto& [name, count] : arm.insights.causes) {
          if (name == cause) cell = std::to_string(count);
        }
        row.push_back(cell);
      }
      grid.rows.push_back(std::move(row));
    }
  }
  return grid;
}

support::internal::Grid perception_grid(const std::vector<GroupSummary>& groups) {
  support::internal::Grid grid{
      "What the detector made of the goal",
      {"Scene", "Arm", "Recall in view", "Saw it", "Never detected", "Delay [ticks]",
       "False per 100 images", "False objects", "Misplaced objects"},
      {}};
  for (const GroupSummary& group : groups) {
    for (const ArmSummary& arm : group.arms) {
      const TrialInsights& in = arm.insights;
      if (in.trials == 0) continue;
      grid.rows.push_back(
          {group.title, arm.arm, in.recall() ? core::print("%.2f", *in.recall()) : "-",
           std::to_string(in.saw_goal) + "/" + std::to_string(in.trials),
           std::to_string(in.never_detected),
           in.delay_ticks ? core::print("%.1f", *in.delay_ticks) : "-",
           in.frames > 0 ? core::print("%.1f", 100.0 * in.false_detections / in.frames) : "-",
           core::print("%.2f", in.false_clouds),
           in.misplaced_clouds ? core::print("%.2f", *in.misplaced_clouds) : "-"});
    }
  }
  return grid;
}

support::internal::Grid profiles_grid(const std::vector<GroupSummary>& groups) {
  support::internal::Grid grid{
      "The same trials under named success rules (SR / SPL as that rule defines it)",
      {"Scene", "Arm"},
      {}};
  for (const sim::SuccessProfile& profile : sim::success_profiles()) {
    grid.header.push_back(profile.name);
  }
  for (const GroupSummary& group : groups) {
    for (const ArmSummary& arm : group.arms) {
      if (arm.insights.trials == 0) continue;
      std::vector<std::string> row{group.title, arm.arm};
      for (const ProfileRate& rate : arm.insights.profiles) {
        row.push_back(share_text(rate.successes, arm.insights.trials) + " / " +
                      core::print("%.2f", rate.spl));
      }
      grid.rows.push_back(std::move(row));
    }
  }
  return grid;
}

}  // namespace segsim::experiments::results::internal
