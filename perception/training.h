#pragma once

/// @file
/// Trains the detector, from scratch (source domain) or from weights (fine-tuning in a scene).
///
/// Recipe: AdamW, weight decay on convolution weights only; linear warm-up, then cosine decay
/// of the rate to 5 %; gradients clipped to norm 10; weights averaged over time (EMA), and the
/// average is what is saved; flip, shift, scale, gain and colour augmentation. Budgets are
/// steps, not seconds: every machine makes the same weights, up to floating-point sums of
/// another thread count.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "perception/average_precision.h"

namespace segsim::perception {

struct TrainOptions {
  std::filesystem::path train_json;  ///< COCO file (dataset.h).
  std::filesystem::path output;      ///< Weights file to write.

  /// Start from these weights; empty: from scratch. Rows of the class layer are matched by
  /// name.
  std::filesystem::path initial_weights;
  /// A second data set, of which `mix_share` of every batch is drawn: against forgetting.
  std::filesystem::path mix_json;
  double mix_share = 0.25;  ///< [0, 1); rounded to whole images of a batch.
  /// On which the score threshold is chosen; empty: on at most 200 images of the training set.
  std::filesystem::path validation_json;

  /// Classes of the detector. Empty: those of the initial weights, else of the training set.
  std::vector<std::string> class_names;
  std::map<std::string, std::string>
      rename;  ///< Data set's class -> detector's; "" leaves it out.

  double width =
      0.5;  ///< Channel multiplier, (0, 4]; that of initial weights takes precedence.
  int input_px = 256;  ///< Multiple of 32; that of initial weights takes precedence.
  int steps = 500;
  int batch = 8;
  double learning_rate = 2e-3;
  double weight_decay = 5e-4;
  int warmup_steps = 50;
  double ema_decay = 0.998;
  bool augment = true;
  std::uint64_t seed = 1;
  int threads = 2;

  /// Every so many steps the state is written to "<output>.state"; 0: never. If that file
  /// exists, training continues there, and the result equals that of an uninterrupted run bit
  /// for bit.
  int checkpoint_every = 100;
  /// Called after each step; false stops after writing the state, and no weights are written.
  std::function<bool(int steps_done, double loss)> on_step;
  bool show_progress = true;
};

struct TrainReport {
  bool finished = false;  ///< False if on_step stopped it.
  int first_step = 0;     ///< > 0 if it was resumed.
  int steps_done = 0;
  std::int64_t parameters = 0;
  std::vector<double> losses;  ///< Per image, of the steps run in this call.
  double mean_step_ms = 0.0;
  OperatingPoint operating;  ///< At the threshold stored in the file.
};

/// @throws core::InputError for wrong options, damaged files, classes that do not match, or a
///         state file of a run with other options.
TrainReport train(const TrainOptions& options);

}  // namespace segsim::perception
