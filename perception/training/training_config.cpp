#include "perception/training/training_config.h"

#include <algorithm>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/config.h"
#include "core/error.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/checkpoint/yolov13_scale.h"
#include "perception/training/internal/training_inputs.h"

namespace segsim::perception {
namespace {

using core::ConfigNode;
using Json = nlohmann::ordered_json;

constexpr std::int64_t kMany = 1'000'000'000;
constexpr double kHuge = 1e9;
constexpr const char* kSmall = "small";
constexpr const char* kYolo = "yolov13";
constexpr const char* kCenterNet = "centernet";

/// Every key, in the order of training_defaults.yaml, with its range.
template <class Visitor>
void visit_fields(Visitor& visitor, TrainOptions& o) {
  visitor.integer("steps", o.steps, 1, kMany);
  visitor.integer("epochs", o.epochs, 0, kMany);
  visitor.integer("batch", o.batch, 1, 65536);
  visitor.integer("nominal_batch", o.nominal_batch, 0, 65536);
  visitor.integer("input_px", o.input_px, 32, 4096);
  visitor.number("width", o.width, 0.0, 4.0);
  visitor.choice("optimizer", o.optimizer, {"auto", "adamw", "sgd"});
  visitor.number("learning_rate", o.learning_rate, 0.0, kHuge);
  visitor.number("class_rate", o.class_rate, 0.0, kHuge);
  visitor.number("momentum", o.momentum, 0.0, 1.0);
  visitor.number("weight_decay", o.weight_decay, 0.0, kHuge);
  visitor.choice("schedule", o.schedule, {"cosine", "linear"});
  visitor.number("final_rate_share", o.final_rate_share, 0.0, 1.0);
  visitor.integer("warmup_steps", o.warmup_steps, 0, kMany);
  visitor.number("warmup_epochs", o.warmup_epochs, 0.0, kHuge);
  visitor.number("warmup_momentum", o.warmup_momentum, 0.0, 1.0);
  visitor.number("warmup_bias_rate", o.warmup_bias_rate, 0.0, kHuge);
  visitor.number("ema_decay", o.ema_decay, 0.0, 1.0);
  visitor.number("ema_ramp_steps", o.ema_ramp_steps, 1e-9, kHuge);
  visitor.number("max_gradient_norm", o.max_gradient_norm, 1e-9, kHuge);
  visitor.number("box_gain", o.box_gain, 0.0, kHuge);
  visitor.number("class_gain", o.class_gain, 0.0, kHuge);
  visitor.number("bin_gain", o.bin_gain, 0.0, kHuge);
  visitor.flag("augment", o.augment);
  visitor.number("mosaic", o.augmentation.mosaic, 0.0, 1.0);
  visitor.integer("closing_steps", o.closing_steps, 0, kMany);
  visitor.number("closing_epochs", o.closing_epochs, 0.0, kHuge);
  visitor.number("flip", o.augmentation.flip, 0.0, 1.0);
  visitor.number("shift", o.augmentation.shift, 0.0, 1.0);
  visitor.number("scale_min", o.augmentation.scale_min, 0.01, 100.0);
  visitor.number("scale_max", o.augmentation.scale_max, 0.01, 100.0);
  visitor.flag("log_scale", o.augmentation.log_scale);
  visitor.flag("tint", o.augmentation.tint);
  visitor.number("hue", o.augmentation.hue, 0.0, 1.0);
  visitor.number("saturation", o.augmentation.saturation, 0.0, 1.0);
  visitor.number("value", o.augmentation.value, 0.0, 1.0);
  visitor.number("min_kept_share", o.augmentation.min_kept_share, 0.0, 1.0);
  visitor.number("mix_share", o.mix_share, 0.0, 1.0);
  visitor.texts("freeze", o.frozen);
  visitor.choice("norm_policy", o.norm_policy, {"train", "frozen"});
  visitor.integer("validate_every", o.validate_every, 0, kMany);
  visitor.integer("patience", o.patience, 0, kMany);
  visitor.integer("checkpoint_every", o.checkpoint_every, 0, kMany);
}

class Reader {
 public:
  explicit Reader(const ConfigNode& node) : node_(node) {}

  template <class Number>
  void number(const char* key, Number& value, double lo, double hi) {
    if (!node_.has(key)) return;
    value = node_.number(key);
    check(key, value, lo, hi);
  }
  template <class Integer>
  void integer(const char* key, Integer& value, std::int64_t lo, std::int64_t hi) {
    if (!node_.has(key)) return;
    const std::int64_t read = node_.integer(key);
    check(key, static_cast<double>(read), static_cast<double>(lo), static_cast<double>(hi));
    value = static_cast<Integer>(read);
  }
  void flag(const char* key, bool& value) {
    if (node_.has(key)) value = node_.boolean_or(key, value);
  }
  void texts(const char* key, std::vector<std::string>& value) {
    if (node_.has(key)) value = node_.texts(key);
  }
  template <class Choice>
  void choice(const char* key, Choice& value, std::initializer_list<const char*> words) {
    if (!node_.has(key)) return;
    const std::string word = node_.text(key);
    const auto found = std::find(words.begin(), words.end(), word);
    if (found == words.end()) {
      std::string known;
      for (const char* w : words) known += (known.empty() ? "" : " | ") + std::string(w);
      node_.child(key).fail(known, word);
    }
    value = static_cast<Choice>(found - words.begin());
  }

 private:
  void check(const char* key, double value, double lo, double hi) const {
    if (value >= lo && value <= hi) return;
    node_.child(key).fail("a number in [" + Json(lo).dump() + ", " + Json(hi).dump() + "]",
                          Json(value).dump());
  }
  const ConfigNode& node_;
};

class Writer {
 public:
  template <class Number>
  void number(const char* key, const Number& value, double, double) {
    json[key] = value;
  }
  template <class Integer>
  void integer(const char* key, const Integer& value, std::int64_t, std::int64_t) {
    json[key] = value;
  }
  void flag(const char* key, const bool& value) { json[key] = value; }
  void texts(const char* key, const std::vector<std::string>& value) { json[key] = value; }
  template <class Choice>
  void choice(const char* key, const Choice& value, std::initializer_list<const char*> words) {
    json[key] = *(words.begin() + static_cast<std::ptrdiff_t>(value));
  }
  Json json = Json::object();
};

/// For fine-tuning: what the published weights know of the world shall last.
TrainOptions centernet_defaults() {
  TrainOptions o;
  o.model = kCenterNet;
  o.width = 1.0;
  o.input_px = 320;
  o.steps = 600;
  o.batch = 4;
  o.learning_rate = 1e-4;
  o.class_rate = 10.0;
  o.max_gradient_norm = 40.0;
  o.box_gain = 5.0;
  o.class_gain = 1.0;
  o.bin_gain = 0.0;
  return o;
}

}  // namespace

const std::vector<std::string>& train_models() {
  static const std::vector<std::string> models = [] {
    std::vector<std::string> names{kSmall};
    for (const auto scale : yolov13::kAllScales) {
      names.push_back(kYolo + std::string(1, yolov13::table_of(scale).letter));
    }
    names.emplace_back(kCenterNet);
    return names;
  }();
  return models;
}

std::string architecture_of_model(const std::string& model) {
  if (model == kSmall) return DetectorWeights::kArchitecture;
  if (model == kCenterNet) return DetectorWeights::kCenterNet;
  for (const auto scale : yolov13::kAllScales) {
    if (model == kYolo + std::string(1, yolov13::table_of(scale).letter)) {
      return yolov13::architecture_of(scale);
    }
  }
  std::string known;
  for (const auto& name : train_models()) known += (known.empty() ? "" : ", ") + name;
  throw core::InputError::expected("training: model", "one of " + known, model);
}

std::string model_of_architecture(const std::string& architecture, const std::string& place) {
  for (const auto& model : train_models()) {
    if (architecture_of_model(model) == architecture) return model;
  }
  throw core::InputError::expected(place + ": architecture", "one that training knows",
                                   architecture);
}

TrainOptions default_train_options(const std::string& model) {
  const std::string architecture = architecture_of_model(model);
  TrainOptions o;
  o.model = model;
  if (model == kSmall) return o;
  if (model == kCenterNet) return centernet_defaults();
  const auto scale = yolov13::scale_of_architecture(architecture, "training: model");
  o.width = yolov13::table_of(scale).width;
  o.input_px = 640;
  o.epochs = 600;
  o.batch = 16;
  o.nominal_batch = 64;
  o.optimizer = Optimizer::kAuto;
  o.learning_rate = 0.01;
  o.momentum = 0.937;
  o.schedule = Schedule::kLinear;
  o.final_rate_share = 0.01;
  o.warmup_momentum = 0.8;
  o.warmup_bias_rate = 0.1;
  o.ema_decay = 0.9999;
  o.ema_ramp_steps = 2000.0;
  o.patience = 100;
  o.augmentation.mosaic = 1.0;
  o.augmentation.shift = 0.1;
  const double range = scale == yolov13::Scale::kN ? 0.5 : 0.9;
  o.augmentation.scale_min = 1.0 - range;
  o.augmentation.scale_max = 1.0 + range;
  o.augmentation.log_scale = false;
  o.augmentation.tint = false;
  o.augmentation.hue = 0.015;
  o.augmentation.saturation = 0.7;
  o.augmentation.value = 0.4;
  o.augmentation.min_kept_share = 0.1;
  return o;
}

std::vector<std::string> read_train_config(const std::filesystem::path& file,
                                           TrainOptions& options) {
  const ConfigNode root = ConfigNode::load(file);
  std::vector<std::string> named;
  for (const std::string name : {kSmall, kYolo, kCenterNet}) {
    // All sections are checked, also those of the other networks.
    const auto section = root.optional_child(name);
    if (!section) continue;
    TrainOptions other;
    const bool wanted = options.model.rfind(name, 0) == 0;
    Reader reader(*section);
    visit_fields(reader, wanted ? options : other);
    section->finish();
    if (wanted) named = section->keys();
  }
  root.finish();
  return named;
}

void fit_to_adamw(TrainOptions& options, const std::vector<std::string>& named_keys) {
  if (options.optimizer != Optimizer::kAdamW) return;
  const auto named = [&](const char* key) {
    return std::find(named_keys.begin(), named_keys.end(), key) != named_keys.end();
  };
  if (!named("momentum")) options.momentum = kAutoMomentum;
  if (!named("warmup_bias_rate")) options.warmup_bias_rate = kAutoWarmupBiasRate;
}

std::string describe_train_options(const TrainOptions& options) {
  TrainOptions copy = options;
  Writer writer;
  visit_fields(writer, copy);
  return writer.json.dump();
}

}  // namespace segsim::perception
