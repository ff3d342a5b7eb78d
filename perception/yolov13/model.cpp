#include "perception/yolov13/model.h"

#include <algorithm>

#include "core/check.h"
#include "perception/internal/network/thread_count.h"
#include "perception/internal/yolov13/network.h"
#include "perception/yolov13/internal/tensor_convert.h"

namespace segsim::perception::yolov13 {

struct Model::Network {
  yolov13::Network module{nullptr};
};

namespace {

HeadOutput run(yolov13::Network network, const ImageBatch& images) {
  SEGSIM_CHECK(images.batch > 0 && images.height_px > 0 && images.width_px > 0 &&
                   images.height_px % 32 == 0 && images.width_px % 32 == 0,
               "image sizes");
  const std::size_t count = std::size_t{3} * static_cast<std::size_t>(images.batch) *
                            static_cast<std::size_t>(images.height_px) *
                            static_cast<std::size_t>(images.width_px);
  SEGSIM_CHECK(images.pixels.size() == count, std::to_string(images.pixels.size()));
  apply_thread_count();
  const torch::InferenceMode inference;
  auto input = torch::empty({images.batch, 3, images.height_px, images.width_px});
  std::copy(images.pixels.begin(), images.pixels.end(), input.data_ptr<float>());
  return to_head_output(network->forward(input), images.height_px, images.width_px);
}

}  // namespace

Model::Model(Scale scale, int class_count, std::uint64_t seed)
    : scale_(scale), class_count_(class_count), network_(std::make_unique<Network>()) {
  SEGSIM_CHECK(class_count >= 1, std::to_string(class_count));
  network_->module = yolov13::Network(scale, class_count);
  network_->module->initialize(seed);
  network_->module->eval();
}

Model::Model(const DetectorWeights& weights, const std::string& place)
    : Model(scale_of_architecture(weights.architecture, place),
            static_cast<int>(weights.class_names.size())) {
  import(weights.tensors, place);
}

Model::~Model() = default;
Model::Model(Model&&) noexcept = default;
Model& Model::operator=(Model&&) noexcept = default;

HeadOutput Model::forward(const ImageBatch& images) const {
  return run(network_->module, images);
}

HeadOutput Model::forward_folded(const ImageBatch& images) {
  if (!folded_) {
    folded_ = std::make_unique<Network>();
    folded_->module = yolov13::Network(scale_, class_count_);
    import_tensors(*folded_->module, tensors(), "copy");
    folded_->module->prepare_for_inference();
  }
  return run(folded_->module, images);
}

std::vector<NamedTensor> Model::tensors() const { return export_tensors(*network_->module); }

void Model::import(const std::vector<NamedTensor>& tensors, const std::string& place) {
  import_tensors(*network_->module, tensors, place);
  folded_.reset();
}

std::int64_t Model::parameter_count() const {
  std::int64_t count = 0;
  for (const auto& parameter : network_->module->parameters()) count += parameter.numel();
  return count;
}

int Model::state_entries() const {
  return static_cast<int>(network_->module->parameters().size() +
                          network_->module->buffers().size());
}

double Model::gflops(int input_px) const {
  SEGSIM_CHECK(input_px > 0 && input_px % 32 == 0, std::to_string(input_px));
  const MacCounter counter;
  const torch::InferenceMode inference;
  (void)network_->module->forward(torch::zeros({1, 3, input_px, input_px}));
  return 2e-9 * static_cast<double>(counter.macs());
}

}  // namespace segsim::perception::yolov13
