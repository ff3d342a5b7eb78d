#include "reconstruction/training/training_views.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "core/check.h"
#include "reconstruction/training/internal/raster_function.h"
#include "reconstruction/training/raw_surfels.h"

namespace segsim::reconstruction {
namespace {

using internal::Tensor;

/// Draws a view only for its weights: images are memory that is written and not read.
class TrainingViews final : public PanopticViews {
 public:
  TrainingViews(const TrainingSet& set, const renderer::SurfelCloud& surfels,
                const GeometryDevice& device, std::vector<core::CameraPose> poses)
      : set_(set),
        poses_(std::move(poses)),
        device_(device),
        memory_(trains_on_gpu(device) ? at::Device(torch::kCUDA, 0) : at::Device(torch::kCPU)),
        surfels_(tensors_of(raw_surfels(surfels, 0))) {
    SEGSIM_CHECK(poses_.empty() || poses_.size() == set.training.size(),
                 std::to_string(poses_.size()) + " poses");
    for (const TrainingView& view : set.training) {
      SEGSIM_CHECK(!view.masks.semantic.empty(), "view " + view.name + " without masks");
    }
    const std::int64_t height = set.intrinsics.height_px, width = set.intrinsics.width_px;
    const auto options = torch::TensorOptions().device(memory_);
    color_ = torch::empty({height, width, 3}, options);
    normal_ = torch::empty({height, width, 3}, options);
    for (Tensor& image : flat_) image = torch::empty({height, width}, options);
    drawn_depth_m_.resize(set.training.size());
  }

  [[nodiscard]] std::int64_t count() const override {
    return static_cast<std::int64_t>(set_.training.size());
  }
  [[nodiscard]] const core::FrameMasks& masks(std::int64_t view) override {
    return at(view).masks;
  }
  [[nodiscard]] const core::Image<float>& depth_m(std::int64_t view) override {
    const core::Image<float>& recorded_m = at(view).depth_m;
    if (!recorded_m.empty()) return recorded_m;
    core::Image<float>& drawn_m = drawn_depth_m_[static_cast<std::size_t>(view)];
    if (drawn_m.empty()) drawn_m = draw_depth(view);
    return drawn_m;
  }
  [[nodiscard]] core::CameraIntrinsics intrinsics(std::int64_t) const override {
    return set_.intrinsics;
  }
  [[nodiscard]] core::CameraPose T_world_camera(std::int64_t view) const override {
    return poses_.empty() ? at(view).T_world_camera
                          : poses_.at(static_cast<std::size_t>(view));
  }

  [[nodiscard]] PixelWeights weights(std::int64_t view, std::span<const std::int32_t> pixels,
                                     int max_per_pixel, int slot) override {
    SEGSIM_CHECK(slot == 0 || slot == 1, std::to_string(slot));
    auto& rasterizer = rasterizers_[static_cast<std::size_t>(slot)];
    if (!rasterizer) rasterizer = make_training_rasterizer(device_);
    draw(*rasterizer, view);
    const Tensor listed = internal::device_tensor(
        std::vector<std::int32_t>(pixels.begin(), pixels.end()), torch::kInt32, memory_);
    return rasterizer->weights(listed.data_ptr<std::int32_t>(), listed.numel(), max_per_pixel);
  }

 private:
  /// Fills the images.
  void draw(DifferentiableRasterizer<float>& rasterizer, std::int64_t view) {
    TrainingImages<float> images;
    images.width_px = set_.intrinsics.width_px;
    images.height_px = set_.intrinsics.height_px;
    images.rgb = color_.data_ptr<float>();
    images.normal = normal_.data_ptr<float>();
    images.depth_m = flat_[0].data_ptr<float>();
    images.alpha = flat_[1].data_ptr<float>();
    images.median_m = flat_[2].data_ptr<float>();
    rasterizer.forward(internal::parameters_of(surfels_, 0), set_.intrinsics,
                       T_world_camera(view), images, nullptr);
  }

  /// What the surfels say; NaN where they cover less than half of the pixel.
  [[nodiscard]] core::Image<float> draw_depth(std::int64_t view) {
    if (!depth_rasterizer_) depth_rasterizer_ = make_training_rasterizer(device_);
    draw(*depth_rasterizer_, view);
    const Tensor depth_m =
        at::where(flat_[1].gt(0.5), flat_[0] / flat_[1], at::full_like(flat_[0], NAN)).cpu();
    core::Image<float> image(set_.intrinsics.width_px, set_.intrinsics.height_px);
    std::copy_n(depth_m.data_ptr<float>(), image.size(), image.data());
    return image;
  }

  [[nodiscard]] const TrainingView& at(std::int64_t view) const {
    return set_.training.at(static_cast<std::size_t>(view));
  }

  [[nodiscard]] internal::SurfelTensors tensors_of(const RawSurfels& raw) const {
    const auto tensor = [&](const std::vector<float>& values,
                            const std::vector<std::int64_t>& shape) {
      return internal::device_tensor(values, torch::kFloat32, memory_).view(shape);
    };
    return {tensor(raw.position_m, {-1, 3}), tensor(raw.log_scale, {-1, 2}),
            tensor(raw.rotation, {-1, 4}), tensor(raw.opacity_logit, {-1}),
            tensor(raw.sh, {-1, 1, 3})};
  }

  const TrainingSet& set_;
  std::vector<core::CameraPose> poses_;
  GeometryDevice device_;
  at::Device memory_;
  internal::SurfelTensors surfels_;
  std::array<std::unique_ptr<DifferentiableRasterizer<float>>, 2> rasterizers_;
  std::unique_ptr<DifferentiableRasterizer<float>> depth_rasterizer_;
  std::vector<core::Image<float>>
      drawn_depth_m_;  ///< Of views that have none; when asked for.
  Tensor color_, normal_;
  std::array<Tensor, 3> flat_;
};

}  // namespace

std::unique_ptr<PanopticViews> make_training_views(const TrainingSet& set,
                                                   const renderer::SurfelCloud& surfels,
                                                   const GeometryDevice& device,
                                                   std::vector<core::CameraPose> poses) {
  return std::make_unique<TrainingViews>(set, surfels, device, std::move(poses));
}

}  // namespace segsim::reconstruction
