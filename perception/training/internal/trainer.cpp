#include "perception/training/internal/trainer.h"

#include <cmath>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/training/internal/batch_source.h"
#include "perception/training/internal/training_schedule.h"
#include "perception/training/internal/training_step.h"
#include "perception/training/training_config.h"

namespace segsim::perception {
namespace {

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
        device(torch_device(options.device, "training: device")),
        source(inputs.train, inputs.mix ? &*inputs.mix : nullptr,
               batch_options(options, inputs)),
        training(options, make_network(options, inputs), make_network(options, inputs),
                 !inputs.initial.has_value()) {}

  const TrainOptions& options;
  const TrainingInputs& inputs;
  torch::Device device;
  BatchSource source;
  TrainingStep training;
};

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
    impl_->training.network.module->load(network);
    impl_->training.average.module->load(average);
    impl_->training.optimizer->load(optimizer);
    torch::Tensor numbers;
    archive.read("numbers", numbers, true);
    const auto all = numbers.to(torch::kCPU);
    const double* values = all.data_ptr<double>();
    impl_->training.step = std::llround(values[0]);
    impl_->training.loss_scale = values[1];
    impl_->training.steps_since_scale = static_cast<int>(values[2]);
    best = {std::llround(values[3]), values[4], static_cast<int>(values[5])};
  } catch (const c10::Error& error) {
    throw core::InputError::expected(place, "a training state",
                                     error.what_without_backtrace());
  }
}

Trainer::~Trainer() = default;

std::optional<double> Trainer::advance() {
  return impl_->training.advance(
      [this](std::int64_t number, Batch& batch) { impl_->source.make(number, batch); });
}
std::int64_t Trainer::step() const { return impl_->training.step; }

std::int64_t Trainer::parameter_count() const {
  std::int64_t count = 0;
  for (const auto& parameter : impl_->training.network.module->parameters())
    count += parameter.numel();
  return count;
}

DetectorWeights Trainer::weights() const {
  DetectorWeights weights;
  weights.architecture = architecture_of(impl_->options, impl_->inputs);
  weights.width = impl_->inputs.width;
  weights.input_px = impl_->inputs.input_px;
  weights.class_names = impl_->inputs.class_names;
  weights.training = impl_->inputs.recipe;
  weights.tensors = export_tensors(*impl_->training.average.module);
  return weights;
}

std::filesystem::path Trainer::state_file() const {
  return impl_->options.output.string() + ".state";
}

void Trainer::save_state() const {
  core::write_via_temporary(state_file(), [this](const std::filesystem::path& file) {
    torch::serialize::OutputArchive archive, network, average, optimizer;
    impl_->training.network.module->save(network);
    impl_->training.average.module->save(average);
    impl_->training.optimizer->save(optimizer);
    archive.write("network", network);
    archive.write("average", average);
    archive.write("optimizer", optimizer);
    const auto numbers =
        torch::tensor({static_cast<double>(impl_->training.step), impl_->training.loss_scale,
                       static_cast<double>(impl_->training.steps_since_scale),
                       static_cast<double>(best.step), best.fitness,
                       static_cast<double>(best.without_better)},
                      torch::kFloat64);
    archive.write("numbers", numbers, true);
    archive.write("identity", c10::IValue(impl_->inputs.recipe));
    archive.save_to(file.string());
  });
}

}  // namespace segsim::perception
