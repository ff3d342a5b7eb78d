#pragma once

/// @file
/// What version 2 added to a scene bundle (docs/bundle.md): who makes or inspects a bundle
/// needs it, and who wants label distributions; trials do not.
///
///     labels.bin   label distribution of every surfel (renderer/files/panoptic_field_file.h)
///
///     cameras.txt  where the recording's cameras were (core/camera_path.h)
///
///     label_edits_*.bin  labels set by hand (renderer/files/label_edits.h); version 4
///
/// A bundle of version 1 has none of this: it is read as one without distributions and
/// cameras, of unknown mesh source, and not levelled.
///
/// A scene in which nothing can drive is written all the same, for rendering and labels only,
/// as version 3: it has no navmesh.bin and says why, and its floor is at z = 0 only if one was
/// found.

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "core/scene_bundle.h"

namespace segsim::core {

inline constexpr int kBundleVersion = 2;  ///< Written; 1 is read as well.
/// Written where nothing can drive, so that a program which knows only scenes to drive in says
/// that it needs a newer one.
inline constexpr int kRenderingOnlyVersion = 3;
/// Written where labels were set by hand, so that a program which would overlook them says the
/// same; such a bundle may be for rendering only as well.
inline constexpr int kEditedLabelsVersion = 4;
inline constexpr const char* kCamerasFileName = "cameras.txt";

/// How the bundle's world came from the source's: p_world = R p_source + p. The source is the
/// recording as it was opened, so its poses and annotations can follow.
struct SceneLevelling {
  glm::dquat R_world_source{1.0, 0.0, 0.0, 0.0};
  glm::dvec3 p_world_source_m{0.0};
};

/// A level disc on the floor with nothing above it up to some height.
struct FreeDisc {
  glm::dvec2 center_m{0.0};  ///< World.
  double radius_m = 0.0;
};

/// Why nothing drives in a scene whose bundle is for rendering and labels only.
struct RenderingOnly {
  std::string reason;                 ///< One line.
  std::string robot;                  ///< For which room was looked for.
  std::optional<FreeDisc> free_disc;  ///< The largest, up to that robot's height.
  std::vector<std::string> fitting;   ///< Built-in robots that find room.

  /// Reason, disc and robots in one line.
  [[nodiscard]] std::string text() const;
};

struct BundleParts {
  int version = kBundleVersion;  ///< Of the file that was read.
  BundleFile labels;             ///< Name empty: surfels have their own ids alone.
  BundleFile cameras;            ///< Name empty: unknown.
  BundleFile label_edits;        ///< Name empty: no label was set by hand.
  std::string mesh_source;       ///< Of collision.ply, in words; empty if unknown.
  SceneLevelling levelling;
  std::optional<RenderingOnly> rendering_only;  ///< nullopt: a robot can drive there.
};

/// @throws InputError as load_bundle(), which checks these parts as well.
[[nodiscard]] BundleParts load_bundle_parts(const std::filesystem::path& folder);

/// @throws InputError with the reason, if the bundle is for rendering and labels only.
void require_drivable(const SceneBundle& bundle);

/// write_bundle_manifest() of scene_bundle.h with these parts; `version` is ignored. Where
/// nothing can drive, the manifest names no navmesh, and a collision mesh only if there is
/// one.
void write_bundle_manifest(const std::filesystem::path& folder, SceneManifest manifest,
                           BundleParts parts);

}  // namespace segsim::core
