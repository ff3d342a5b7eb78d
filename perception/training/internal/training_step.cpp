#include "perception/training/internal/training_step.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "core/random.h"
#include "perception/internal/centernet/loss.h"
#include "perception/internal/loss/detection_loss.h"
#include "perception/internal/network/autocast.h"
#include "perception/training/internal/training_schedule.h"

namespace segsim::perception {
namespace {

constexpr double kSecondBeta = 0.999;  // Of AdamW.
/// The loss scale is doubled after so many steps without overflow and halved at one.
constexpr int kScaleGrowthSteps = 2000;
constexpr double kLowestLossScale = 1.0;

std::unique_ptr<torch::optim::Optimizer> make_optimizer(
    const std::vector<ParameterGroup>& groups, const TrainOptions& options) {
  const bool sgd = options.optimizer == Optimizer::kSgd;
  std::vector<torch::optim::OptimizerParamGroup> list;
  const auto add = [&](const std::vector<torch::Tensor>& parameters, double decay) {
    if (sgd) {
      auto settings = std::make_unique<torch::optim::SGDOptions>(options.learning_rate);
      settings->momentum(options.momentum).nesterov(true).weight_decay(decay);
      list.emplace_back(parameters, std::move(settings));
    } else {
      auto settings = std::make_unique<torch::optim::AdamWOptions>(options.learning_rate);
      settings->weight_decay(decay);
      list.emplace_back(parameters, std::move(settings));
    }
  };
  for (const ParameterGroup& group : groups) {
    add(group.parameters, group.decays ? step_weight_decay(options) : 0.0);
  }
  if (sgd) {
    return std::make_unique<torch::optim::SGD>(
        std::move(list), torch::optim::SGDOptions(options.learning_rate));
  }
  return std::make_unique<torch::optim::AdamW>(
      std::move(list), torch::optim::AdamWOptions(options.learning_rate));
}

void set_rates(torch::optim::Optimizer& optimizer, const std::vector<ParameterGroup>& kinds,
               const StepRates& rates, bool sgd) {
  auto& groups = optimizer.param_groups();
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const double rate =
        kinds[i].rate_factor * (kinds[i].is_bias ? rates.bias_rate : rates.rate);
    if (sgd) {
      auto& settings = static_cast<torch::optim::SGDOptions&>(groups[i].options());
      settings.lr(rate);
      settings.momentum(rates.momentum);
    } else {
      auto& settings = static_cast<torch::optim::AdamWOptions&>(groups[i].options());
      settings.lr(rate);
      settings.betas({rates.momentum, kSecondBeta});
    }
  }
}

}  // namespace

TrainingStep::TrainingStep(const TrainOptions& options, TrainableNetwork trained,
                           TrainableNetwork averaged, bool from_scratch)
    : network(std::move(trained)),
      average(std::move(averaged)),
      options_(options),
      device_(torch_device(options.device, "training: device")),
      from_scratch_(from_scratch) {
  freeze_layers(*network.module, options.frozen);
  network.module->to(device_);
  average.module->to(device_);
  average.module->eval();
  enter_training_mode(*network.module, options.frozen, options.norm_policy);
  groups_ = group_parameters(*network.module, options.class_rate);
  optimizer = make_optimizer(groups_, options);
  anchors_ = make_anchors(options.input_px, torch::TensorOptions(device_));
}

/// [batch, 3, input_px, input_px], a view of `batch_` on the CPU.
torch::Tensor TrainingStep::batch_on_device() {
  auto pixels = torch::from_blob(batch_.pixels.data(),
                                 {options_.batch, 3, options_.input_px, options_.input_px},
                                 torch::kFloat32);
  if (device_.is_cpu()) return pixels;
  if (!staging_.defined()) {
    staging_ = torch::empty(pixels.sizes(), torch::TensorOptions().pinned_memory(true));
  }
  staging_.copy_(pixels);
  // The loss is read before the next batch is made, so the copy is over by then.
  return staging_.to(device_, /*non_blocking=*/true);
}

/// Dropout is keyed by seed and step, so that a resumed run draws the same.
NetworkOutput TrainingStep::forward(std::int64_t number, const torch::Tensor& input) {
  if (network.seed_dropout) {
    network.seed_dropout(core::hash64("dropout/" + std::to_string(number), options_.seed));
  }
  const AutocastScope autocast(options_.mixed_precision);
  return network.forward(input);
}

/// Of the sum over a batch, before scaling.
torch::Tensor TrainingStep::batch_loss(std::int64_t number, const MakeBatch& make) {
  make(number, batch_);
  const auto input = batch_on_device();
  const NetworkOutput output = to_float32(forward(number, input));
  return std::visit([this](const auto& kind) { return mean_loss(kind); }, output) *
         static_cast<double>(options_.batch);
}

torch::Tensor TrainingStep::mean_loss(const RawOutput& output) const {
  const LossParts parts = detection_loss(output, anchors_, batch_.truth, network.rule);
  return options_.box_gain * parts.box + options_.class_gain * parts.classes +
         options_.bin_gain * parts.bins;
}

torch::Tensor TrainingStep::mean_loss(const HeatMaps& maps) const {
  const centernet::HeatLossParts parts = centernet::heat_loss(maps, batch_.truth);
  return options_.box_gain * parts.box + options_.class_gain * parts.classes;
}

/// Divides by the loss scale and clips. @returns whether all derivatives are numbers.
bool TrainingStep::finish_gradients() {
  const auto parameters = network.module->parameters();
  if (options_.mixed_precision) {
    const torch::NoGradGuard no_grad;
    for (const auto& parameter : parameters) {
      if (parameter.grad().defined()) parameter.grad().div_(loss_scale);
    }
  }
  return std::isfinite(
      torch::nn::utils::clip_grad_norm_(parameters, options_.max_gradient_norm));
}

/// Halves the scale where float16 overflowed; that step is left out.
void TrainingStep::adapt_loss_scale(bool finite) {
  if (!options_.mixed_precision) return;
  if (!finite) {
    loss_scale *= 0.5;
    steps_since_scale = 0;
  }
  if (++steps_since_scale >= kScaleGrowthSteps) {
    loss_scale *= 2.0;
    steps_since_scale = 0;
  }
}

/// From scratch the statistics are first a plain mean: the values they start at (0 and 1)
/// would otherwise outlast a hundred steps, and through twenty layers spoil the output.
double TrainingStep::norm_momentum(std::int64_t batches_done) const {
  if (!from_scratch_) return kNormMomentum;
  return std::max(kNormMomentum, 1.0 / static_cast<double>(batches_done + 1));
}

/// Averages parameters and batch-norm statistics; integer buffers are copied.
void TrainingStep::update_average() {
  const torch::NoGradGuard no_grad;
  const double follow = average_follow(options_, step);
  const auto blend = [follow](torch::Tensor& target, const torch::Tensor& from) {
    if (target.is_floating_point()) {
      target.lerp_(from, follow);
    } else {
      target.copy_(from);
    }
  };
  auto to = average.module->parameters(), from = network.module->parameters();
  for (std::size_t i = 0; i < to.size(); ++i) blend(to[i], from[i]);
  to = average.module->buffers();
  from = network.module->buffers();
  for (std::size_t i = 0; i < to.size(); ++i) blend(to[i], from[i]);
}

std::optional<double> TrainingStep::advance(const MakeBatch& make) {
  const int batches = batches_per_step(options_);
  set_rates(*optimizer, groups_, rates_at(options_, step),
            options_.optimizer == Optimizer::kSgd);
  optimizer->zero_grad();
  double sum = 0.0;
  for (int i = 0; i < batches; ++i) {
    const std::int64_t number = step * batches + i;
    set_norm_momentum(*network.module, norm_momentum(number));
    const auto loss = batch_loss(number, make);
    const double value = loss.item<double>();
    if (!std::isfinite(value)) return std::nullopt;
    sum += value;
    (options_.mixed_precision ? loss * loss_scale : loss).backward();
  }
  const bool finite = finish_gradients();
  if (!finite && (!options_.mixed_precision || loss_scale <= kLowestLossScale)) {
    return std::nullopt;
  }
  if (finite) optimizer->step();
  adapt_loss_scale(finite);
  ++step;
  update_average();
  return sum / (options_.batch * batches);
}

}  // namespace segsim::perception
