#pragma once

/// @file
/// What an arm's detector is before trials begin: weights with the threshold that the one rule
/// of this project gives them, and how good they are on views that nothing was tuned on.

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "experiments/records/held_out_precision.h"
#include "perception/data/compute_device.h"

namespace segsim::experiments::detection {

/// Data sets (COCO JSON) of an experiment that nothing is trained on.
struct HeldOutSets {
  std::filesystem::path validation;      ///< The threshold is chosen on them.
  std::filesystem::path test;            ///< Other viewpoints of the training scenes.
  std::filesystem::path source, unseen;  ///< Empty: not measured.
  /// Classes of these sets that the weights do not know: their boxes are left out.
  std::vector<std::string> unknown_classes;
};

/// Writes `output`: the weights with the threshold that is chosen on the validation views
/// (`precision_target`: perception::most_recall(); 0: of best F1), and measures it on the
/// others. 'Before' and 'after' are treated alike, so that neither
/// profits from a better chosen threshold. Both detect on `device`. A measurement of the same
/// files is not repeated: it lies in `output`.precision.json.
/// @param on_measure  Called before that takes time.
/// @throws core::InputError if a file is missing or damaged.
records::HeldOutPrecision prepare_arm_weights(const std::filesystem::path& weights,
                                              const HeldOutSets& sets, double precision_target,
                                              perception::ComputeDevice device,
                                              const std::filesystem::path& output,
                                              const std::function<void()>& on_measure = {});

}  // namespace segsim::experiments::detection
