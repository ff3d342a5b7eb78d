#pragma once

/// @file
/// The tiny scene as a bundle whose labels can be corrected: with cameras, and on demand with
/// label distributions.

#include <filesystem>
#include <string>
#include <vector>

#include "core/bundle_parts.h"
#include "core/camera_path.h"
#include "core/scene_bundle.h"
#include "experiments/scenes/scene_surfels.h"
#include "renderer/files/panoptic_field_file.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {

inline constexpr std::uint16_t kCouchId = 1, kChairId = 2;
inline constexpr std::size_t kCouchView = 0, kChairView = 1;

/// Every surfel is its own class and instance by 0.7, and by 0.3 the floor, or the other
/// object. @param instances_have_classes  As where queries have classes.
inline renderer::PanopticField soft_field(const renderer::SurfelCloud& surfels,
                                          bool instances_have_classes) {
  renderer::PanopticField field;
  field.class_id = {1, 2, 3, 4};
  field.class_is_thing = {0, 0, 1, 1};
  field.instance_id = {1, 2};
  if (instances_have_classes) field.instance_class = {3, 4};
  field.classes = renderer::SparseScores(surfels.size(), 2);
  field.instances = renderer::SparseScores(surfels.size(), 2);
  using Entry = renderer::SparseScores::Entry;
  for (std::size_t s = 0; s < surfels.size(); ++s) {
    const auto own = static_cast<std::uint16_t>(surfels.semantic_id[s] - 1);
    const auto other = static_cast<std::uint16_t>(own == 0 ? 1 : 0);
    field.classes.set(s, 0.0F, std::vector<Entry>{{own, 0.7F}, {other, 0.3F}});
    const std::uint16_t instance = surfels.instance_id[s];
    if (instance == 0) {
      field.instances.set(s, 0.5F, {});
    } else {
      const auto mine = static_cast<std::uint16_t>(instance - 1);
      field.instances.set(
          s, 0.0F,
          std::vector<Entry>{{mine, 0.7F}, {static_cast<std::uint16_t>(1 - mine), 0.3F}});
    }
  }
  return field;
}

enum class LabelKind { kIds, kDistributions, kDistributionsWithClasses };

/// @return  The bundle's folder.
inline std::filesystem::path write_label_scene(const std::filesystem::path& folder,
                                               LabelKind kind = LabelKind::kIds) {
  const TinyScene scene;
  scene.write(folder);
  core::BundleParts parts = core::load_bundle_parts(folder);
  parts.cameras.name = core::kCamerasFileName;
  core::CameraPath cameras{core::CameraIntrinsics::from_fov(320, 240, 1.3), {}};
  cameras.views.push_back({core::look_at({1.2, 0.8, 1.4}, {2.9, -2.0, 0.4}), "couch"});
  cameras.views.push_back({core::look_at({-1.4, 0.0, 1.3}, {-3.1, 1.9, 0.4}), "chair"});
  core::write_camera_path(folder / parts.cameras.name, cameras);
  if (kind != LabelKind::kIds) {
    parts.labels.name = renderer::kPanopticFieldFileName;
    // Of the surfels as they are read.
    renderer::write_panoptic_field(
        folder / parts.labels.name,
        soft_field(scene.surfels(), kind == LabelKind::kDistributionsWithClasses));
  }
  core::write_bundle_manifest(folder, core::load_bundle(folder).manifest, parts);
  return folder;
}

}  // namespace segsim::experiments
