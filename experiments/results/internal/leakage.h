#pragma once

/// @file
/// Part of table.cpp: what the arms' detectors had seen of the scenes before they were
/// evaluated there. What a file does not say is "unknown", never "none".

#include <span>
#include <string>

#include "experiments/results/table.h"

namespace segsim::experiments::internal {

/// Whether views of the scene are known to have been trained on.
[[nodiscard]] bool is_tuned_on(const ArmRow& arm, const std::string& scene);

/// "scene": views of one of these scenes were trained on; else "unknown" if that cannot be
/// excluded; else "none", as for an arm without weights.
[[nodiscard]] std::string leakage_word(const ArmRow& arm, std::span<const SceneRow> scenes);

/// Of the arm "after"; without a comparison the worst of all arms.
[[nodiscard]] std::string leakage_word(const ResultTable& table,
                                       std::span<const SceneRow> scenes);

/// One note per arm that was trained on a scene or may have been, one for all others, and one
/// for score thresholds that were chosen on other views of the scenes.
void note_leakage(ResultTable& table);

}  // namespace segsim::experiments::internal
