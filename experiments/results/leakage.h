#pragma once

/// @file
/// Part of table.cpp: what the arms' detectors had seen of the scenes before they were
/// evaluated there. What a file does not say is "unknown", never "none".
/// Words are "scene": views of one of the scenes were trained on; else "unknown" if that
/// cannot be excluded; else "none", as for an arm without weights. Of several trainings, and
/// of several reconstructions of a scene, the worst counts.

#include <string>
#include <vector>

#include "experiments/results/table.h"

namespace segsim::experiments::results::internal {

/// Whether a training of the arm "after" is known to have learnt from a reconstruction of the
/// scene. @param scene  Its family.
[[nodiscard]] bool is_tuned_on(const ResultTable& table, const std::string& scene);

/// Of one training, in all scenes.
[[nodiscard]] std::string leakage_word(const ResultTable& table,
                                       const records::ArmRow& training);
/// Of one training, in one scene. @param scene  Its family.
[[nodiscard]] std::string leakage_word(const ResultTable& table,
                                       const records::ArmRow& training,
                                       const std::string& scene);
/// @param arm  A family, or one row of one. @param scene  Its family; empty: all scenes.
[[nodiscard]] std::string leakage_word(const ResultTable& table, const std::string& arm,
                                       const std::string& scene);
/// @param scenes  Families; the worst of them counts.
[[nodiscard]] std::string leakage_word(const ResultTable& table, const std::string& arm,
                                       const std::vector<std::string>& scenes);
/// Of the arm "after"; without a comparison the worst of all arms.
[[nodiscard]] std::string compared_leakage_word(const ResultTable& table,
                                                const std::string& scene);

/// One note per arm that was trained on a scene or may have been, one for all others, and one
/// for score thresholds that were chosen on other views of the scenes. Trainings of an arm of
/// which different things are to say have notes of their own.
void note_leakage(ResultTable& table);

}  // namespace segsim::experiments::results::internal
