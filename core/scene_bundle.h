#pragma once

/// @file
/// Scene bundle: one folder with all that a trial needs to know about a place
/// (docs/bundle.md).
///
///     scene.yaml           this manifest
///     surfels.ply          surfels (official 2DGS layout + semantic_id, instance_id)
///     collision.ply        triangle mesh, world frame
///     navmesh.bin          Detour navigation mesh; labels.bin: see core/bundle_parts.h
///
/// World frame: metres, z up, floor at z = 0. A scene that nothing drives in lacks navmesh.bin
/// and perhaps collision.ply (core/bundle_parts.h says why): the manifest's names are then
/// empty.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <glm/vec3.hpp>

namespace segsim::core {

struct SceneClass {
  std::uint16_t id = 0;  ///< 0 is void and not listed.
  std::string name;  ///< Lower case, COCO's word where COCO has one: "couch", "dining table".
  bool thing = false;  ///< Countable objects have instances; stuff (wall, floor) has none.
};

struct SceneInstance {
  std::uint16_t id = 0;  ///< Unique in the scene; 0 is none.
  std::uint16_t class_id = 0;
  std::string name;  ///< As in the source, for example "ChairA_01_003".
  glm::dvec3 box_min_m{0.0}, box_max_m{0.0};  ///< World-aligned box of its surfels.
};

/// Where the world origin lies on the earth. The world frame is the tangent plane there,
/// turned by `yaw_rad`: east = x cos(yaw) - y sin(yaw).
struct GeodeticOrigin {
  double latitude_deg = 0.0, longitude_deg = 0.0, height_m = 0.0, yaw_rad = 0.0;
};

struct BundleFile {
  std::string name;  ///< Relative to the bundle folder.
  std::string sha256;
};

struct SceneManifest {
  std::string name;
  std::string created_by;     ///< Program version.
  std::string source;         ///< What it was reconstructed from, in words.
  std::string source_sha256;  ///< Of the source's listing; empty if unknown.
  GeodeticOrigin origin;
  double robot_radius_m = 0.0;  ///< That the navmesh was eroded by.
  double robot_height_m = 0.0;
  double camera_height_m = 0.0;  ///< Mast height that suits the capture.
  std::vector<SceneClass> classes;
  std::vector<SceneInstance> instances;
  BundleFile surfels, collision_mesh, navmesh;
  /// Reported by reconstruction: name, value; for example "frames_used", 187.
  std::vector<std::pair<std::string, double>> statistics;

  /// nullptr if there is none.
  [[nodiscard]] const SceneClass* find_class(const std::string& class_name) const;
  [[nodiscard]] const SceneClass* find_class(std::uint16_t class_id) const;
  [[nodiscard]] const SceneInstance* find_instance(std::uint16_t instance_id) const;
  /// Name of a class id; "void" for 0 and unknown ids.
  [[nodiscard]] std::string class_name(std::uint16_t class_id) const;
};

/// A manifest and the folder that it was read from.
struct SceneBundle {
  std::filesystem::path folder;
  SceneManifest manifest;
  std::string scene_sha256;  ///< Of scene.yaml, which contains the hashes of the other files.

  [[nodiscard]] std::filesystem::path surfels_file() const {
    return folder / manifest.surfels.name;
  }
  [[nodiscard]] std::filesystem::path collision_mesh_file() const {
    return folder / manifest.collision_mesh.name;
  }
  [[nodiscard]] std::filesystem::path navmesh_file() const {
    return folder / manifest.navmesh.name;
  }
};

/// Reads and checks a bundle.
/// @throws InputError naming the file and the reason: no scene.yaml, a newer version, a
/// missing file, a hash that differs, an unknown key, an instance of an unknown class.
[[nodiscard]] SceneBundle load_bundle(const std::filesystem::path& folder);

/// Writes scene.yaml, after hashing the files that it names, which must already lie in
/// `folder`.
void write_bundle_manifest(const std::filesystem::path& folder, SceneManifest manifest);

}  // namespace segsim::core
