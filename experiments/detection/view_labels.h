#pragma once

/// @file
/// A labelled data set made from a scene bundle: views where the robot can be, boxes tight
/// around what is visible, consistent over all views because they come from one 3-D model
/// (paper, "User Case").

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/scene_bundle.h"
#include "experiments/detection/label_consistency.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/scenes/view_sampler.h"
#include "perception/data/box_labels.h"
#include "perception/data/class_map.h"
#include "perception/data/dataset.h"
#include "sim/ground/robot.h"
#include "sim/ground/world.h"

namespace segsim::experiments::detection {

struct ViewLabelOptions {
  std::uint64_t seed = 1;
  int views = 200;  ///< At random places; 0 = along the drives only.
  core::CameraIntrinsics camera;
  double camera_height_m = 1.2;
  double camera_pitch_down_rad = 0.0;
  std::vector<std::string>
      class_names;  ///< Of the detector; objects of other classes get no box.
  double share_facing_object =
      0.85;  ///< Tried to look at an object, classes in turn; the rest anywhere.
  int min_wanted_pixels = 100;         ///< Of that object, or the view is dropped.
  double max_object_distance_m = 5.0;  ///< For views that face an object.
  double min_view_distance_m = 0.4;    ///< Median depth below this: the view stares at a wall.
  double max_invalid_share =
      0.35;  ///< Of pixels with alpha < 0.5: outside the reconstruction.
  scenes::ViewDistance near_duplicate;
  std::vector<scenes::Drive> drives;  ///< Those of this scene, or of any, are driven first.
  std::vector<glm::dvec2>
      avoid_m;  ///< Starts of evaluation episodes: no view within `avoid_radius_m` of them.
  double avoid_radius_m = 0.0;
  std::optional<perception::ClassMap> class_map;  ///< From the scene's names to `class_names`.
  /// Boxes of instances with less label agreement (label_consistency.h) are ignored.
  double min_label_agreement = 0.0;
  perception::BoxLabelOptions boxes;
  std::string prefix;  ///< Of image names, so that scenes can share a folder.
  bool show_progress = true;
  std::function<void()> on_view;  ///< Called after each random view, if it is set.
};

struct ViewLabels {
  perception::CocoDataset dataset;
  std::vector<InstanceConsistency> instances;
  int drive_views = 0;                ///< The first so many images; the others are random.
  int drive_views_refused = 0;        ///< Useless, alike or avoided.
  std::vector<std::string> unmapped;  ///< Thing classes of the scene that the map lacks.
};

/// Renders views of a bundle into `folder`/images/<prefix>NNNNN.png and returns their labels
/// (the caller writes the JSON, so that several scenes can share one). Deterministic in
/// `seed`. Visible fractions are measured by rendering each visible instance alone.
/// @return  Fewer than `views` random images if the scene has no more distinct views.
/// @throws core::InputError if the bundle has no labels or no room for the robot, or a drive
/// leaves the robot's free space.
[[nodiscard]] ViewLabels label_views(const core::SceneBundle& bundle,
                                     const sim::RobotModel& robot,
                                     const ViewLabelOptions& options,
                                     const std::filesystem::path& folder);

/// A bundle that is in memory already; what it points to outlives the call.
struct LabelledScene {
  const core::SceneBundle& bundle;
  const sim::World& world;  ///< For the robot.
  scenes::SceneSurfels surfels;
};

/// The same without loading anything.
[[nodiscard]] ViewLabels label_views(const LabelledScene& scene,
                                     const ViewLabelOptions& options,
                                     const std::filesystem::path& folder);

/// Appends `other` to `all`; class names must agree. Image ids are renumbered. The places are
/// known if those of both are.
void append_dataset(perception::CocoDataset& all, const perception::CocoDataset& other);

}  // namespace segsim::experiments::detection
