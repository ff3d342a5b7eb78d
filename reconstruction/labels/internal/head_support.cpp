#include "reconstruction/labels/internal/head_support.h"

#include <algorithm>
#include <cmath>

#include <torch/cuda.h>

#include "core/error.h"
#include "reconstruction/labels/assignment.h"

namespace segsim::reconstruction::internal {

at::Device device_of(int cuda_device) {
  if (cuda_device < 0) return {at::kCPU};
  const auto devices = static_cast<int>(torch::cuda::device_count());
  if (cuda_device >= devices) {
    throw core::InputError::expected(
        "label training on CUDA device " + std::to_string(cuda_device),
        "a libtorch that has it", std::to_string(devices) + " CUDA devices");
  }
  return {at::kCUDA, static_cast<at::DeviceIndex>(cuda_device)};
}

ClassSplit split_classes(const std::vector<core::SceneClass>& classes) {
  ClassSplit split;
  for (std::size_t c = 0; c < classes.size(); ++c) {
    auto& list = classes[c].thing ? split.things : split.stuff;
    const auto place = static_cast<std::int64_t>(list.size());
    split.thing_index.push_back(classes[c].thing ? place : -1);
    split.stuff_index.push_back(classes[c].thing ? -1 : place);
    list.push_back(static_cast<std::int64_t>(c));
  }
  return split;
}

Tensor positions_tensor(const std::vector<glm::vec3>& position_m, const at::Device& device) {
  std::vector<float> values;
  values.reserve(3 * position_m.size());
  for (const glm::vec3& p : position_m) values.insert(values.end(), {p.x, p.y, p.z});
  return device_tensor(values, torch::kFloat32, device).view({-1, 3});
}

Tensor padded_indices(std::vector<std::int64_t> values, std::int64_t rows,
                      const at::Device& device) {
  values.resize(static_cast<std::size_t>(rows), -1);
  return device_tensor(values, torch::kInt64, device);
}

MaskTargets mask_targets(const BatchTargets& targets, const std::vector<std::int64_t>& pixels,
                         const at::Device& device) {
  const auto count = static_cast<std::int64_t>(pixels.size());
  const auto masks = static_cast<std::int64_t>(targets.masks.size());
  Tensor one_hot = torch::zeros({count, masks}, torch::TensorOptions().dtype(torch::kFloat32));
  std::vector<float> importance, weight;
  for (std::int64_t i = 0; i < count; ++i) {
    const auto p = static_cast<std::size_t>(pixels[static_cast<std::size_t>(i)]);
    importance.push_back(targets.importance[p]);
    weight.push_back(targets.weight[p]);
    const std::int64_t mask = targets.mask_index[p];
    if (mask >= 0) one_hot.data_ptr<float>()[i * masks + mask] = 1.0F;
  }
  return {device_tensor(pixels, torch::kInt64, device), one_hot.to(device),
          device_tensor(importance, torch::kFloat32, device),
          device_tensor(weight, torch::kFloat32, device)};
}

std::vector<std::int64_t> assign_slots(const Tensor& probability, const MaskTargets& masks) {
  const auto slots = static_cast<std::size_t>(probability.size(1));
  const auto all = static_cast<std::size_t>(masks.one_hot.size(1));
  const std::size_t count = std::min(all, slots);
  const Tensor cost = masks.one_hot.t()
                          .matmul(probability)
                          .div(masks.one_hot.sum(0).unsqueeze(1))
                          .to(torch::kFloat64)
                          .neg()
                          .cpu()
                          .contiguous();
  const std::vector<int> slot_of =
      assign({cost.data_ptr<double>(), count * slots}, count, slots);
  std::vector<std::int64_t> slot(all, -1);
  std::copy(slot_of.begin(), slot_of.end(), slot.begin());
  return slot;
}

void LossSum::add(const std::string& name, double factor, const Tensor& loss) {
  if (factor == 0.0) return;
  const Tensor part = factor * loss;
  losses_.push_back({name, part.item<double>()});
  total_ = total_.defined() ? total_ + part : part;
}

std::vector<NamedLoss> LossSum::finish(std::int64_t iteration) {
  double sum = 0.0;
  for (const NamedLoss& loss : losses_) {
    if (!std::isfinite(loss.value)) {
      throw core::InputError::expected(
          "label training: " + loss.name + " loss at iteration " + std::to_string(iteration),
          "a finite number (try lower rates)", std::to_string(loss.value));
    }
    sum += loss.value;
  }
  if (total_.defined() && total_.requires_grad()) total_.backward();
  losses_.push_back({"total", sum});
  return losses_;
}

double rate_factor(const HeadRateConfig& rate, double progress) {
  const double from = std::min(rate.decay_from, 1.0 - 1e-9);
  const double phase = std::clamp((progress - from) / (1.0 - from), 0.0, 1.0);
  return rate.scale * std::pow(rate.final_factor, phase);
}

std::vector<renderer::PanopticClass> decoder_classes(
    const std::vector<core::SceneClass>& classes, const Tensor& weight, const Tensor& bias) {
  const std::vector<core::SemanticFeature> rows = rows_of<core::SemanticFeature>(weight);
  std::vector<renderer::PanopticClass> result;
  for (std::size_t c = 0; c < classes.size(); ++c) {
    result.push_back(
        {classes[c].id, classes[c].thing, rows[c], bias.contiguous().data_ptr<float>()[c]});
  }
  return result;
}

renderer::SurfelCloud feature_cloud(const std::vector<glm::vec3>& position_m,
                                    const std::vector<core::SemanticFeature>& semantic,
                                    const std::vector<core::InstanceFeature>& instance) {
  renderer::SurfelCloud cloud;
  const std::size_t count = position_m.size();
  cloud.position_m = position_m;
  cloud.R_world_surfel.assign(count, glm::quat(1.0F, 0.0F, 0.0F, 0.0F));
  cloud.scale_m.assign(count, glm::vec2(1.0F));
  cloud.opacity.assign(count, 1.0F);
  cloud.sh.assign(count, glm::vec3(0.0F));
  cloud.semantic_feature = semantic;
  cloud.instance_feature = instance;
  return cloud;
}

}  // namespace segsim::reconstruction::internal
