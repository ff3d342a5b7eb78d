#pragma once

/// @file
/// What an arm's detector is before trials begin: weights with the threshold that the one rule
/// of this project gives them, and how good they are on views that nothing was tuned on.

#include <filesystem>
#include <functional>
#include <optional>

namespace segsim::experiments {

/// Detection on the held-out views of an experiment's scenes.
struct HeldOutPrecision {
  int views = 0;
  double ap50 = 0.0,
         ap = 0.0;  ///< COCO, [0, 1]; see perception/evaluation/average_precision.h.
  double score_threshold = 0.0;
  double precision = 0.0, recall = 0.0;  ///< At that threshold, IoU 0.5, all classes together.
  /// What tuning costs elsewhere: AP50 in rooms of the source domain and in homes that no step
  /// has seen; none if that was not measured.
  std::optional<double> source_ap50{}, unseen_ap50{};
};

/// How many of the views that a detector was tuned on lie near the start of an evaluation
/// episode.
struct StartLeak {
  int views = 0, near_starts = 0;
  double radius_m = 0.0;
};

/// Data sets (COCO JSON) of an experiment that nothing is trained on.
struct HeldOutSets {
  std::filesystem::path validation;      ///< The threshold is chosen on them.
  std::filesystem::path test;            ///< Other viewpoints of the training scenes.
  std::filesystem::path source, unseen;  ///< Empty: not measured.
};

/// Writes `output`: the weights with the threshold that is chosen on the validation views
/// (`precision_target`: perception::most_recall(); 0: of best F1), and measures it on the
/// others. 'Before' and 'after' are treated alike, so that neither
/// profits from a better chosen threshold. A measurement of the same files is not repeated: it
/// lies in `output`.precision.json.
/// @param on_measure  Called before that takes time.
/// @throws core::InputError if a file is missing or damaged.
HeldOutPrecision prepare_arm_weights(const std::filesystem::path& weights,
                                     const HeldOutSets& sets, double precision_target,
                                     const std::filesystem::path& output,
                                     const std::function<void()>& on_measure = {});

}  // namespace segsim::experiments
