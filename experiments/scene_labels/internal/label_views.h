#pragma once

/// @file
/// Views of the scene with its labels, for the page.

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <glm/vec3.hpp>

#include "core/camera_path.h"
#include "core/render.h"
#include "experiments/scenes/scene_surfels.h"

namespace segsim::experiments::scene_labels::internal {

/// World frame, z up; no roll.
struct FreeCamera {
  glm::dvec3 p_m{0.0, 0.0, 1.2};
  double yaw_rad = 0.0;         ///< 0 = +x, counter-clockwise.
  double pitch_down_rad = 0.0;  ///< > 0: towards the floor.
};

/// A recording's camera, or a free one.
struct ViewRequest {
  std::optional<std::size_t> camera;  ///< Index in cameras.txt.
  FreeCamera free;                    ///< If `camera` is not given.
  int width_px = 640;
  bool operator==(const ViewRequest& other) const;
};
inline constexpr int kNarrowest_px = 64, kWidest_px = 1280;
inline constexpr double kFreeFov_deg = 70.0;  ///< Horizontal.

/// What lies behind a pixel.
struct PickedPixel {
  std::uint16_t class_id = 0, instance_id = 0;
  std::optional<glm::dvec3> p_m;  ///< World; nullopt: nothing is there.
};

/// The camera as a free one, its roll left out.
[[nodiscard]] FreeCamera free_camera(const core::CameraPose& T_world_camera);

/// Not for several threads at once.
class LabelViews {
 public:
  /// @param cameras  Of the recording; may be empty.
  explicit LabelViews(core::CameraPath cameras) : cameras_(std::move(cameras)) {}

  [[nodiscard]] const core::CameraPath& cameras() const { return cameras_; }
  /// Draws this scene from now on.
  void set_scene(const scenes::SceneSurfels& scene);

  /// @throws core::InputError for a camera that is not there, or a width out of range.
  [[nodiscard]] std::string jpeg(const ViewRequest& view);
  /// Little-endian: u32 width, u32 height, then runs of pixels, row by row: u16 instance, u16
  /// class, u16 count.
  [[nodiscard]] std::string ids(const ViewRequest& view);
  /// @throws core::InputError also for a pixel beyond the image.
  [[nodiscard]] PickedPixel pick(const ViewRequest& view, int x_px, int y_px);

 private:
  const core::Frame& frame(const ViewRequest& view);

  core::CameraPath cameras_;
  std::unique_ptr<core::Renderer> renderer_;
  core::Frame frame_;
  std::optional<ViewRequest> drawn_;  ///< What frame_ shows.
};

}  // namespace segsim::experiments::scene_labels::internal
