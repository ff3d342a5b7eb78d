// Between Habitat's episodes and ours: frames, floors, lengths.
#include "experiments/episodes/habitat_episodes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <numbers>

#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "core/config.h"
#include "core/error.h"
#include "core/random.h"
#include "core/version.h"
#include "experiments/support/gzip_file.h"
#include "perception/data/class_map.h"

namespace segsim::experiments::episodes {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kSameFloor_m = 0.5;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The six goals of HM3D whose word differs from ours.
constexpr std::array<std::pair<const char*, const char*>, 3> kWords{{
    {"plant", "potted plant"},
    {"tv_monitor", "tv"},
    {"sofa", "couch"},
}};

/// From Habitat's frame to the world of a bundle, or to the source's own without one.
class Placement {
 public:
  explicit Placement(const core::SceneLevelling& levelling) : levelling_(levelling) {}

  [[nodiscard]] glm::dvec3 world(const glm::dvec3& p_habitat_m) const {
    return levelling_.R_world_source * source_from_habitat(p_habitat_m) +
           levelling_.p_world_source_m;
  }
  [[nodiscard]] double world_yaw_rad(const glm::dquat& R_habitat_agent) const {
    return turned(yaw_from_habitat(R_habitat_agent), levelling_.R_world_source);
  }
  [[nodiscard]] glm::dvec3 habitat(const glm::dvec3& p_world_m) const {
    return habitat_from_source(glm::conjugate(levelling_.R_world_source) *
                               (p_world_m - levelling_.p_world_source_m));
  }
  [[nodiscard]] glm::dquat habitat_rotation(double yaw_world_rad) const {
    return habitat_from_yaw(turned(yaw_world_rad, glm::conjugate(levelling_.R_world_source)));
  }

 private:
  /// Heading in the plan of the other frame.
  static double turned(double yaw_rad, const glm::dquat& R) {
    const glm::dvec3 ahead = R * glm::dvec3(std::cos(yaw_rad), std::sin(yaw_rad), 0.0);
    return std::atan2(ahead.y, ahead.x);
  }
  core::SceneLevelling levelling_;
};

const core::SceneClass& required_class(const core::SceneBundle& bundle,
                                       const std::string& class_name,
                                       const HabitatScene& scene) {
  const core::SceneClass* found = bundle.manifest.find_class(class_name);
  if (found != nullptr) return *found;
  std::vector<std::string> names;
  for (const core::SceneClass& c : bundle.manifest.classes) names.push_back(c.name);
  const std::string near = core::nearest_word(class_name, names);
  throw core::InputError::expected(
      scene.file.string(), "classes of " + bundle.folder.string(),
      "\"" + class_name + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
}

/// The instance of the bundle whose box is nearest to the goal's position; 0 without one.
std::uint16_t nearest_instance(const core::SceneManifest& manifest, std::uint16_t class_id,
                               const glm::dvec3& p_world_m) {
  std::uint16_t best = 0;
  double best_m = kInfinity;
  for (const core::SceneInstance& instance : manifest.instances) {
    if (instance.class_id != class_id) continue;
    const double distance_m = glm::distance(
        p_world_m, glm::clamp(p_world_m, instance.box_min_m, instance.box_max_m));
    if (distance_m >= best_m) continue;
    best_m = distance_m;
    best = instance.id;
  }
  return best;
}

/// View points of one category on one floor, as columns.
struct FloorGoals {
  std::vector<glm::dvec2> view_points_m;
  std::vector<std::uint16_t> instances;
  std::vector<float> ious;
  std::unique_ptr<const sim::DistanceField> distance;  ///< Once an episode needed it.
};

/// The goals of one category. A view point is placed and bound to its instance once, however
/// many episodes search it, and episodes that begin on one floor share what lies there.
class CategoryGoals {
 public:
  CategoryGoals(const HabitatScene& scene, const std::string& category,
                const Placement& placement, const std::optional<HabitatBinding>& binding);

  /// What an episode that begins at this height may end at.
  FloorGoals& on_floor_of(double start_y_m);
  void add_to(HabitatImportCounts& counts) const;

 private:
  struct Point {
    double y_m = 0.0;  ///< Height, in Habitat's frame.
    glm::dvec2 p_world_m{0.0};
    std::uint16_t instance = 0;
    float iou = 0.0F;
    bool on_a_floor = false;  ///< Of a start.
  };
  std::vector<Point> points_;  ///< In the file's order.
  std::vector<double> sorted_y_m_;
  /// By the range of sorted_y_m_ that is on the floor.
  std::map<std::pair<std::size_t, std::size_t>, FloorGoals> floors_;
};

CategoryGoals::CategoryGoals(const HabitatScene& scene, const std::string& category,
                             const Placement& placement,
                             const std::optional<HabitatBinding>& binding) {
  const core::SceneClass* scene_class =
      binding ? &required_class(*binding->bundle, class_of_habitat_category(category), scene)
              : nullptr;
  for (const HabitatGoal& goal : scene.goals.at(category)) {
    const std::uint16_t instance =
        binding ? nearest_instance(binding->bundle->manifest, scene_class->id,
                                   placement.world(goal.p_habitat_m))
                : static_cast<std::uint16_t>(std::clamp(goal.object_id, 0, 65535));
    for (const HabitatViewPoint& point : goal.view_points) {
      const double y_m = point.p_habitat_m.y;
      points_.push_back({y_m, glm::dvec2(placement.world(point.p_habitat_m)), instance,
                         static_cast<float>(point.iou), false});
      sorted_y_m_.push_back(y_m);
    }
  }
  std::sort(sorted_y_m_.begin(), sorted_y_m_.end());
}

FloorGoals& CategoryGoals::on_floor_of(double start_y_m) {
  const auto below = [&](double y_m) { return y_m - start_y_m < -kSameFloor_m; };
  const auto not_above = [&](double y_m) { return y_m - start_y_m <= kSameFloor_m; };
  const auto count_of = [&](const auto& leading) {
    const auto end = std::partition_point(sorted_y_m_.begin(), sorted_y_m_.end(), leading);
    return static_cast<std::size_t>(end - sorted_y_m_.begin());
  };
  const auto [found, is_new] =
      floors_.try_emplace({count_of(below), count_of(not_above)}, FloorGoals{});
  FloorGoals& floor = found->second;
  if (!is_new) return floor;
  for (Point& point : points_) {
    if (below(point.y_m) || !not_above(point.y_m)) continue;
    point.on_a_floor = true;
    floor.view_points_m.push_back(point.p_world_m);
    floor.instances.push_back(point.instance);
    floor.ious.push_back(point.iou);
  }
  return floor;
}

void CategoryGoals::add_to(HabitatImportCounts& counts) const {
  counts.view_points += static_cast<int>(points_.size());
  counts.view_points_of_other_floors += static_cast<int>(std::count_if(
      points_.begin(), points_.end(), [](const Point& point) { return !point.on_a_floor; }));
  counts.goal_sets +=
      static_cast<int>(std::count_if(floors_.begin(), floors_.end(), [](const auto& floor) {
        return !floor.second.view_points_m.empty();
      }));
}

double shortest_path_m(const sim::Episode& episode, const HabitatEpisode& from,
                       const Placement& placement,
                       const std::optional<HabitatBinding>& binding, FloorGoals& goals,
                       HabitatImportCounts& counts) {
  const bool floor_of_world =
      !binding || std::abs(placement.world(from.start_habitat_m).z) <= kSameFloor_m;
  if (goals.view_points_m.empty() || !floor_of_world) {
    ++counts.other_floor;
    return kInfinity;
  }
  if (!binding) return from.geodesic_m.value_or(kInfinity);
  if (binding->world->collision().collides(episode.start)) {
    ++counts.blocked_start;
    return kInfinity;
  }
  if (goals.distance == nullptr) {
    goals.distance = std::make_unique<const sim::DistanceField>(
        binding->world->distance_to(goals.view_points_m));
  }
  const double l_m = goals.distance->at({episode.start.x_m, episode.start.y_m});
  if (!std::isfinite(l_m)) ++counts.unreachable;
  return l_m;
}

Json json_vector(const glm::dvec3& p) { return Json::array({p.x, p.y, p.z}); }
Json json_rotation(const glm::dquat& R) { return Json::array({R.x, R.y, R.z, R.w}); }

/// A place from which an instance is seen, and how well.
struct GoalPoint {
  glm::dvec2 p_m{0.0};
  float iou = 0.0F;
};
/// Of one class, over all its episodes: each may see only some of the instances (on its own
/// island, say), but Habitat keeps one list for the scene.
struct ClassGoals {
  std::string class_name, first_episode;
  std::map<std::uint16_t, std::vector<GoalPoint>> points_of;  ///< By instance.
};

void add_goals(const sim::Episode& episode, ClassGoals& goals) {
  for (std::size_t k = 0; k < episode.view_points_m.size(); ++k) {
    std::vector<GoalPoint>& points = goals.points_of[episode.view_point_instance[k]];
    const glm::dvec2& p_m = episode.view_points_m[k];
    const bool known = std::any_of(points.begin(), points.end(),
                                   [&](const GoalPoint& other) { return other.p_m == p_m; });
    if (known) continue;
    points.push_back({p_m, episode.view_point_iou.empty() ? 0.0F : episode.view_point_iou[k]});
  }
}

/// Each instance with the view points that see it.
Json json_goals(const ClassGoals& of_class, const core::SceneBundle& bundle,
                const Placement& placement) {
  Json goals = Json::array();
  for (const auto& [id, points] : of_class.points_of) {
    const core::SceneInstance* instance = bundle.manifest.find_instance(id);
    if (instance == nullptr) {
      throw core::InputError::expected(of_class.first_episode,
                                       "instances of " + bundle.folder.string(),
                                       std::to_string(id));
    }
    const glm::dvec3 middle_m = 0.5 * (instance->box_min_m + instance->box_max_m);
    Json goal{{"position", json_vector(placement.habitat(middle_m))},
              {"radius", nullptr},
              {"object_id", id},
              {"object_name", instance->name},
              {"object_name_id", nullptr},
              {"object_category", habitat_category_of_class(of_class.class_name)},
              {"room_id", nullptr},
              {"room_name", nullptr},
              {"view_points", Json::array()}};
    for (const GoalPoint& point : points) {
      const core::Pose2 pose =
          sim::facing(point.p_m, instance->box_min_m, instance->box_max_m);
      const Json state{{"position", json_vector(placement.habitat({point.p_m, 0.0}))},
                       {"rotation", json_rotation(placement.habitat_rotation(pose.yaw_rad))}};
      goal["view_points"].push_back({{"agent_state", state}, {"iou", point.iou}});
    }
    goals.push_back(std::move(goal));
  }
  return goals;
}

Json json_episode(const sim::Episode& episode, int index, const std::string& scene_id,
                  const Placement& placement) {
  double straight_m = kInfinity;
  int nearest = -1;
  const glm::dvec2 start_m(episode.start.x_m, episode.start.y_m);
  for (std::size_t k = 0; k < episode.view_points_m.size(); ++k) {
    const double distance_m = glm::distance(episode.view_points_m[k], start_m);
    if (distance_m >= straight_m) continue;
    straight_m = distance_m;
    nearest = episode.view_point_instance[k];
  }
  Json info{{"geodesic_distance", nullptr},
            {"euclidean_distance", nullptr},
            {"closest_goal_object_id", nearest}};
  if (std::isfinite(episode.shortest_path_m)) {
    info["geodesic_distance"] = episode.shortest_path_m;
    info["euclidean_distance"] = straight_m;
  }
  return {{"episode_id", std::to_string(index)},
          {"scene_id", scene_id},
          {"scene_dataset_config", ""},
          {"additional_obj_config_paths", Json::array()},
          {"start_position", json_vector(placement.habitat({start_m, 0.0}))},
          {"start_rotation", json_rotation(placement.habitat_rotation(episode.start.yaw_rad))},
          {"info", info},
          {"goals", Json::array()},
          {"start_room", nullptr},
          {"shortest_paths", nullptr},
          {"object_category", habitat_category_of_class(episode.class_name)}};
}

}  // namespace

double yaw_from_habitat(const glm::dquat& R_habitat_agent) {
  const glm::dvec3 ahead = source_from_habitat(R_habitat_agent * glm::dvec3(0.0, 0.0, -1.0));
  return std::atan2(ahead.y, ahead.x);
}

glm::dquat habitat_from_yaw(double yaw_source_rad) {
  const double half_rad = 0.5 * (yaw_source_rad - 0.5 * std::numbers::pi);
  return {std::cos(half_rad), 0.0, std::sin(half_rad), 0.0};
}

std::string class_of_habitat_category(const std::string& category) {
  for (const auto& [habitat, ours] : kWords) {
    if (category == habitat) return ours;
  }
  return perception::normalised_name(category);
}

std::string habitat_category_of_class(const std::string& class_name) {
  for (const auto& [habitat, ours] : kWords) {
    if (class_name == ours) return habitat;
  }
  std::string category = class_name;
  std::replace(category.begin(), category.end(), ' ', '_');
  return category;
}

EpisodeSet episodes_from_habitat(const HabitatScene& scene, const std::string& split,
                                 const std::optional<HabitatBinding>& binding,
                                 std::uint64_t seed, HabitatImportCounts* counts) {
  const Placement placement(binding ? *binding->levelling : core::SceneLevelling{});
  HabitatImportCounts tally;
  EpisodeSet set;
  set.scene = scene.name;
  set.generator =
      "Habitat ObjectNav, split " + split + ", imported by segsim " + core::version();
  set.seed = seed;
  if (binding) {
    set.scene_sha256 = binding->bundle->scene_sha256;
    set.robot = binding->world->robot().name;
    set.navmesh_sha256 = navmesh_settings_hash(binding->world->robot());
  }
  std::map<std::string, CategoryGoals> goals_of;
  for (const HabitatEpisode& from : scene.episodes) {
    sim::Episode episode;
    // The id in the file may repeat; the index cannot.
    char index[16];
    std::snprintf(index, sizeof index, "%04d", from.index);
    episode.class_name = class_of_habitat_category(from.category);
    episode.id = scene.name + "/" + episode.class_name + "/" + index;
    episode.source = split + "/" + scene.name + "#" + std::to_string(from.index) + " id " +
                     from.episode_id + " sha256 " + from.sha256.substr(0, 16);
    const glm::dvec3 start_m = placement.world(from.start_habitat_m);
    episode.start = {start_m.x, start_m.y, placement.world_yaw_rad(from.R_habitat_start)};
    if (!goals_of.contains(from.category)) {
      goals_of.try_emplace(from.category, scene, from.category, placement, binding);
    }
    FloorGoals& goals = goals_of.at(from.category).on_floor_of(from.start_habitat_m.y);
    episode.view_points_m = goals.view_points_m;
    episode.view_point_instance = goals.instances;
    episode.view_point_iou = goals.ious;
    episode.shortest_path_m = shortest_path_m(episode, from, placement, binding, goals, tally);
    episode.seed = core::hash64(episode.id, seed);
    ++tally.episodes;
    set.episodes.push_back(std::move(episode));
  }
  for (const auto& [category, goals] : goals_of) goals.add_to(tally);
  if (counts != nullptr) *counts = tally;
  return set;
}

fs::path write_habitat(const fs::path& folder, const std::string& split,
                       const std::string& scene_id, const EpisodeSet& set,
                       const core::SceneBundle& bundle,
                       const core::SceneLevelling& levelling) {
  const Placement placement(levelling);
  const std::string scene_file = fs::path(scene_id).filename().string();
  Json category_ids = Json::object(), goals = Json::object(), episodes = Json::array();
  std::map<std::string, ClassGoals> goals_of;  // By category.
  for (const sim::Episode& episode : set.episodes) {
    if (!episode.phrase.empty()) {
      throw core::InputError::expected(episode.id, "goals that are classes, as ObjectNav has",
                                       "the phrase \"" + episode.phrase + "\"");
    }
    if (episode.view_point_instance.size() != episode.view_points_m.size()) {
      throw core::InputError::expected(episode.id, "view points that name their instance",
                                       "none (generate the set again)");
    }
    const std::string category = habitat_category_of_class(episode.class_name);
    if (!category_ids.contains(category)) {
      category_ids[category] = category_ids.size();
      goals_of[category] = {episode.class_name, episode.id, {}};
    }
    add_goals(episode, goals_of[category]);
    episodes.push_back(
        json_episode(episode, static_cast<int>(episodes.size()), scene_id, placement));
  }
  for (const auto& [category, id] : category_ids.items()) {
    goals[std::string(scene_file).append("_").append(category)] =
        json_goals(goals_of[category], bundle, placement);
  }
  const Json ids{{"category_to_task_category_id", category_ids},
                 {"category_to_scene_annotation_category_id", category_ids}};
  Json content{{"goals_by_category", goals}, {"episodes", episodes}};
  content.update(ids);
  Json top{{"episodes", Json::array()}};
  top.update(ids);
  fs::path file =
      folder / "content" / (scene_file.substr(0, scene_file.find('.')) + ".json.gz");
  support::write_gzip(file, content.dump());
  support::write_gzip(folder / (split + ".json.gz"), top.dump());
  return file;
}

}  // namespace segsim::experiments::episodes
