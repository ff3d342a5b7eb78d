#pragma once

/// @file
/// Camera poses in training: as recorded, moved a little by Adam.

#include <vector>

#include "core/frames.h"
#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/training/internal/pose_gradient.h"

namespace segsim::reconstruction::internal {

/// T * exp(motion): translation [m] and rotation vector [rad] in the axes of the camera.
[[nodiscard]] core::CameraPose moved(const core::CameraPose& T_world_camera,
                                     const glm::dvec3& translation_m,
                                     const glm::dvec3& rotation_rad);

class TrainingPoses {
 public:
  explicit TrainingPoses(std::vector<core::CameraPose> recorded);

  [[nodiscard]] const std::vector<core::CameraPose>& now() const { return now_; }
  /// One step of Adam for a view. @param rate_m, rate_rad  Length of a steady step.
  void step(std::size_t view, const CameraGradient& gradient, double rate_m, double rate_rad);
  /// Moves all poses as one, such that the cameras' mean place is as recorded, and so is, to
  /// first order, their mean rotation: the world stays where it was, as views that are not
  /// trained on see it.
  void keep_mean();

  void save(StateWriter& out) const;
  /// @throws core::InputError for another number of views.
  void load(const StateReader& in);

 private:
  std::vector<core::CameraPose> recorded_, now_;
  AdamTensor translation_, rotation_;  ///< [views, 3]: sums of the steps; double.
};

}  // namespace segsim::reconstruction::internal
