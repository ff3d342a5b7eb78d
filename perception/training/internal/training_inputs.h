#pragma once

/// @file
/// The part of training that needs no torch: options, data, and the file that comes out.

#include <optional>
#include <string>
#include <vector>

#include "perception/checkpoint/weights_file.h"
#include "perception/data/dataset.h"
#include "perception/training/training.h"

namespace segsim::perception {

/// Everything that is read before the first step.
struct TrainingInputs {
  CocoDataset train;
  std::optional<CocoDataset> mix, validation;
  std::optional<DetectorWeights> initial;
  std::vector<std::string> class_names;
  double width = 0.5;
  int input_px = 256;
  std::vector<std::string> classes_without_boxes;
  std::string recipe;  ///< JSON; two runs of equal recipes make equal weights.
};

/// @throws core::InputError naming the option.
void check_train_options(const TrainOptions& options);

/// Reads weights and data sets, matches their classes, and resolves the options.
[[nodiscard]] TrainingInputs read_training_inputs(TrainOptions& options);

/// What Optimizer::kAuto sets beside the rate, whichever optimiser it chooses.
inline constexpr double kAutoMomentum = 0.9, kAutoWarmupBiasRate = 0.0;

/// Epochs to steps, and Optimizer::kAuto to what it means.
void resolve_train_options(TrainOptions& options, std::size_t images, std::size_t classes);

/// Fits the class branches to other classes: rows of known names in the last layer are kept,
/// others start as `fresh` has them, and so do tensors of a YOLOv13's class branch that have
/// another shape there.
void match_class_rows(DetectorWeights& weights, const std::vector<std::string>& class_names,
                      const std::vector<NamedTensor>& fresh, const std::string& place);

/// Chooses the score threshold on the weights as stored (in float16) and writes the file.
[[nodiscard]] OperatingPoint write_with_threshold(const std::filesystem::path& file,
                                                  DetectorWeights weights,
                                                  const CocoDataset& dataset);

}  // namespace segsim::perception
