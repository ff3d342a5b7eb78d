#pragma once

/// @file
/// A labelled data set made from a scene bundle: views where the robot can be, boxes tight
/// around what is visible, consistent over all views because they come from one 3-D model
/// (paper, "User Case").

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/scene_bundle.h"
#include "perception/box_labels.h"
#include "perception/dataset.h"
#include "sim/robot.h"

namespace segsim::experiments {

struct ViewLabelOptions {
  std::uint64_t seed = 1;
  int views = 200;
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
  double near_duplicate_m = 0.3, near_duplicate_rad = 0.35;
  perception::BoxLabelOptions boxes;
  std::string prefix;  ///< Of image names, so that scenes can share a folder.
  bool show_progress = true;
};

/// Renders views of a bundle into `folder`/images/<prefix>NNNNN.png and returns their labels
/// (the caller writes the JSON, so that several scenes can share one). Deterministic in
/// `seed`. Visible fractions are measured by rendering each visible instance alone.
/// @return  The data set; fewer than `views` images if the scene has no more distinct views.
/// @throws core::InputError if the bundle has no labels or no room for the robot.
[[nodiscard]] perception::CocoDataset label_views(const core::SceneBundle& bundle,
                                                  const sim::RobotModel& robot,
                                                  const ViewLabelOptions& options,
                                                  const std::filesystem::path& folder);

/// Appends `other` to `all`; class names must agree. Image ids are renumbered.
void append_dataset(perception::CocoDataset& all, const perception::CocoDataset& other);

}  // namespace segsim::experiments
