#include "reconstruction/training/joint_training.h"

#include "core/check.h"
#include "reconstruction/training/training_views.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction {
namespace {

class TrainedViews final : public JointViews {
 public:
  TrainedViews(const TrainingSet& set, GeometryTrainer& trainer, const JointConfig& config,
               const GeometryDevice& device)
      : trainer_(trainer),
        config_(config),
        first_surfels_(trainer.surfels()),
        frozen_(make_training_views(set, first_surfels_, device, trainer.poses())) {}

  [[nodiscard]] std::int64_t count() const override { return frozen_->count(); }
  [[nodiscard]] const core::FrameMasks& masks(std::int64_t view) override {
    return frozen_->masks(view);
  }
  [[nodiscard]] const core::Image<float>& depth_m(std::int64_t view) override {
    return frozen_->depth_m(view);
  }
  [[nodiscard]] core::CameraIntrinsics intrinsics(std::int64_t view) const override {
    return frozen_->intrinsics(view);
  }
  [[nodiscard]] core::CameraPose T_world_camera(std::int64_t view) const override {
    return frozen_->T_world_camera(view);
  }
  /// Before training begins heads ask for the heaviest weights alone.
  [[nodiscard]] PixelWeights weights(std::int64_t view, std::span<const std::int32_t> pixels,
                                     int max_per_pixel, int slot) override {
    if (slot != 0 || max_per_pixel != 0) {
      return frozen_->weights(view, pixels, max_per_pixel, slot);
    }
    return trainer_.draw(static_cast<std::size_t>(view), pixels);
  }

  void move(std::span<const std::int32_t> pixels, const PixelWeights& weights,
            const GeometryGradient& gradient) override {
    trainer_.step_with(pixels, weights, gradient, config_);
  }
  [[nodiscard]] std::vector<glm::vec3> positions_m() const override {
    return trainer_.positions_m();
  }

 private:
  GeometryTrainer& trainer_;
  JointConfig config_;
  renderer::SurfelCloud first_surfels_;
  std::unique_ptr<PanopticViews> frozen_;
};

}  // namespace

std::unique_ptr<JointViews> make_joint_views(const TrainingSet& set, GeometryTrainer& trainer,
                                             const JointConfig& config,
                                             const GeometryDevice& device) {
  return std::make_unique<TrainedViews>(set, trainer, config, device);
}

}  // namespace segsim::reconstruction
