// What a ResultTable says, as cells.
#include "experiments/results/table_grids.h"

#include "core/formatted.h"
#include "experiments/results/generalisation_grids.h"
#include "experiments/results/insight_grids.h"
#include "experiments/results/training_grids.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::results::internal {
namespace {

/// "+0.345 [+0.241, +0.452]"
std::string mean_text(const MeanInterval& mean, const char* format) {
  return core::print(format, mean.mean) + " [" + core::print(format, mean.interval.low) +
         ", " + core::print(format, mean.interval.high) + "]";
}

}  // namespace

std::string profile_name(const ResultTable& table) {
  return table.run.success_profile.substr(0, table.run.success_profile.find(':'));
}

std::string p_text(double p) {
  return p < 0.001 ? core::print("%.1e", p) : core::print("%.3f", p);
}

/// "12/20  60 % [39, 78]"
std::string rate_text(const ArmSummary* arm) {
  if (arm == nullptr || arm->success.trials == 0) return "-";
  const Interval interval = arm->interval();
  return std::to_string(arm->success.successes) + "/" + std::to_string(arm->success.trials) +
         "  " + core::print("%.0f", 100.0 * arm->success.value()) + " % [" +
         core::print("%.0f", 100.0 * interval.low) + ", " +
         core::print("%.0f", 100.0 * interval.high) + "]";
}

std::string difference_text(const GroupSummary& group) {
  if (group.pairs.total() == 0) return "-";
  const PairedDifference& d = group.difference;
  return core::print("%+.0f", 100.0 * d.difference) + " [" +
         core::print("%+.0f", 100.0 * d.interval.low) + ", " +
         core::print("%+.0f", 100.0 * d.interval.high) + "]";
}

std::string pairs_text(const GroupSummary& group) {
  return "+" + std::to_string(group.pairs.only_after) + " -" +
         std::to_string(group.pairs.only_before) + " of " +
         std::to_string(group.pairs.total());
}

support::internal::Grid comparison_grid(const ResultTable& table,
                                        const std::vector<GroupSummary>& groups,
                                        const std::string& first, bool corrected) {
  support::internal::Grid grid;
  grid.title = corrected
                   ? "By goal class (exploratory; p corrected by Holm for the number of rows)"
                   : headline_title(table);
  if (!corrected) grid.lines = headline_lines(table);
  grid.header = {first,      "SR-Before",
                 "SR-After", "Difference [points]",
                 "Pairs",    corrected ? "p (Holm)" : "p"};
  if (!corrected) grid.header.insert(grid.header.end(), {"Verdict"});
  if (!table.oracle.empty()) grid.header.emplace_back("SR-Oracle");
  if (table.before != "before") grid.header[1] = "SR " + table.before;
  if (table.after != "after") grid.header[2] = "SR " + table.after;
  for (const GroupSummary& group : groups) {
    std::vector<std::string> row{group.title + (group.leak ? " *" : ""),
                                 rate_text(group.find(table.before)),
                                 rate_text(group.find(table.after)),
                                 difference_text(group),
                                 pairs_text(group),
                                 p_text(corrected ? group.p_holm : group.p)};
    if (!corrected) row.push_back(group.verdict);
    if (!table.oracle.empty()) row.push_back(rate_text(group.find(table.oracle)));
    grid.rows.push_back(std::move(row));
  }
  return grid;
}

/// For runs without two arms to compare.
support::internal::Grid rates_grid(const ResultTable& table,
                                   const std::vector<GroupSummary>& groups,
                                   const std::string& first) {
  support::internal::Grid grid{table.run.title, {first}, {}};
  if (!groups.empty()) {
    for (const ArmSummary& arm : groups.front().arms) grid.header.push_back("SR " + arm.arm);
  }
  for (const GroupSummary& group : groups) {
    std::vector<std::string> row{group.title};
    for (const ArmSummary& arm : group.arms) row.push_back(rate_text(&arm));
    grid.rows.push_back(std::move(row));
  }
  return grid;
}

support::internal::Grid paired_grid(const ResultTable& table,
                                    const std::vector<GroupSummary>& groups) {
  const bool several = table.trainings.size() > 1;
  support::internal::Grid grid{
      std::string("After - before on the same episodes (") +
          (several ? "95 % interval and test over trainings and episodes)"
                   : "bootstrap 95 % interval, sign-flip test)"),
      {"Scene", "SPL", "p SPL", "Time [s]", "p time", "Path [m]", "p path",
       "SR over scenes [points]"},
      {}};
  for (const GroupSummary& group : groups) {
    if (group.pairs.total() == 0) continue;
    std::string over_scenes = "-";
    if (group.over_scenes && table.scenes.size() < kScenesForClaim) {
      over_scenes = "too few scenes";
    } else if (group.over_scenes) {
      MeanInterval points = *group.over_scenes;
      for (double* value : {&points.mean, &points.interval.low, &points.interval.high}) {
        *value *= 100.0;
      }
      over_scenes = mean_text(points, "%+.0f");
    }
    grid.rows.push_back({group.title, mean_text(group.spl.difference, "%+.3f"),
                         p_text(group.spl.p), mean_text(group.sim_s.difference, "%+.1f"),
                         p_text(group.sim_s.p), mean_text(group.path_m.difference, "%+.1f"),
                         p_text(group.path_m.p), over_scenes});
  }
  return grid;
}

support::internal::Grid arms_grid(const ResultTable& table,
                                  const std::vector<GroupSummary>& groups) {
  support::internal::Grid grid{"How the trials went (success: " + profile_name(table) + ")",
                               {"Scene", "Arm", "SR", "SPL", "SoftSPL", "Time [s]", "Path [m]",
                                "Contacts", "Holes [%]", "Outcomes"},
                               {}};
  for (const GroupSummary& group : groups) {
    for (const ArmSummary& arm : group.arms) {
      std::string outcomes;
      for (const auto& [outcome, count] : arm.outcomes) {
        outcomes += (outcomes.empty() ? "" : ", ") + outcome + " " + std::to_string(count);
      }
      grid.rows.push_back({group.title, arm.arm,
                           share_text(arm.success.successes, arm.success.trials),
                           core::print("%.3f", arm.spl), core::print("%.3f", arm.soft_spl),
                           core::print("%.1f", arm.sim_s), core::print("%.1f", arm.path_m),
                           core::print("%.2f", arm.contacts),
                           core::print("%.1f", 100.0 * arm.invalid_pixels), outcomes});
    }
  }
  return grid;
}

/// How good the arms' detectors are on held-out views; no rows if that was not measured.
support::internal::Grid detectors_grid(const ResultTable& table) {
  support::internal::Grid grid{"Detectors on held-out views of the scenes",
                               {"Arm", "AP50", "AP", "Precision", "Recall", "Score threshold",
                                "Views", "AP50 source rooms", "AP50 unseen homes"},
                               {}};
  const auto optional_text = [](const std::optional<double>& ap50) {
    return ap50 ? core::print("%.1f", 100.0 * *ap50) : std::string("-");
  };
  for (const records::ArmRow& arm : table.arm_rows) {
    if (!arm.held_out) continue;
    const records::HeldOutPrecision& p = *arm.held_out;
    grid.rows.push_back({arm.name, core::print("%.1f", 100.0 * p.ap50),
                         core::print("%.1f", 100.0 * p.ap), core::print("%.2f", p.precision),
                         core::print("%.2f", p.recall), core::print("%.3f", p.score_threshold),
                         std::to_string(p.views), optional_text(p.source_ap50),
                         optional_text(p.unseen_ap50)});
  }
  return grid;
}

std::vector<support::internal::Grid> grids_of(const ResultTable& table) {
  std::vector<GroupSummary> rows = table.scenes;
  rows.insert(rows.end(), table.pools.begin(), table.pools.end());
  if (table.all) rows.push_back(*table.all);
  std::vector<support::internal::Grid> grids;
  if (compares(table)) {
    grids.push_back(comparison_grid(table, rows, "Scene", false));
    if (!table.generalisation.empty()) {
      grids.push_back(generalisation_grid(table));
      grids.push_back(mixed_grid(table));
    }
    if (table.trainings.size() > 1) grids.push_back(trainings_grid(table));
    grids.push_back(comparison_grid(table, table.classes, "Goal", true));
  } else {
    grids.push_back(rates_grid(table, rows, "Scene"));
    grids.back().lines = headline_lines(table);
    grids.push_back(rates_grid(table, table.classes, "Goal"));
    grids.back().title = "By goal class";
  }
  grids.push_back(arms_grid(table, table.scenes));
  if (compares(table)) grids.push_back(paired_grid(table, rows));
  for (support::internal::Grid& grid : std::vector<support::internal::Grid>{
           causes_grid(table.scenes), perception_grid(table.scenes),
           profiles_grid(table.scenes), detectors_grid(table)}) {
    if (!grid.rows.empty()) grids.push_back(std::move(grid));
  }
  return grids;
}

}  // namespace segsim::experiments::results::internal
