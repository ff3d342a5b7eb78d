#pragma once

/// @file
/// What version 2 added to a scene bundle (docs/bundle.md): who makes or inspects a bundle
/// needs it, and who wants label distributions; trials do not.
///
///     labels.bin   label distribution of every surfel (renderer/files/panoptic_field_file.h)
///
///     cameras.txt  where the recording's cameras were (core/camera_path.h)
///
/// A bundle of version 1 has none of this: it is read as one without distributions and
/// cameras, of unknown mesh source, and not levelled.

#include <filesystem>
#include <string>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "core/scene_bundle.h"

namespace segsim::core {

inline constexpr int kBundleVersion = 2;  ///< Written; 1 is read as well.
inline constexpr const char* kCamerasFileName = "cameras.txt";

/// How the bundle's world came from the source's: p_world = R p_source + p. The source is the
/// recording as it was opened, so its poses and annotations can follow.
struct SceneLevelling {
  glm::dquat R_world_source{1.0, 0.0, 0.0, 0.0};
  glm::dvec3 p_world_source_m{0.0};
};

struct BundleParts {
  int version = kBundleVersion;  ///< Of the file that was read.
  BundleFile labels;             ///< Name empty: surfels have their own ids alone.
  BundleFile cameras;            ///< Name empty: unknown.
  std::string mesh_source;       ///< Of collision.ply, in words; empty if unknown.
  SceneLevelling levelling;
};

/// @throws InputError as load_bundle(), which checks these parts as well.
[[nodiscard]] BundleParts load_bundle_parts(const std::filesystem::path& folder);

/// write_bundle_manifest() of scene_bundle.h with these parts; `version` is ignored.
void write_bundle_manifest(const std::filesystem::path& folder, SceneManifest manifest,
                           BundleParts parts);

}  // namespace segsim::core
