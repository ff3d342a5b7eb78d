#include "perception/training.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>

#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "perception/detector.h"
#include "perception/internal/batch_source.h"
#include "perception/internal/detection_loss.h"
#include "perception/internal/network.h"
#include "perception/internal/training_inputs.h"

namespace segsim::perception {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kFinalRateShare = 0.05;
constexpr double kMaxGradientNorm = 10.0;
/// The average follows the weights closely at first: decay * (1 - e^(-step / this)).
constexpr double kEmaRampSteps = 100.0;

/// Restores the thread count when training ends, also by an exception.
class ThreadScope {
 public:
  explicit ThreadScope(int count) : before_(threads()) { set_threads(count); }
  ~ThreadScope() { set_threads(before_); }
  ThreadScope(const ThreadScope&) = delete;
  ThreadScope& operator=(const ThreadScope&) = delete;

 private:
  int before_;
};

TinyDetector make_network(const TrainOptions& options, const TrainingInputs& in) {
  TinyDetector network(in.width, static_cast<int>(in.class_names.size()), in.input_px);
  network->initialize(options.seed);
  if (in.initial) {
    DetectorWeights initial = *in.initial;
    const std::string place = options.initial_weights.string();
    match_class_rows(initial, in.class_names, export_tensors(*network), place);
    import_tensors(*network, initial.tensors, place);
  }
  return network;
}

/// Decay acts on convolution weights only, not on batch norms and biases.
torch::optim::AdamW make_optimizer(TinyDetector& network, const TrainOptions& options) {
  std::vector<torch::Tensor> decayed, free;
  for (const auto& parameter : network->parameters()) {
    (parameter.dim() >= 2 ? decayed : free).push_back(parameter);
  }
  std::vector<torch::optim::OptimizerParamGroup> groups;
  for (const bool decays : {true, false}) {
    auto settings = std::make_unique<torch::optim::AdamWOptions>(options.learning_rate);
    settings->weight_decay(decays ? options.weight_decay : 0.0);
    groups.emplace_back(decays ? decayed : free, std::move(settings));
  }
  return torch::optim::AdamW(std::move(groups),
                             torch::optim::AdamWOptions(options.learning_rate));
}

/// Linear warm-up times cosine decay to kFinalRateShare.
double learning_rate(const TrainOptions& options, std::int64_t step) {
  const double warmup =
      std::min(1.0, static_cast<double>(step + 1) / (options.warmup_steps + 1));
  const double phase = static_cast<double>(step) / options.steps;
  const double cosine = 0.5 * (1.0 + std::cos(std::numbers::pi * phase));
  return options.learning_rate * warmup * (kFinalRateShare + (1.0 - kFinalRateShare) * cosine);
}

/// One run: network, its average, optimizer and step, which together are the state on disk.
class Trainer {
 public:
  Trainer(const TrainOptions& options, const TrainingInputs& inputs)
      : options_(options),
        inputs_(inputs),
        source_(inputs.train, inputs.mix ? &*inputs.mix : nullptr,
                {inputs.input_px, options.batch, options.mix_share, options.augment,
                 options.seed}),
        network_(make_network(options, inputs)),
        average_(make_network(options, inputs)),
        optimizer_(make_optimizer(network_, options)),
        anchors_(make_anchors(inputs.input_px, torch::kFloat32)) {
    network_->train();
    average_->eval();
    if (std::filesystem::exists(state_file())) load_state();
  }

  [[nodiscard]] std::int64_t step() const { return step_; }
  [[nodiscard]] std::filesystem::path state_file() const {
    return options_.output.string() + ".state";
  }
  [[nodiscard]] std::int64_t parameter_count() const {
    std::int64_t count = 0;
    for (const auto& parameter : network_->parameters()) count += parameter.numel();
    return count;
  }

  /// One step; returns the loss per image.
  double advance() {
    source_.make(step_, batch_);
    const double rate = learning_rate(options_, step_);
    for (auto& group : optimizer_.param_groups()) group.options().set_lr(rate);
    const auto input = torch::from_blob(
        batch_.pixels.data(), {options_.batch, 3, inputs_.input_px, inputs_.input_px},
        torch::kFloat32);
    network_->set_norm_momentum(norm_momentum());
    const LossParts parts = detection_loss(network_->forward(input), anchors_, batch_.truth);
    const auto loss = parts.total(options_.batch);
    optimizer_.zero_grad();
    loss.backward();
    torch::nn::utils::clip_grad_norm_(network_->parameters(), kMaxGradientNorm);
    optimizer_.step();
    ++step_;
    update_average();
    const double value = loss.item<double>() / options_.batch;
    if (!std::isfinite(value)) {
      throw core::InputError::expected("training: loss at step " + std::to_string(step_),
                                       "a finite number (try a lower learning rate)",
                                       std::to_string(value));
    }
    return value;
  }

  void save_state() const {
    core::write_via_temporary(state_file(), [this](const std::filesystem::path& file) {
      torch::serialize::OutputArchive archive, network, average, optimizer;
      network_->save(network);
      average_->save(average);
      optimizer_.save(optimizer);
      archive.write("network", network);
      archive.write("average", average);
      archive.write("optimizer", optimizer);
      archive.write("step", torch::tensor(step_, torch::kInt64), true);
      archive.write("identity", c10::IValue(identity()));
      archive.save_to(file.string());
    });
  }

  [[nodiscard]] DetectorWeights weights() const {
    DetectorWeights weights;
    weights.width = inputs_.width;
    weights.input_px = inputs_.input_px;
    weights.class_names = inputs_.class_names;
    weights.training = inputs_.recipe;
    weights.tensors = export_tensors(*average_);
    return weights;
  }

 private:
  /// What a state must agree on to be continued.
  [[nodiscard]] std::string identity() const {
    const Json json = {{"recipe", Json::parse(inputs_.recipe)},
                       {"width", inputs_.width},
                       {"input_px", inputs_.input_px},
                       {"class_names", inputs_.class_names}};
    return json.dump();
  }

  void load_state() {
    const std::string place = state_file().string();
    try {
      torch::serialize::InputArchive archive, network, average, optimizer;
      archive.load_from(place);
      c10::IValue found;
      archive.read("identity", found);
      if (found.toStringRef() != identity()) {
        throw core::InputError::expected(place, "a state of this run (or no such file)",
                                         "that of a run with other options or data");
      }
      archive.read("network", network);
      archive.read("average", average);
      archive.read("optimizer", optimizer);
      network_->load(network);
      average_->load(average);
      optimizer_.load(optimizer);
      torch::Tensor step;
      archive.read("step", step, true);
      step_ = step.item<std::int64_t>();
    } catch (const c10::Error& error) {
      throw core::InputError::expected(place, "a training state",
                                       error.what_without_backtrace());
    }
  }

  /// From scratch the statistics are first a plain mean: the values they start at (0 and 1)
  /// would otherwise outlast a hundred steps, and through twenty layers spoil the output.
  [[nodiscard]] double norm_momentum() const {
    if (inputs_.initial) return kNormMomentum;
    return std::max(kNormMomentum, 1.0 / static_cast<double>(step_ + 1));
  }

  /// Averages parameters and batch-norm statistics; integer buffers are copied.
  void update_average() {
    const torch::NoGradGuard no_grad;
    const double ramp = 1.0 - std::exp(-static_cast<double>(step_) / kEmaRampSteps);
    const double follow = 1.0 - options_.ema_decay * ramp;
    const auto blend = [follow](torch::Tensor& target, const torch::Tensor& source) {
      if (target.is_floating_point()) {
        target.lerp_(source, follow);
      } else {
        target.copy_(source);
      }
    };
    auto to = average_->parameters(), from = network_->parameters();
    for (std::size_t i = 0; i < to.size(); ++i) blend(to[i], from[i]);
    to = average_->buffers();
    from = network_->buffers();
    for (std::size_t i = 0; i < to.size(); ++i) blend(to[i], from[i]);
  }

  const TrainOptions& options_;
  const TrainingInputs& inputs_;
  BatchSource source_;
  Batch batch_;
  TinyDetector network_, average_;
  torch::optim::AdamW optimizer_;
  Anchors anchors_;
  std::int64_t step_ = 0;
};

}  // namespace

TrainReport train(const TrainOptions& options) {
  check_train_options(options);
  const TrainingInputs inputs = read_training_inputs(options);
  const ThreadScope thread_scope(options.threads);
  Trainer trainer(options, inputs);

  TrainReport report;
  report.first_step = static_cast<int>(trainer.step());
  report.parameters = trainer.parameter_count();
  std::optional<core::Progress> progress;
  if (options.show_progress) progress.emplace("training", options.steps);
  const auto begin = std::chrono::steady_clock::now();
  bool stopped = false;
  while (trainer.step() < options.steps && !stopped) {
    report.losses.push_back(trainer.advance());
    const auto done = static_cast<int>(trainer.step());
    if (progress) {
      char note[32];
      std::snprintf(note, sizeof note, "loss %.3f", report.losses.back());
      progress->update(done, note);
    }
    stopped = options.on_step && !options.on_step(done, report.losses.back());
    const bool due = options.checkpoint_every > 0 && done % options.checkpoint_every == 0;
    if (stopped || (due && done < options.steps)) trainer.save_state();
  }
  const double wall_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
          .count();
  report.steps_done = static_cast<int>(trainer.step());
  report.mean_step_ms =
      wall_ms / static_cast<double>(std::max<std::size_t>(1, report.losses.size()));
  if (progress) progress->finish();
  if (stopped) return report;

  report.operating =
      write_with_threshold(options.output, trainer.weights(),
                           inputs.validation ? *inputs.validation : inputs.train);
  std::filesystem::remove(trainer.state_file());
  report.finished = true;
  return report;
}

}  // namespace segsim::perception
