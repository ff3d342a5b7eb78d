#include "experiments/episodes.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"

namespace segsim::experiments {
namespace {

/// Counts labelled pixels as the robot's camera sees them.
class RobotEye {
 public:
  RobotEye(core::Renderer& renderer, const EpisodeRules& rules)
      : renderer_(renderer),
        camera_(rules.camera),
        T_robot_camera_(
            core::mast_camera(rules.camera_height_m, rules.camera_pitch_down_rad)) {}

  /// Renders the labels that the robot sees at `pose`.
  void look(const core::Pose2& pose) {
    const core::CameraPose T_world_camera =
        core::transform_from_pose2<core::frame::World>(pose) * T_robot_camera_;
    renderer_.render(T_world_camera, camera_, core::Channels::kLabels, frame_);
  }
  [[nodiscard]] int pixels_of_instance(std::uint16_t id) const {
    return static_cast<int>(
        std::count(frame_.instance.pixels().begin(), frame_.instance.pixels().end(), id));
  }
  [[nodiscard]] int pixels_of_class(std::uint16_t id) const {
    return static_cast<int>(
        std::count(frame_.semantic.pixels().begin(), frame_.semantic.pixels().end(), id));
  }

 private:
  core::Renderer& renderer_;
  core::CameraIntrinsics camera_;
  core::Transform<core::frame::Robot, core::frame::Camera> T_robot_camera_;
  core::Frame frame_;
};

/// Places from which the robot, turned to the object, sees enough of it.
std::vector<glm::dvec2> visible_view_points(const sim::World& world,
                                            const core::SceneInstance& instance,
                                            const EpisodeRules& rules, RobotEye& eye,
                                            EpisodeRejections& rejections) {
  const double image_px = static_cast<double>(rules.camera.width_px) * rules.camera.height_px;
  const int enough = std::max(rules.min_visible_pixels,
                              static_cast<int>(std::ceil(rules.min_visible_share * image_px)));
  std::vector<glm::dvec2> kept, tested;
  for (double radius_m = rules.view_radius_m; radius_m <= rules.max_view_radius_m + 1e-9;
       radius_m += rules.view_radius_step_m) {
    for (const glm::dvec2& place :
         sim::view_point_candidates(world, instance.box_min_m, instance.box_max_m, radius_m)) {
      // A wider ring contains the narrower one.
      if (std::find(tested.begin(), tested.end(), place) != tested.end()) continue;
      tested.push_back(place);
      ++rejections.view_points_tested;
      eye.look(sim::facing(place, instance.box_min_m, instance.box_max_m));
      if (eye.pixels_of_instance(instance.id) >= enough) kept.push_back(place);
    }
    if (!kept.empty()) break;
  }
  rejections.view_points_kept += static_cast<int>(kept.size());
  return kept;
}

/// One goal class that can be searched: where it is seen from, and starts in random order.
struct Search {
  std::string class_name;
  std::vector<glm::dvec2> view_points_m;
  std::vector<sim::SampledStart> starts;
};

void add(const sim::StartRejections& more, sim::StartRejections& total) {
  total.too_near += more.too_near;
  total.too_far += more.too_far;
  total.unreachable += more.unreachable;
  total.too_tight += more.too_tight;
  total.too_straight += more.too_straight;
}

/// Draws starts until `count` are left after the goal-in-view rule, or the scene has no more.
std::vector<sim::SampledStart> draw_starts(const sim::World& world, const Search& search,
                                           std::uint16_t class_id, int count,
                                           const EpisodeRules& rules, RobotEye& eye,
                                           EpisodeRejections& rejections) {
  constexpr int kRounds = 6;
  sim::StartRules start_rules;
  start_rules.min_geodesic_m = rules.min_start_m;
  start_rules.max_geodesic_m = rules.max_start_m;
  start_rules.min_ratio = 1.0;  // Rooms are small; a straight way is a fair way.
  std::vector<sim::SampledStart> starts;
  for (int round = 0; round < kRounds && static_cast<int>(starts.size()) < count; ++round) {
    const std::uint64_t seed =
        core::hash64(search.class_name + "/" + std::to_string(round), rules.seed);
    sim::StartRejections refused;
    const std::vector<sim::SampledStart> drawn = sim::sample_starts(
        world, search.view_points_m, 2 * count, seed, start_rules, &refused);
    add(refused, rejections.starts);
    for (const sim::SampledStart& start : drawn) {
      if (static_cast<int>(starts.size()) == count) break;
      if (!rules.allow_visible_start) {
        eye.look(start.pose);
        if (eye.pixels_of_class(class_id) >= rules.visible_start_pixels) {
          ++rejections.starts_goal_visible;
          continue;
        }
      }
      starts.push_back(start);
    }
    if (drawn.empty()) break;
  }
  return starts;
}

std::string episode_id(const std::string& scene, const std::string& class_name,
                       std::size_t n) {
  char number[32];
  std::snprintf(number, sizeof number, "%02zu", n);
  return scene + "/" + class_name + "/" + number;
}

/// Takes a start of each class in turn until there are enough, so that classes stay balanced.
std::vector<sim::Episode> deal(const std::string& scene_name,
                               const std::vector<Search>& searches,
                               const EpisodeRules& rules) {
  std::vector<sim::Episode> episodes;
  for (std::size_t turn = 0;; ++turn) {
    bool any = false;
    for (const Search& search : searches) {
      if (turn >= search.starts.size()) continue;
      if (static_cast<int>(episodes.size()) == rules.count) return episodes;
      any = true;
      sim::Episode episode;
      episode.id = episode_id(scene_name, search.class_name, turn);
      episode.class_name = search.class_name;
      episode.start = search.starts[turn].pose;
      episode.view_points_m = search.view_points_m;
      episode.shortest_path_m = search.starts[turn].geodesic_m;
      episode.seed = core::hash64(episode.id, rules.seed);
      episodes.push_back(std::move(episode));
    }
    if (!any) return episodes;
  }
}

}  // namespace

std::string rules_hash(const EpisodeRules& r, const std::string& robot) {
  std::string text = robot;
  for (const std::string& goal : r.goals) text += "|" + goal;
  const double numbers[] = {static_cast<double>(r.count),
                            static_cast<double>(r.camera.width_px),
                            static_cast<double>(r.camera.height_px),
                            r.camera.fx_px,
                            r.camera.fy_px,
                            r.camera.cx_px,
                            r.camera.cy_px,
                            r.camera_height_m,
                            r.camera_pitch_down_rad,
                            r.view_radius_m,
                            r.view_radius_step_m,
                            r.max_view_radius_m,
                            static_cast<double>(r.min_visible_pixels),
                            r.min_visible_share,
                            r.min_start_m,
                            r.max_start_m,
                            r.allow_visible_start ? 1.0 : 0.0,
                            static_cast<double>(r.visible_start_pixels)};
  for (const double number : numbers) {
    char field[40];
    std::snprintf(field, sizeof field, "|%.17g", number);
    text += field;
  }
  return core::sha256_hex(text + "|" + std::to_string(r.seed));
}

EpisodeSet generate_episodes(const std::string& scene_name, const core::SceneBundle& bundle,
                             const sim::World& world, core::Renderer& renderer,
                             const EpisodeRules& rules) {
  EpisodeSet set;
  set.scene = scene_name;
  set.scene_sha256 = bundle.scene_sha256;
  set.robot = world.robot().name;
  set.rules_sha256 = rules_hash(rules, set.robot);

  RobotEye eye(renderer, rules);
  std::vector<Search> searches;
  for (const std::string& goal : rules.goals) {
    const core::SceneClass* scene_class = bundle.manifest.find_class(goal);
    Search search{goal, {}, {}};
    bool any_instance = false;
    for (const core::SceneInstance& instance : bundle.manifest.instances) {
      if (scene_class == nullptr || instance.class_id != scene_class->id) continue;
      any_instance = true;
      const std::vector<glm::dvec2> places =
          visible_view_points(world, instance, rules, eye, set.rejections);
      if (places.empty()) ++set.rejections.instances_not_visible;
      search.view_points_m.insert(search.view_points_m.end(), places.begin(), places.end());
    }
    if (!any_instance) ++set.rejections.goals_without_instance;
    if (search.view_points_m.empty()) continue;
    search.starts =
        draw_starts(world, search, scene_class->id, rules.count, rules, eye, set.rejections);
    searches.push_back(std::move(search));
  }
  set.episodes = deal(scene_name, searches, rules);
  if (set.episodes.empty()) {
    std::string classes;
    for (const core::SceneClass& c : bundle.manifest.classes) {
      classes += (classes.empty() ? "" : ", ") + c.name;
    }
    throw core::InputError::expected(
        bundle.folder.string(), "a goal class with a visible instance and a start for it",
        std::to_string(set.rejections.goals_without_instance) +
            " goals without an instance, " +
            std::to_string(set.rejections.instances_not_visible) +
            " instances that no place sees; the scene has " + classes);
  }
  return set;
}

}  // namespace segsim::experiments
