#pragma once

/// @file
/// Trains a detector, from scratch (source domain) or from weights (fine-tuning in a scene):
/// the small network, a YOLOv13 or CenterNet, by one path.
///
/// Task-aligned assignment and loss (internal/loss/detection_loss.h), or targets on a heat map
/// (internal/centernet/loss.h); warm-up of rate and momentum,
/// then cosine or linear decay; clipped gradients; weights averaged over time (EMA), and the
/// average is what is evaluated and saved. training_defaults.yaml lists every option with its
/// default for each network and where it comes from. Budgets are steps, not seconds: every
/// machine makes the same weights, up to floating-point sums of another thread count.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "perception/data/compute_device.h"
#include "perception/evaluation/average_precision.h"

namespace segsim::perception {

enum class Optimizer {
  kAuto,  ///< As Ultralytics: SGD 0.01 above 10,000 steps, else AdamW 0.01 / (4 + classes).
  kAdamW,
  kSgd  ///< With Nesterov momentum.
};
enum class Schedule { kCosine, kLinear };
enum class NormPolicy {
  kTrain,
  kFrozen  ///< Batch norms keep the statistics they start with: for batches of one or two.
};
using TrainDevice = ComputeDevice;

/// What is done to a picture before each use. Shares and probabilities in [0, 1].
struct Augmentation {
  double mosaic = 0.0;  ///< Probability of a picture made of four.
  double flip = 0.5;    ///< Probability of left for right.
  double shift = 0.15;  ///< At most, of the side, both ways.
  double scale_min = 0.7, scale_max = 1.42;
  bool log_scale = true;  ///< Scales uniform in the logarithm, else uniform.
  bool tint = true;       ///< Gain 0.7 ... 1.4, tint 0.9 ... 1.1, saturation 0.6 ... 1.4.
  double hue = 0.0, saturation = 0.0, value = 0.0;  ///< Largest relative change in HSV.
  /// A box that keeps less than this of its area is ignored: neither object nor background.
  double min_kept_share = 0.2;
};

struct TrainOptions {
  std::filesystem::path train_json;  ///< COCO file (dataset.h).
  std::filesystem::path output;      ///< Weights file to write.

  /// Start from these weights; empty: from scratch. Rows of the class layer are matched by
  /// name; class branches of a YOLOv13 whose width depends on the number of classes start
  /// anew where their shapes differ.
  std::filesystem::path initial_weights;
  /// A second data set, of which `mix_share` of every batch is drawn: against forgetting.
  std::filesystem::path mix_json;
  double mix_share = 0.25;  ///< Of a batch; rounds to at least one image, but not to all.
  /// On which the score threshold is chosen; empty: on at most 200 images of the training set.
  std::filesystem::path validation_json;

  /// Classes of the detector. Empty: those of the initial weights, else of the training set.
  std::vector<std::string> class_names;
  std::map<std::string, std::string>
      rename;  ///< Data set's class -> detector's; "" leaves it out.

  /// Or yolov13n, s, l, x, centernet; initial weights take precedence.
  std::string model = "small";
  double width =
      0.5;  ///< Channel multiplier, (0, 4]; that of initial weights takes precedence.
  int input_px = 256;  ///< Multiple of 32; that of initial weights takes precedence.

  int steps = 500;
  /// Above 0: `steps`, `warmup_steps` and `closing_steps` are counted in passes through the
  /// training set instead.
  int epochs = 0;
  double warmup_epochs = 3.0, closing_epochs = 10.0;
  int batch = 8;  ///< Images of one forward pass.
  /// 0: every batch is a step. Above: round(nominal / batch) batches make a step, at least
  /// one, and the weight decay is that of a step of so many images.
  int nominal_batch = 0;

  Optimizer optimizer = Optimizer::kAdamW;
  double learning_rate = 2e-3;
  double class_rate = 1.0;  ///< Rate of the class layer's rows, as a multiple of the others'.
  double momentum = 0.9;    ///< Of SGD; first beta of AdamW.
  double weight_decay = 5e-4;
  Schedule schedule = Schedule::kCosine;
  double final_rate_share = 0.05;  ///< Of the rate, at the end.
  int warmup_steps = 50;
  double warmup_momentum = 0.9;   ///< At the start; linear to `momentum`.
  double warmup_bias_rate = 0.0;  ///< Of biases at the start; linear to the rate.
  double ema_decay = 0.998;
  double ema_ramp_steps =
      100.0;  ///< decay * (1 - e^(-step / this)): follows closely at first.
  double max_gradient_norm = 10.0;
  double box_gain = 7.5, class_gain = 0.5, bin_gain = 1.5;  ///< Of the losses.

  bool augment = true;
  Augmentation augmentation;
  int closing_steps = 0;  ///< Without mosaic, at the end.

  /// Layers that do not move, nor their batch norms: prefixes of parameter names as
  /// "model.0" or "stage2", or "backbone".
  std::vector<std::string> frozen;
  NormPolicy norm_policy = NormPolicy::kTrain;

  /// Every so many steps the average is evaluated on `validation_json`, and the best (0.1 AP50
  /// + 0.9 AP) is what is written; 0: never, the last is written. With `epochs` and a
  /// `patience`, 0 means every epoch.
  int validate_every = 0;
  int patience = 0;  ///< Evaluations without a better one after which it stops; 0: never.

  std::uint64_t seed = 1;
  /// CPU threads below the calling one. Several threads of a process may train at once, with
  /// equal counts; the result is that of one after another.
  int threads = 1;
  TrainDevice device = TrainDevice::kCpu;
  bool mixed_precision = false;  ///< float16 where it is safe; CUDA only.

  /// Every so many steps the state is written to "<output>.state"; 0: never. If that file
  /// exists, training continues there, and on the CPU the result equals that of an
  /// uninterrupted run bit for bit.
  int checkpoint_every = 100;
  /// Called after each step; false stops after writing the state, and no weights are written.
  std::function<bool(int steps_done, double loss)> on_step;
  bool show_progress = true;
};

struct TrainReport {
  bool finished = false;       ///< False if on_step stopped it.
  bool stopped_early = false;  ///< By `patience`.
  int first_step = 0;          ///< > 0 if it was resumed.
  int steps_done = 0;
  std::int64_t parameters = 0;
  std::vector<double> losses;  ///< Per image, of the steps run in this call.
  double mean_step_ms = 0.0;
  OperatingPoint operating;  ///< At the threshold stored in the file.
  /// Of the validation, [best step, 0.1 AP50 + 0.9 AP]; step 0 if there was none.
  int best_step = 0;
  double best_fitness = 0.0;
  std::vector<std::string> classes_without_boxes;  ///< Which nothing can be learnt about.
};

/// @throws core::InputError for wrong options, damaged files, classes that do not match, a
///         training set without any box, a state file of a run with other options, or a loss
///         that is no number: the last state file stays, and the average of the steps before
///         is written to "<output>.last_good".
TrainReport train(const TrainOptions& options);

}  // namespace segsim::perception
