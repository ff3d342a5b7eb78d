#pragma once

/// @file
/// How consistent the labels of one object are over its views. Labels from one 3-D model agree
/// with each other by construction, also where the model is wrong: these numbers show where.
///
///     label agreement   share of the object's pixels that carry its own class, all views
///     views that differ views in which most of its pixels carry another class
///     extent overlap    IoU of the labelled box with the projected 3-D box of the object,
///     over
///                       views in which it is whole (not truncated, not occluded)
///     size ratio        root of (labelled area / projected area) in those views: its median
///     and
///                       the spread between the quartiles, which floaters and merged objects
///                       enlarge

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/scene_bundle.h"
#include "perception/data/labeled_box.h"

namespace segsim::experiments::detection {

struct InstanceConsistency {
  std::string scene, name, class_name;  ///< Class as the scene has it.
  int instance_id = 0;
  int views = 0;  ///< In which it is labelled, ignored ones included.
  int ignored_views = 0;
  int differing_views = 0;
  double label_agreement = 1.0;  ///< [0, 1].
  int whole_views = 0;
  double extent_overlap = -1.0;  ///< Median; -1 without whole views.
  double size_ratio = -1.0, size_ratio_spread = -1.0;
};

/// Box around the projection of a world-aligned box, cut at the image; nullopt if it is not
/// wholly before the camera or outside the image.
[[nodiscard]] std::optional<core::BoxPx> projected_box(const core::SceneInstance& instance,
                                                       const core::CameraPose& T_world_camera,
                                                       const core::CameraIntrinsics& camera);

/// Collects views of one scene.
class LabelConsistency {
 public:
  explicit LabelConsistency(const core::SceneManifest& manifest) : manifest_(manifest) {}

  /// @param frame  With labels.  @param boxes  Made from it; LabeledBox::instance_id is set.
  void add(const core::Frame& frame, const std::vector<perception::LabeledBox>& boxes);

  /// Ascending by instance id.
  [[nodiscard]] std::vector<InstanceConsistency> result() const;

 private:
  struct Record {
    int views = 0, ignored_views = 0, differing_views = 0;
    std::int64_t pixels = 0, own_pixels = 0;
    std::vector<double> overlaps, ratios;
  };
  const core::SceneManifest& manifest_;
  std::map<int, Record> records_;
};

}  // namespace segsim::experiments::detection
