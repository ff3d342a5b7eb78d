#pragma once

/// @file
/// The table `arm`: an ArmRow whose optional parts lie flat. No arm has held-out views or
/// tuning views without their count; what else may be missing is -1.

#include <cstdint>
#include <optional>
#include <utility>

#include "experiments/records/column.h"
#include "experiments/records/run_rows.h"

namespace segsim::experiments::records {

struct ArmColumns {
  static constexpr double kNotMeasured = -1.0;
  static constexpr std::int64_t kNoSeed = -1;

  ArmRow arm;  ///< Without its optional parts.
  HeldOutPrecision held_out;
  double source_ap50 = kNotMeasured, unseen_ap50 = kNotMeasured;
  StartLeak leak;
  std::int64_t finetune_seed = kNoSeed;
};

template <AnyConst<ArmColumns> Row, class F>
void visit_columns(Row& row, F&& f) {
  f({.name = "name"}, row.arm.name);
  f({.name = "detector"}, row.arm.detector);
  f({.name = "weights_sha256"}, row.arm.weights_sha256);
  f({.name = "tuned_on"}, row.arm.tuned_on);
  f({.name = "score_threshold"}, row.arm.score_threshold);
  f({.name = "held_out_views"}, row.held_out.views);
  f({.name = "ap50"}, row.held_out.ap50);
  f({.name = "ap"}, row.held_out.ap);
  f({.name = "held_out_threshold"}, row.held_out.score_threshold);
  f({.name = "precision"}, row.held_out.precision);
  f({.name = "recall"}, row.held_out.recall);
  f({.name = "source_ap50"}, row.source_ap50);
  f({.name = "unseen_ap50"}, row.unseen_ap50);
  f({.name = "tuning_views"}, row.leak.views);
  f({.name = "tuning_views_near_starts"}, row.leak.near_starts);
  f({.name = "start_radius_m"}, row.leak.radius_m);
  f({.name = "family"}, row.arm.family);
  f({.name = "reconstruction"}, row.arm.reconstruction);
  f({.name = "finetune_seed"}, row.finetune_seed);
}

[[nodiscard]] inline ArmColumns columns_of(const ArmRow& arm) {
  ArmColumns row;
  row.arm = arm;
  row.arm.family = family_of(arm);
  row.held_out = arm.held_out.value_or(HeldOutPrecision{});
  row.source_ap50 = row.held_out.source_ap50.value_or(ArmColumns::kNotMeasured);
  row.unseen_ap50 = row.held_out.unseen_ap50.value_or(ArmColumns::kNotMeasured);
  row.leak = arm.start_leak.value_or(StartLeak{});
  if (arm.finetune_seed) row.finetune_seed = static_cast<std::int64_t>(*arm.finetune_seed);
  return row;
}

/// The exposure is read from the run's provenance.
[[nodiscard]] inline ArmRow arm_of(ArmColumns row) {
  const auto measured = [](double value) {
    return value > ArmColumns::kNotMeasured ? std::optional(value) : std::nullopt;
  };
  row.held_out.source_ap50 = measured(row.source_ap50);
  row.held_out.unseen_ap50 = measured(row.unseen_ap50);
  if (row.held_out.views > 0) row.arm.held_out = row.held_out;
  if (row.leak.views > 0) row.arm.start_leak = row.leak;
  if (row.finetune_seed != ArmColumns::kNoSeed) {
    row.arm.finetune_seed = static_cast<std::uint64_t>(row.finetune_seed);
  }
  return std::move(row.arm);
}

}  // namespace segsim::experiments::records
