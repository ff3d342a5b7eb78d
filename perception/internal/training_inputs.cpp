#include "perception/internal/training_inputs.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/evaluate.h"

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
  if (in.mix) {
    recipe["mix_sha256"] = in.mix->sha256;
    recipe["mix_share"] = o.mix_share;
  }
  if (in.validation) recipe["validation_sha256"] = in.validation->sha256;
  if (in.initial) recipe["initial_sha256"] = core::sha256_of_file(o.initial_weights);
  recipe["steps"] = o.steps;
  recipe["batch"] = o.batch;
  recipe["optimizer"] = "AdamW";
  recipe["learning_rate"] = o.learning_rate;
  recipe["weight_decay"] = o.weight_decay;
  recipe["warmup_steps"] = o.warmup_steps;
  recipe["ema_decay"] = o.ema_decay;
  recipe["augment"] = o.augment;
  recipe["seed"] = o.seed;
  recipe["threads"] = o.threads;
  return recipe.dump();
}

}  // namespace

void check_train_options(const TrainOptions& o) {
  require(o.width > 0.0 && o.width <= 4.0, "width", "(0, 4]", o.width);
  require(o.input_px >= 32 && o.input_px % 32 == 0, "input_px", "a multiple of 32",
          o.input_px);
  require(o.steps >= 1, "steps", "at least 1", o.steps);
  require(o.batch >= 1, "batch", "at least 1", o.batch);
  require(o.learning_rate > 0.0, "learning_rate", "above 0", o.learning_rate);
  require(o.weight_decay >= 0.0, "weight_decay", "at least 0", o.weight_decay);
  require(o.ema_decay >= 0.0 && o.ema_decay < 1.0, "ema_decay", "[0, 1)", o.ema_decay);
  require(o.mix_share >= 0.0 && o.mix_share < 1.0, "mix_share", "[0, 1)", o.mix_share);
  require(o.threads >= 1, "threads", "at least 1", o.threads);
  require(o.warmup_steps >= 0, "warmup_steps", "at least 0", o.warmup_steps);
  require(o.checkpoint_every >= 0, "checkpoint_every", "at least 0", o.checkpoint_every);
  if (o.output.empty())
    throw core::InputError("training: output: expected a file, found nothing");
}

TrainingInputs read_training_inputs(const TrainOptions& options) {
  TrainingInputs in;
  in.width = options.width;
  in.input_px = options.input_px;
  in.class_names = options.class_names;
  if (!options.initial_weights.empty()) {
    in.initial = read_weights(options.initial_weights);
    if (in.initial->architecture != DetectorWeights::kArchitecture) {
      throw core::InputError::expected(options.initial_weights.string() + ": architecture",
                                       std::string("one that training knows: ") +
                                           DetectorWeights::kArchitecture,
                                       in.initial->architecture);
    }
    in.width = in.initial->width;
    in.input_px = in.initial->input_px;
    if (in.class_names.empty()) in.class_names = in.initial->class_names;
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
  in.recipe = describe_recipe(options, in);
  return in;
}

void match_class_rows(DetectorWeights& weights, const std::vector<std::string>& class_names,
                      const std::vector<NamedTensor>& fresh, const std::string& place) {
  if (weights.class_names == class_names) return;
  const auto is_class_layer = [](const std::string& name) {
    return name.rfind("class", 0) == 0 && name.find(".last.") != std::string::npos;
  };
  for (NamedTensor& tensor : weights.tensors) {
    if (!is_class_layer(tensor.name) || tensor.shape.empty()) continue;
    const auto target =
        std::find_if(fresh.begin(), fresh.end(),
                     [&](const NamedTensor& other) { return other.name == tensor.name; });
    if (target == fresh.end()) continue;  // import_tensors() reports it.
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
    best = best_f1(results, static_cast<int>(weights.class_names.size()));
    weights.score_threshold = best.score_threshold;
    write_weights(temporary, weights);
  });
  return best;
}

}  // namespace segsim::perception
