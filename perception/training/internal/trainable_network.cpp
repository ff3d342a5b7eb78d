#include "perception/training/internal/trainable_network.h"

#include <algorithm>
#include <set>

#include "core/error.h"
#include "perception/checkpoint/yolov13_scale.h"
#include "perception/internal/centernet/network.h"
#include "perception/internal/yolov13/network.h"
#include "perception/training/internal/class_layer.h"

namespace segsim::perception {
namespace {

constexpr const char* kBackbone[] = {
    "down1",   "down2",   "down3",   "down4",   "down5",   "stage2",  "stage3",
    "stage4",  "stage5",  "model.0", "model.1", "model.2", "model.3", "model.4",
    "model.5", "model.6", "model.7", "model.8", "stem",    "blocks",  "widen"};

bool has_prefix(const std::string& name, const std::string& prefix) {
  return name.rfind(prefix, 0) == 0 &&
         (name.size() == prefix.size() || name[prefix.size()] == '.');
}

bool matches(const std::string& name, const std::string& entry) {
  if (entry != "backbone") return has_prefix(name, entry);
  return std::any_of(std::begin(kBackbone), std::end(kBackbone),
                     [&](const char* layer) { return has_prefix(name, layer); });
}

template <class Network>
TrainableNetwork wrap(Network network, std::uint64_t seed, const AssignerRule& rule) {
  network->initialize(seed);
  return {network.ptr(),
          [network](const torch::Tensor& x) mutable -> NetworkOutput {
            return network->forward(x);
          },
          rule,
          {}};
}

template <class Action>
void for_each_norm(torch::nn::Module& module, const Action& action) {
  for (const auto& item : module.named_modules("", false)) {
    if (auto* norm = item.value()->as<torch::nn::BatchNorm2dImpl>()) action(item.key(), *norm);
  }
}

}  // namespace

TrainableNetwork make_trainable_network(const std::string& architecture, double width,
                                        int class_count, int input_px, std::uint64_t seed) {
  if (architecture == DetectorWeights::kCenterNet) {
    return wrap(centernet::Network(class_count), seed, {});
  }
  if (!yolov13::is_architecture(architecture)) {
    return wrap(TinyDetector(width, class_count, input_px), seed, {});
  }
  const auto scale = yolov13::scale_of_architecture(architecture, "training: model");
  yolov13::Network network(scale, class_count);
  TrainableNetwork wrapped = wrap(network, seed, kYoloRule);
  wrapped.seed_dropout = [network](std::uint64_t s) mutable { network->seed_dropout(s); };
  return wrapped;
}

bool is_frozen(const std::string& name, const std::vector<std::string>& frozen) {
  return std::any_of(frozen.begin(), frozen.end(),
                     [&](const std::string& entry) { return matches(name, entry); });
}

void freeze_layers(torch::nn::Module& module, const std::vector<std::string>& frozen) {
  const auto all = module.named_parameters();
  for (const std::string& entry : frozen) {
    const auto keys = all.keys();
    if (std::none_of(keys.begin(), keys.end(),
                     [&](const std::string& name) { return matches(name, entry); })) {
      throw core::InputError::expected(
          "training: freeze", "backbone or the begin of a parameter's name, like " + keys[0],
          entry);
    }
  }
  for (const auto& item : all) {
    if (is_frozen(item.key(), frozen)) item.value().requires_grad_(false);
  }
}

void enter_training_mode(torch::nn::Module& module, const std::vector<std::string>& frozen,
                         NormPolicy policy) {
  module.train();
  for_each_norm(module, [&](const std::string& name, torch::nn::BatchNorm2dImpl& norm) {
    if (policy == NormPolicy::kFrozen || is_frozen(name, frozen)) norm.eval();
  });
}

void set_norm_momentum(torch::nn::Module& module, double momentum) {
  for_each_norm(module, [&](const std::string&, torch::nn::BatchNorm2dImpl& norm) {
    norm.options.momentum(momentum);
  });
}

std::vector<ParameterGroup> group_parameters(const torch::nn::Module& module,
                                             double class_rate) {
  enum { kWeights, kNormWeights, kBiases, kClassWeights, kClassBiases };
  std::vector<ParameterGroup> groups{{true, false, 1.0, {}},
                                     {false, false, 1.0, {}},
                                     {false, true, 1.0, {}},
                                     {true, false, class_rate, {}},
                                     {false, true, class_rate, {}}};
  std::set<std::string> norms;
  for (const auto& item : module.named_modules("", false)) {
    if (item.value()->as<torch::nn::BatchNorm2dImpl>() != nullptr) norms.insert(item.key());
  }
  const auto group_of = [&](const std::string& name) {
    const std::size_t dot = name.rfind('.');
    const std::string owner = dot == std::string::npos ? "" : name.substr(0, dot);
    const bool bias =
        name.find("bias", dot == std::string::npos ? 0 : dot) != std::string::npos;
    if (is_class_layer(name)) return bias ? kClassBiases : kClassWeights;
    if (bias) return kBiases;
    return norms.count(owner) != 0 ? kNormWeights : kWeights;
  };
  for (const auto& item : module.named_parameters()) {
    if (!item.value().requires_grad()) continue;
    groups[static_cast<std::size_t>(group_of(item.key()))].parameters.push_back(item.value());
  }
  return groups;
}

}  // namespace segsim::perception
