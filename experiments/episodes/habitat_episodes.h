#pragma once

/// @file
/// Habitat's ObjectNav episode files, read and written (format: habitat-lab 0fb6f43,
/// datasets/object_nav/object_nav_dataset.py):
///
///     <split>/<split>.json.gz              classes, often no episode
///     <split>/content/<scene>.json.gz      episodes and goals_by_category of one scene
///
/// and two benchmarks that extend them: HM3D-OVON (naokiyokoyama/ovon), whose goals have
/// children categories and whose objects have names for ids, and GOAT-Bench
/// (Ram81/goat-bench), whose episodes are lists of tasks. A task that names a category is an
/// episode here, from the start of its list; those that describe an object or show its picture
/// are counted and left out.
///
/// Habitat's frame has y up; its agent looks along -z. Ours has z up, the robot looks along
/// +x:
///
///     (x, y, z)_source = (x, -z, y)_habitat,    yaw_source = angle about +y + 90 degrees
///
/// which is how worlds/mesh/mesh_import.h turns a mesh with y up. A bundle that was levelled
/// moved its source; its transform is applied as well.

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "core/bundle_parts.h"
#include "core/frames.h"
#include "experiments/episodes/episodes.h"

namespace segsim::experiments::episodes {

[[nodiscard]] inline glm::dvec3 source_from_habitat(const glm::dvec3& p_habitat_m) {
  return {p_habitat_m.x, -p_habitat_m.z, p_habitat_m.y};
}
[[nodiscard]] inline glm::dvec3 habitat_from_source(const glm::dvec3& p_source_m) {
  return {p_source_m.x, p_source_m.z, -p_source_m.y};
}
/// Heading of an agent with this rotation (body to Habitat's frame) in the source frame.
[[nodiscard]] double yaw_from_habitat(const glm::dquat& R_habitat_agent);
/// An agent that stands upright with this heading.
[[nodiscard]] glm::dquat habitat_from_yaw(double yaw_source_rad);

struct HabitatViewPoint {
  glm::dvec3 p_habitat_m{0.0};
  glm::dquat R_habitat_agent{1.0, 0.0, 0.0, 0.0};
  double iou = 0.0;  ///< As in the file; HM3D's exceed 1.
};

struct HabitatGoal {
  int object_id = -1;
  std::string object_name;
  glm::dvec3 p_habitat_m{0.0};
  std::vector<HabitatViewPoint> view_points;
};

struct HabitatEpisode {
  std::string episode_id;  ///< Of the file; not always unique. "7/2": third task of episode 7.
  int index = 0;           ///< In its file; Habitat's loader makes it the id.
  std::string sha256;      ///< Of the episode as written in the file.
  std::string scene_id;
  std::string category;
  glm::dvec3 start_habitat_m{0.0};
  glm::dquat R_habitat_start{1.0, 0.0, 0.0, 0.0};
  std::optional<double> geodesic_m, euclidean_m;  ///< As in the file.
};

struct HabitatScene {
  std::string name;  ///< "TEEsavR23oF" of ".../00800-TEEsavR23oF/TEEsavR23oF.basis.glb".
  std::string scene_id;
  std::filesystem::path file;
  std::map<std::string, std::vector<HabitatGoal>> goals;  ///< By category.
  std::vector<HabitatEpisode> episodes;                   ///< In the file's order.
  int other_tasks = 0;  ///< Of GOAT-Bench, by description or picture.
};

struct HabitatDataset {
  std::string split;                 ///< Name of the file without its endings.
  std::vector<HabitatScene> scenes;  ///< By name.
};

/// @param file  A split's file (its content/ folder is read as well) or one content file.
/// @throws core::InputError with the place in the file: no gzip, no JSON, a missing key, a
/// category without a goal, no episode at all.
[[nodiscard]] HabitatDataset read_habitat(const std::filesystem::path& file);

/// Our word for one of Habitat's goal categories: "tv_monitor" -> "tv".
[[nodiscard]] std::string class_of_habitat_category(const std::string& category);
/// The reverse.
[[nodiscard]] std::string habitat_category_of_class(const std::string& class_name);

/// The bundle that an imported scene is bound to; pointers outlive the call.
struct HabitatBinding {
  const core::SceneBundle* bundle = nullptr;
  const core::SceneLevelling* levelling = nullptr;
  const sim::World* world = nullptr;
};

/// What became of imported episodes.
struct HabitatImportCounts {
  int episodes = 0, other_floor = 0, unreachable = 0, blocked_start = 0;
  int view_points = 0;                  ///< Of the goals that episodes search, each once.
  int view_points_of_other_floors = 0;  ///< Of these, on the floor of no start.
  int goal_sets = 0;  ///< Different sets of view points: a category on the floor of a start.
};

/// One scene's episodes in our form. A trial knows one floor: that of the start (0.5 m). Goals
/// that cannot be reached are kept with l = infinity, so that runs count them as infeasible.
/// With a binding, l is that of our robot; without one it is Habitat's.
/// @throws core::InputError if the bundle lacks a class that is searched for.
[[nodiscard]] EpisodeSet episodes_from_habitat(const HabitatScene& scene,
                                               const std::string& split,
                                               const std::optional<HabitatBinding>& binding,
                                               std::uint64_t seed,
                                               HabitatImportCounts* counts = nullptr);

/// Writes `folder`/<split>.json.gz and `folder`/content/<scene>.json.gz.
/// @param scene_id  As Habitat is to find the scene's mesh.
/// @return  The content file.
std::filesystem::path write_habitat(const std::filesystem::path& folder,
                                    const std::string& split, const std::string& scene_id,
                                    const EpisodeSet& set, const core::SceneBundle& bundle,
                                    const core::SceneLevelling& levelling);

}  // namespace segsim::experiments::episodes
