#include "reconstruction/training/internal/raster_function.h"

#include <gmock/gmock.h>

#include "core/check.h"
#include "tests/reconstruction/training/training_surfels.h"

namespace segsim::reconstruction::internal {
namespace {

using testing::OwnedGradients;
using testing::OwnedImages;
using testing::OwnedSurfels;

Tensor copied(const std::vector<float>& values, std::vector<std::int64_t> shape) {
  return device_tensor(values, torch::kFloat32, torch::kCPU).view(shape);
}

SurfelTensors tensors_of(const OwnedSurfels<float>& s) {
  SurfelTensors t{copied(s.position_m, {-1, 3}), copied(s.log_scale, {-1, 2}),
                  copied(s.rotation, {-1, 4}), copied(s.opacity_logit, {-1}),
                  copied(s.sh, {s.count(), -1, 3})};
  for (Tensor* tensor : {&t.position_m, &t.log_scale, &t.rotation, &t.opacity_logit, &t.sh}) {
    tensor->requires_grad_(true);
  }
  return t;
}

std::vector<float> values_of(const Tensor& tensor) {
  const Tensor host = tensor.detach().contiguous();
  return {host.data_ptr<float>(), host.data_ptr<float>() + host.numel()};
}

struct Fixture {
  OwnedSurfels<float> surfels = testing::random_surfels<float>(3, 40, 1);
  core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(40, 30, 1.0);
  core::CameraPose pose;
  RasterFunction function{make_cpu_rasterizer<float>({.threads = 1}), torch::kCPU};
};

/// Derivatives through autograd are those of the rasterizer, image by image.
TEST(RasterFunction, AutogradIsTheRasterizersBackward) {
  Fixture f;
  const SurfelTensors tensors = tensors_of(f.surfels);
  const ViewTensors view = f.function.draw(tensors, 1, f.camera, f.pose, true);
  OwnedImages<float> weight(f.camera);
  core::RandomStream random(1, "loss");
  for (auto* image :
       {&weight.rgb, &weight.depth_m, &weight.alpha, &weight.normal, &weight.distortion}) {
    for (float& value : *image) value = static_cast<float>(random.normal());
  }
  const Tensor loss = (view.rgb * copied(weight.rgb, {30, 40, 3})).sum() +
                      (view.depth_m * copied(weight.depth_m, {30, 40})).sum() +
                      (view.alpha * copied(weight.alpha, {30, 40})).sum() +
                      (view.normal * copied(weight.normal, {30, 40, 3})).sum() +
                      (view.distortion * copied(weight.distortion, {30, 40})).sum();
  loss.backward();

  const auto direct = make_cpu_rasterizer<float>({.threads = 1});
  OwnedImages<float> images(f.camera);
  OwnedGradients<float> expected(f.surfels);
  std::vector<float> max_weight(f.surfels.opacity_logit.size());
  direct->forward(f.surfels.view(), f.camera, f.pose, images.view(), max_weight.data());
  direct->backward(f.surfels.view(), weight.const_view(), expected.view());
  EXPECT_EQ(values_of(view.rgb), images.rgb);
  EXPECT_EQ(values_of(view.distortion), images.distortion);
  EXPECT_EQ(values_of(view.max_weight), max_weight);
  EXPECT_EQ(values_of(tensors.position_m.grad()), expected.position_m);
  EXPECT_EQ(values_of(tensors.log_scale.grad()), expected.log_scale);
  EXPECT_EQ(values_of(tensors.rotation.grad()), expected.rotation);
  EXPECT_EQ(values_of(tensors.opacity_logit.grad()), expected.opacity_logit);
  EXPECT_EQ(values_of(tensors.sh.grad()), expected.sh);
  EXPECT_EQ(values_of(view.screen), expected.screen);
}

TEST(RasterFunction, LossesMayLeaveImagesOut) {
  Fixture f;
  const SurfelTensors tensors = tensors_of(f.surfels);
  const ViewTensors view = f.function.draw(tensors, 0, f.camera, f.pose, false);
  EXPECT_FALSE(view.distortion.defined());
  view.alpha.sum().backward();
  EXPECT_GT(tensors.opacity_logit.grad().abs().sum().item<float>(), 0.0F);
  EXPECT_EQ(tensors.sh.grad().abs().sum().item<float>(), 0.0F);
}

TEST(RasterFunction, OneViewAtATime) {
  Fixture f;
  const SurfelTensors tensors = tensors_of(f.surfels);
  const ViewTensors first = f.function.draw(tensors, 0, f.camera, f.pose, false);
  const ViewTensors second = f.function.draw(tensors, 0, f.camera, f.pose, false);
  EXPECT_THROW(first.alpha.sum().backward(), core::ContractViolation);
  EXPECT_NO_THROW(second.alpha.sum().backward());
}

TEST(RasterFunction, RefusesOtherShapes) {
  SurfelTensors tensors = tensors_of(Fixture().surfels);
  tensors.log_scale = tensors.log_scale.slice(0, 0, 5);
  EXPECT_THROW((void)parameters_of(tensors, 0), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::reconstruction::internal
