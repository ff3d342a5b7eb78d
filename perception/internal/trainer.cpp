#include "perception/internal/trainer.h"

#include <cmath>

#include <ATen/autocast_mode.h>
#include <torch/version.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "perception/internal/batch_source.h"
#include "perception/internal/detection_loss.h"
#include "perception/internal/trainable_network.h"
#include "perception/internal/training_schedule.h"
#include "perception/training_config.h"

namespace segsim::perception {
namespace {

constexpr double kSecondBeta = 0.999;  // Of AdamW.
/// float16 loses small derivatives, so the loss is scaled up: doubled after so many steps
/// without overflow, halved at one (Micikevicius et al. 2018, "Mixed precision training").
constexpr double kFirstLossScale = 65536.0;
constexpr int kScaleGrowthSteps = 2000;
constexpr double kLowestLossScale = 1.0;

/// Chooses float16 on CUDA for operations that bear it, while it lives.
class AutocastScope {
 public:
  explicit AutocastScope(bool on) : on_(on) {
    if (on_) set(true);
  }
  ~AutocastScope() {
    if (!on_) return;
    at::autocast::clear_cache();
    set(false);
  }
  AutocastScope(const AutocastScope&) = delete;
  AutocastScope& operator=(const AutocastScope&) = delete;

 private:
  static void set(bool on) {
#if TORCH_VERSION_MAJOR > 2 || (TORCH_VERSION_MAJOR == 2 && TORCH_VERSION_MINOR >= 4)
    at::autocast::set_autocast_enabled(at::kCUDA, on);
#else
    at::autocast::set_enabled(on);
#endif
  }
  bool on_;
};

torch::Device device_of(const TrainOptions& options) {
  if (options.device == TrainDevice::kCpu) return torch::kCPU;
  if (!torch::cuda::is_available()) {
    throw core::InputError::expected("training: device", "cpu",
                                     "cuda, which this libtorch or machine does not have");
  }
  return torch::kCUDA;
}

std::string architecture_of(const TrainOptions& options, const TrainingInputs& in) {
  return in.initial ? in.initial->architecture : architecture_of_model(options.model);
}

TrainableNetwork make_network(const TrainOptions& options, const TrainingInputs& in) {
  const int classes = static_cast<int>(in.class_names.size());
  TrainableNetwork network = make_trainable_network(architecture_of(options, in), in.width,
                                                    classes, in.input_px, options.seed);
  if (!in.initial) return network;
  DetectorWeights initial = *in.initial;
  const std::string place = options.initial_weights.string();
  match_class_rows(initial, in.class_names, export_tensors(*network.module), place);
  import_tensors(*network.module, initial.tensors, place);
  return network;
}

/// Groups: weights, weights of batch norms, biases.
std::unique_ptr<torch::optim::Optimizer> make_optimizer(const torch::nn::Module& module,
                                                        const TrainOptions& options) {
  const ParameterGroups groups = group_parameters(module);
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
  add(groups.weights, step_weight_decay(options));
  add(groups.norm_weights, 0.0);
  add(groups.biases, 0.0);
  if (sgd) {
    return std::make_unique<torch::optim::SGD>(
        std::move(list), torch::optim::SGDOptions(options.learning_rate));
  }
  return std::make_unique<torch::optim::AdamW>(
      std::move(list), torch::optim::AdamWOptions(options.learning_rate));
}

void set_rates(torch::optim::Optimizer& optimizer, const StepRates& rates, bool sgd) {
  auto& groups = optimizer.param_groups();
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const double rate = i + 1 == groups.size() ? rates.bias_rate : rates.rate;
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

BatchOptions batch_options(const TrainOptions& o, const TrainingInputs& in) {
  return {in.input_px,    o.batch,
          o.mix_share,    o.augment,
          o.augmentation, std::int64_t{o.steps - o.closing_steps} * batches_per_step(o),
          o.seed};
}

}  // namespace

struct Trainer::Impl {
  Impl(const TrainOptions& train_options, const TrainingInputs& train_inputs)
      : options(train_options),
        inputs(train_inputs),
        device(device_of(options)),
        source(inputs.train, inputs.mix ? &*inputs.mix : nullptr,
               batch_options(options, inputs)),
        network(make_network(options, inputs)),
        average(make_network(options, inputs)) {
    freeze_layers(*network.module, options.frozen);
    network.module->to(device);
    average.module->to(device);
    average.module->eval();
    enter_training_mode(*network.module, options.frozen, options.norm_policy);
    optimizer = make_optimizer(*network.module, options);
    anchors = make_anchors(inputs.input_px, torch::TensorOptions(device));
  }

  /// Of the sum over a batch, before scaling.
  torch::Tensor batch_loss(std::int64_t number) {
    source.make(number, batch);
    const auto input =
        torch::from_blob(batch.pixels.data(),
                         {options.batch, 3, inputs.input_px, inputs.input_px}, torch::kFloat32)
            .to(device);
    // Dropout: keyed by seed and step, so that a resumed run draws the same.
    torch::manual_seed(core::hash64("dropout/" + std::to_string(number), options.seed));
    RawOutput raw;
    {
      const AutocastScope autocast(options.mixed_precision);
      raw = network.forward(input);
    }
    raw.box = raw.box.to(torch::kFloat32);
    raw.classes = raw.classes.to(torch::kFloat32);
    const LossParts parts = detection_loss(raw, anchors, batch.truth, network.rule);
    return (options.box_gain * parts.box + options.class_gain * parts.classes +
            options.bin_gain * parts.bins) *
           static_cast<double>(options.batch);
  }

  /// Divides by the loss scale and clips. @returns whether all derivatives are numbers.
  bool finish_gradients() {
    const auto parameters = network.module->parameters();
    if (options.mixed_precision) {
      const torch::NoGradGuard no_grad;
      for (const auto& parameter : parameters) {
        if (parameter.grad().defined()) parameter.grad().div_(loss_scale);
      }
    }
    return std::isfinite(
        torch::nn::utils::clip_grad_norm_(parameters, options.max_gradient_norm));
  }

  /// From scratch the statistics are first a plain mean: the values they start at (0 and 1)
  /// would otherwise outlast a hundred steps, and through twenty layers spoil the output.
  [[nodiscard]] double norm_momentum(std::int64_t batches_done) const {
    if (inputs.initial) return kNormMomentum;
    return std::max(kNormMomentum, 1.0 / static_cast<double>(batches_done + 1));
  }

  /// Averages parameters and batch-norm statistics; integer buffers are copied.
  void update_average() {
    const torch::NoGradGuard no_grad;
    const double follow = average_follow(options, step);
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

  std::optional<double> advance();

  const TrainOptions& options;
  const TrainingInputs& inputs;
  torch::Device device;
  BatchSource source;
  Batch batch;
  TrainableNetwork network, average;
  std::unique_ptr<torch::optim::Optimizer> optimizer;
  Anchors anchors;
  std::int64_t step = 0;
  double loss_scale = kFirstLossScale;
  int steps_since_scale = 0;
};

std::optional<double> Trainer::Impl::advance() {
  const int batches = batches_per_step(options);
  set_rates(*optimizer, rates_at(options, step), options.optimizer == Optimizer::kSgd);
  optimizer->zero_grad();
  double sum = 0.0;
  for (int i = 0; i < batches; ++i) {
    const std::int64_t number = step * batches + i;
    set_norm_momentum(*network.module, norm_momentum(number));
    const auto loss = batch_loss(number);
    const double value = loss.item<double>();
    if (!std::isfinite(value)) return std::nullopt;
    sum += value;
    (options.mixed_precision ? loss * loss_scale : loss).backward();
  }
  const bool finite = finish_gradients();
  if (!finite && (!options.mixed_precision || loss_scale <= kLowestLossScale)) {
    return std::nullopt;
  }
  if (finite) {
    optimizer->step();
  } else {
    loss_scale *= 0.5;  // The step is left out: float16 overflowed.
    steps_since_scale = 0;
  }
  if (options.mixed_precision && ++steps_since_scale >= kScaleGrowthSteps) {
    loss_scale *= 2.0;
    steps_since_scale = 0;
  }
  ++step;
  update_average();
  return sum / (options.batch * batches);
}

Trainer::Trainer(const TrainOptions& options, const TrainingInputs& inputs)
    : impl_(std::make_unique<Impl>(options, inputs)) {
  const std::string place = state_file().string();
  if (!std::filesystem::exists(state_file())) return;
  try {
    torch::serialize::InputArchive archive, network, average, optimizer;
    archive.load_from(place, impl_->device);
    c10::IValue found;
    archive.read("identity", found);
    if (found.toStringRef() != inputs.recipe) {
      throw core::InputError::expected(place, "a state of this run (or no such file)",
                                       "that of a run with other options or data");
    }
    archive.read("network", network);
    archive.read("average", average);
    archive.read("optimizer", optimizer);
    impl_->network.module->load(network);
    impl_->average.module->load(average);
    impl_->optimizer->load(optimizer);
    torch::Tensor numbers;
    archive.read("numbers", numbers, true);
    const auto all = numbers.to(torch::kCPU);
    const double* values = all.data_ptr<double>();
    impl_->step = std::llround(values[0]);
    impl_->loss_scale = values[1];
    impl_->steps_since_scale = static_cast<int>(values[2]);
    best = {std::llround(values[3]), values[4], static_cast<int>(values[5])};
  } catch (const c10::Error& error) {
    throw core::InputError::expected(place, "a training state",
                                     error.what_without_backtrace());
  }
}

Trainer::~Trainer() = default;

std::optional<double> Trainer::advance() { return impl_->advance(); }
std::int64_t Trainer::step() const { return impl_->step; }

std::int64_t Trainer::parameter_count() const {
  std::int64_t count = 0;
  for (const auto& parameter : impl_->network.module->parameters()) count += parameter.numel();
  return count;
}

DetectorWeights Trainer::weights() const {
  DetectorWeights weights;
  weights.architecture = architecture_of(impl_->options, impl_->inputs);
  weights.width = impl_->inputs.width;
  weights.input_px = impl_->inputs.input_px;
  weights.class_names = impl_->inputs.class_names;
  weights.training = impl_->inputs.recipe;
  weights.tensors = export_tensors(*impl_->average.module);
  return weights;
}

std::filesystem::path Trainer::state_file() const {
  return impl_->options.output.string() + ".state";
}

void Trainer::save_state() const {
  core::write_via_temporary(state_file(), [this](const std::filesystem::path& file) {
    torch::serialize::OutputArchive archive, network, average, optimizer;
    impl_->network.module->save(network);
    impl_->average.module->save(average);
    impl_->optimizer->save(optimizer);
    archive.write("network", network);
    archive.write("average", average);
    archive.write("optimizer", optimizer);
    const auto numbers = torch::tensor(
        {static_cast<double>(impl_->step), impl_->loss_scale,
         static_cast<double>(impl_->steps_since_scale), static_cast<double>(best.step),
         best.fitness, static_cast<double>(best.without_better)},
        torch::kFloat64);
    archive.write("numbers", numbers, true);
    archive.write("identity", c10::IValue(impl_->inputs.recipe));
    archive.save_to(file.string());
  });
}

}  // namespace segsim::perception
