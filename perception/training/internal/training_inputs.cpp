#include "perception/training/internal/training_inputs.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/lineage.h"
#include "perception/detector/evaluate.h"
#include "perception/training/internal/batch_source.h"
#include "perception/training/internal/class_layer.h"
#include "perception/training/internal/training_schedule.h"
#include "perception/training/training_config.h"

namespace segsim::perception {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxThresholdImages = 200;

void require(bool holds, const std::string& key, const std::string& expected, double found) {
  if (!holds) {
    throw core::InputError::expected("training: " + key, expected, std::to_string(found));
  }
}

CocoDataset read_matched(const std::filesystem::path& file, const TrainOptions& options,
                         const std::vector<std::string>& class_names) {
  CocoDataset dataset = read_coco(file);
  match_classes(dataset, class_names, options.rename);
  if (dataset.images.empty()) {
    throw core::InputError::expected(file.string() + ": images", "at least one", "none");
  }
  return dataset;
}

std::string describe_recipe(const TrainOptions& o, const TrainingInputs& in) {
  Json recipe = {{"train_sha256", in.train.sha256}};
  if (in.mix) recipe["mix_sha256"] = in.mix->sha256;
  if (in.validation) recipe["validation_sha256"] = in.validation->sha256;
  if (in.initial) recipe["initial_sha256"] = core::sha256_of_file(o.initial_weights);
  recipe["model"] = o.model;
  recipe["class_names"] = in.class_names;
  recipe["rename"] = o.rename;
  recipe["seed"] = o.seed;
  recipe["threads"] = o.threads;
  recipe["device"] = o.device == TrainDevice::kCuda ? "cuda" : "cpu";
  recipe["mixed_precision"] = o.mixed_precision;
  recipe.update(Json::parse(describe_train_options(o)));
  return recipe.dump();
}

/// What the weights will depend on, oldest first.
std::vector<DataUse> all_data(const TrainOptions& o, const TrainingInputs& in) {
  std::vector<DataUse> data;
  if (in.initial) data = data_of(*in.initial, o.initial_weights);
  data.push_back(data_use(DataPurpose::kTrain, in.train));
  if (in.mix) data.push_back(data_use(DataPurpose::kMix, *in.mix));
  if (in.validation) data.push_back(data_use(DataPurpose::kValidation, *in.validation));
  return data;
}

/// The rule of Ultralytics' trainer.
void choose_optimizer(TrainOptions& o, std::size_t class_count) {
  constexpr int kManySteps = 10'000;
  if (o.optimizer != Optimizer::kAuto) return;
  const bool sgd = o.steps > kManySteps;
  const double fitted = 0.002 * 5.0 / (4.0 + static_cast<double>(class_count));
  o.optimizer = sgd ? Optimizer::kSgd : Optimizer::kAdamW;
  o.learning_rate = sgd ? 0.01 : std::round(fitted * 1e6) / 1e6;
  o.momentum = kAutoMomentum;
  o.warmup_bias_rate = kAutoWarmupBiasRate;
}

bool same_row_shape(const NamedTensor& a, const NamedTensor& b) {
  return a.shape.size() == b.shape.size() &&
         std::equal(a.shape.begin() + 1, a.shape.end(), b.shape.begin() + 1);
}

std::vector<std::string> classes_without_boxes(const CocoDataset& dataset,
                                               const std::vector<std::string>& class_names) {
  std::vector<int> counts(class_names.size(), 0);
  for (const LabeledImage& image : dataset.images) {
    for (const LabeledBox& box : image.boxes) {
      if (!box.not_scored()) ++counts[static_cast<std::size_t>(box.class_index)];
    }
  }
  std::vector<std::string> missing;
  for (std::size_t c = 0; c < counts.size(); ++c) {
    if (counts[c] == 0) missing.push_back(class_names[c]);
  }
  return missing;
}

}  // namespace

void check_train_options(const TrainOptions& o) {
  (void)architecture_of_model(o.model);
  require(o.width > 0.0 && o.width <= 4.0, "width", "(0, 4]", o.width);
  require(o.input_px >= 32 && o.input_px % 32 == 0, "input_px", "a multiple of 32",
          o.input_px);
  require(o.steps >= 1, "steps", "at least 1", o.steps);
  require(o.batch >= 1, "batch", "at least 1", o.batch);
  require(o.learning_rate > 0.0, "learning_rate", "above 0", o.learning_rate);
  require(o.class_rate > 0.0, "class_rate", "above 0", o.class_rate);
  require(o.weight_decay >= 0.0, "weight_decay", "at least 0", o.weight_decay);
  require(o.ema_decay >= 0.0 && o.ema_decay < 1.0, "ema_decay", "[0, 1)", o.ema_decay);
  require(o.mix_share >= 0.0 && o.mix_share < 1.0, "mix_share", "[0, 1)", o.mix_share);
  require(o.momentum >= 0.0 && o.momentum < 1.0, "momentum", "[0, 1)", o.momentum);
  require(o.epochs >= 0, "epochs", "at least 0", o.epochs);
  require(o.nominal_batch >= 0, "nominal_batch", "at least 0", o.nominal_batch);
  require(o.patience >= 0, "patience", "at least 0", o.patience);
  require(o.validate_every >= 0, "validate_every", "at least 0", o.validate_every);
  require(o.closing_steps >= 0, "closing_steps", "at least 0", o.closing_steps);
  require(o.ema_ramp_steps > 0.0, "ema_ramp_steps", "above 0", o.ema_ramp_steps);
  require(o.max_gradient_norm > 0.0, "max_gradient_norm", "above 0", o.max_gradient_norm);
  const Augmentation& a = o.augmentation;
  require(a.scale_min > 0.0 && a.scale_min <= a.scale_max, "scale_min",
          "above 0 and at most scale_max", a.scale_min);
  if (o.mixed_precision && o.device == TrainDevice::kCpu) {
    throw core::InputError::expected("training: mixed_precision", "device cuda", "cpu");
  }
  if (o.batch == 1 && o.input_px == 32 && o.norm_policy == NormPolicy::kTrain) {
    throw core::InputError::expected("training: batch",
                                     "at least 2 at 32 px (or norm_policy: frozen)", "1");
  }
  if (o.validate_every > 0 && o.validation_json.empty()) {
    throw core::InputError::expected("training: validate_every", "a validation set", "none");
  }
  if (!o.mix_json.empty()) (void)mixed_images(o.mix_share, o.batch);
  require(o.threads >= 1, "threads", "at least 1", o.threads);
  require(o.warmup_steps >= 0, "warmup_steps", "at least 0", o.warmup_steps);
  require(o.checkpoint_every >= 0, "checkpoint_every", "at least 0", o.checkpoint_every);
  if (o.output.empty())
    throw core::InputError("training: output: expected a file, found nothing");
}

TrainingInputs read_training_inputs(TrainOptions& options) {
  TrainingInputs in;
  in.width = options.width;
  in.input_px = options.input_px;
  in.class_names = options.class_names;
  if (!options.initial_weights.empty()) {
    in.initial = read_weights(options.initial_weights);
    options.model =
        model_of_architecture(in.initial->architecture, options.initial_weights.string());
    in.width = in.initial->width;
    in.input_px = in.initial->input_px;
    if (in.class_names.empty()) in.class_names = in.initial->class_names;
  } else if (options.model != "small") {
    in.width = default_train_options(options.model).width;
  }
  if (in.class_names.empty()) in.class_names = read_coco(options.train_json).class_names;
  if (in.class_names.empty()) {
    throw core::InputError::expected(options.train_json.string() + ": categories",
                                     "at least one", "none");
  }
  in.train = read_matched(options.train_json, options, in.class_names);
  if (!options.mix_json.empty())
    in.mix = read_matched(options.mix_json, options, in.class_names);
  if (!options.validation_json.empty()) {
    in.validation = read_matched(options.validation_json, options, in.class_names);
  }
  in.classes_without_boxes = classes_without_boxes(in.train, in.class_names);
  if (in.classes_without_boxes.size() == in.class_names.size()) {
    throw core::InputError::expected(options.train_json.string() + ": annotations",
                                     "at least one box that is not ignored", "none");
  }
  options.width = in.width;
  options.input_px = in.input_px;
  resolve_train_options(options, in.train.images.size(), in.class_names.size());
  in.recipe = with_data(describe_recipe(options, in), all_data(options, in));
  return in;
}

void resolve_train_options(TrainOptions& o, std::size_t images, std::size_t classes) {
  constexpr double kLeastWarmup = 100.0;  // Steps, of a warm-up counted in epochs.
  if (o.epochs > 0) {
    // An epoch is as many main images as there are, whatever is mixed in.
    const int mixed = o.mix_json.empty() ? 0 : mixed_images(o.mix_share, o.batch);
    const double per_step = static_cast<double>(o.batch - mixed) * batches_per_step(o);
    const double epoch_steps =
        std::max(1.0, std::ceil(static_cast<double>(images) / per_step));
    const double wanted = epoch_steps * o.epochs;
    require(wanted <= 2e9, "epochs", "at most 2e9 steps", wanted);
    o.steps = static_cast<int>(wanted);
    o.warmup_steps = o.warmup_epochs > 0.0
                         ? static_cast<int>(std::min(
                               wanted, std::max(kLeastWarmup, o.warmup_epochs * epoch_steps)))
                         : 0;
    o.closing_steps = static_cast<int>(std::min(wanted, o.closing_epochs * epoch_steps));
    if (o.validate_every == 0 && o.patience > 0 && !o.validation_json.empty()) {
      o.validate_every = static_cast<int>(epoch_steps);
    }
  }
  o.closing_steps = std::min(o.closing_steps, o.steps);
  choose_optimizer(o, classes);
}

void match_class_rows(DetectorWeights& weights, const std::vector<std::string>& class_names,
                      const std::vector<NamedTensor>& fresh, const std::string& place) {
  if (weights.class_names == class_names) return;
  for (NamedTensor& tensor : weights.tensors) {
    if (!is_class_branch(tensor.name) || tensor.shape.empty()) continue;
    const auto target =
        std::find_if(fresh.begin(), fresh.end(),
                     [&](const NamedTensor& other) { return other.name == tensor.name; });
    if (target == fresh.end()) continue;  // import_tensors() reports it.
    if (!is_class_layer(tensor.name) || !same_row_shape(tensor, *target)) {
      // The width of a YOLOv13's class branch depends on the number of classes.
      if (is_yolo_branch(tensor.name) && tensor.shape != target->shape) tensor = *target;
      continue;
    }
    NamedTensor matched = *target;
    const std::size_t row = matched.values.size() / class_names.size();
    if (tensor.values.size() != row * weights.class_names.size()) {
      throw core::InputError::expected(place + ": " + tensor.name, "one row per class",
                                       std::to_string(tensor.values.size()) + " values");
    }
    for (std::size_t c = 0; c < class_names.size(); ++c) {
      const auto old =
          std::find(weights.class_names.begin(), weights.class_names.end(), class_names[c]);
      if (old == weights.class_names.end()) continue;
      const auto from = static_cast<std::ptrdiff_t>(row) * (old - weights.class_names.begin());
      std::copy_n(tensor.values.begin() + from, row,
                  matched.values.begin() + static_cast<std::ptrdiff_t>(row * c));
    }
    tensor = std::move(matched);
  }
}

OperatingPoint write_with_threshold(const std::filesystem::path& file, DetectorWeights weights,
                                    const CocoDataset& dataset) {
  CocoDataset sample = dataset;
  if (sample.images.size() > kMaxThresholdImages) {
    // Evenly spread, since neighbours in a capture resemble one another.
    std::vector<LabeledImage> spread;
    for (std::size_t i = 0; i < kMaxThresholdImages; ++i) {
      spread.push_back(sample.images[i * sample.images.size() / kMaxThresholdImages]);
    }
    sample.images = std::move(spread);
  }
  OperatingPoint best;
  core::write_via_temporary(file, [&](const std::filesystem::path& temporary) {
    write_weights(temporary, weights);
    const auto results = detect_all(temporary, sample);
    best = best_f1(operating_points(results, static_cast<int>(weights.class_names.size())));
    weights.score_threshold = best.score_threshold;
    write_weights(temporary, weights);
  });
  return best;
}

}  // namespace segsim::perception
