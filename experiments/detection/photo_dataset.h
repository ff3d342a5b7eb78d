#pragma once

/// @file
/// Real photographs with boxes to evaluate on: frames of a recording, labelled by its
/// annotated 3-D boxes.
///
/// Every pixel's ray is cut with every annotated box (or its finer parts); the nearest one is
/// seen there, unless the measured depth says that something else is nearer or that the ray
/// flies on behind it. Where the depth camera saw nothing (black chairs) the boxes alone
/// decide. Boxes include air, so these labels are looser than those of rendered views.

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "perception/data/box_labels.h"
#include "perception/data/dataset.h"
#include "reconstruction/datasets/box_annotation.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::detection {

struct PhotoOptions {
  std::vector<std::string>
      class_names;  ///< Objects of other classes only hide what is behind.
  int frame_step = 8;
  double depth_slack_m = 0.15;  ///< Between measured depth and box: annotation, noise, drift.
  perception::BoxLabelOptions boxes;
};

/// What the boxes say about one picture.
struct PhotoLabels {
  core::Image<std::uint16_t> instance;  ///< Annotated box seen at a pixel, 0 = none.
  core::Image<float> depth_m;           ///< Where the ray enters it, along +z; NaN = none.
  std::map<std::uint16_t, double> visible_fraction;
};
[[nodiscard]] PhotoLabels cast_boxes(const reconstruction::RgbdFrame& frame,
                                     const core::CameraIntrinsics& camera,
                                     const std::vector<reconstruction::AnnotatedBox>& boxes,
                                     double depth_slack_m);

/// Writes every `frame_step`-th frame as `folder`/images/NAME.png, and `folder`/labels.json.
/// Objects that are not annotated with care (`AnnotatedBox::core`) are ignored.
/// @return  The JSON file.
/// @throws core::InputError for a broken recording or annotation.
std::filesystem::path write_photo_dataset(const reconstruction::RgbdSequence& sequence,
                                          const reconstruction::BoxAnnotation& annotation,
                                          const PhotoOptions& options,
                                          const std::filesystem::path& folder);

}  // namespace segsim::experiments::detection
