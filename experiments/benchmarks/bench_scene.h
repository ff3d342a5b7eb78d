#pragma once

/// @file
/// Scenes and camera paths for render benchmarks: the standard room, a bundle, or a bare PLY.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frames.h"
#include "core/scene_bundle.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::experiments::benchmarks {

struct BenchSceneOptions {
  std::string scene = "room";  ///< "room", a bundle folder or a .ply file.
  int surfels = 1'000'000;     ///< Of one room.
  double spread = 1.0;
  int rooms = 1;
  std::uint64_t seed = 7;
  int views = 16;
  double hfov_deg = 70.0;  ///< Of bundles and files; the room has its own camera.
  bool features = false;   ///< Of the room.
};

struct BenchScene {
  std::string name;  ///< With the parameters that made it.
  std::shared_ptr<const renderer::SurfelCloud> surfels;
  /// Label distributions of a bundle; nullptr: the surfels' own ids.
  std::shared_ptr<const renderer::PanopticField> labels;
  std::vector<core::SceneClass> classes;  ///< Of a bundle.
  std::vector<core::CameraPose> path;
  double focal_per_width = 0.0;  ///< Focal length over image width.

  [[nodiscard]] core::CameraIntrinsics camera(int width_px, int height_px) const;
};

/// Cameras: the room's ring; in a bundle, evenly spaced points of a walk over the navmesh at
/// the bundle's camera height, looking ahead; around a bare file, a ring within its extent.
/// @throws core::InputError for a scene that cannot be read.
[[nodiscard]] BenchScene load_bench_scene(const BenchSceneOptions& options);

}  // namespace segsim::experiments::benchmarks
