#include "experiments/episodes/episodes.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "core/random.h"
#include "core/version.h"
#include "sim/trial/goal_objects.h"

namespace segsim::experiments::episodes {
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
  /// Intersection over union of an instance's pixels with a box in the middle of the image,
  /// half as wide and half as high.
  [[nodiscard]] float centred_iou(std::uint16_t id) const {
    const int width = frame_.instance.width_px(), height = frame_.instance.height_px();
    int both = 0, either = (width / 2) * (height / 2);
    for (int j = 0; j < height; ++j) {
      const bool row = j >= height / 4 && j < height / 4 + height / 2;
      for (int i = 0; i < width; ++i) {
        if (frame_.instance(i, j) != id) continue;
        const bool inside = row && i >= width / 4 && i < width / 4 + width / 2;
        ++(inside ? both : either);
      }
    }
    return either > 0 ? static_cast<float>(both) / static_cast<float>(either) : 0.0F;
  }
  [[nodiscard]] int pixels_of(const sim::GoalObjects& goal) const {
    int pixels = 0;
    for (std::size_t k = 0; k < frame_.semantic.size(); ++k) {
      pixels += goal.holds(frame_.semantic.pixels()[k], frame_.instance.pixels()[k]) ? 1 : 0;
    }
    return pixels;
  }

 private:
  core::Renderer& renderer_;
  core::CameraIntrinsics camera_;
  core::Transform<core::frame::Robot, core::frame::Camera> T_robot_camera_;
  core::Frame frame_;
};

/// Where the objects of a class are seen from; columns of equal length.
struct ViewPoints {
  std::vector<glm::dvec2> place_m;
  std::vector<std::uint16_t> instance;
  std::vector<float> iou;
};

/// Adds the places from which the robot, turned to the object, sees enough of it.
/// @return  How many.
int add_view_points(const sim::World& world, const core::SceneInstance& instance,
                    const EpisodeRules& rules, RobotEye& eye, EpisodeRejections& rejections,
                    ViewPoints& points) {
  const double image_px = static_cast<double>(rules.camera.width_px) * rules.camera.height_px;
  const int enough = std::max(rules.min_visible_pixels,
                              static_cast<int>(std::ceil(rules.min_visible_share * image_px)));
  std::vector<glm::dvec2> tested;
  int kept = 0;
  for (double radius_m = rules.view_radius_m; radius_m <= rules.max_view_radius_m + 1e-9;
       radius_m += rules.view_radius_step_m) {
    for (const glm::dvec2& place : sim::view_point_candidates(
             world, instance.box_min_m, instance.box_max_m, radius_m, rules.view_lattice_m)) {
      // A wider ring contains the narrower one.
      if (std::find(tested.begin(), tested.end(), place) != tested.end()) continue;
      tested.push_back(place);
      ++rejections.view_points_tested;
      eye.look(sim::facing(place, instance.box_min_m, instance.box_max_m));
      if (eye.pixels_of_instance(instance.id) < enough) continue;
      ++kept;
      points.place_m.push_back(place);
      points.instance.push_back(instance.id);
      points.iou.push_back(eye.centred_iou(instance.id));
    }
    if (kept > 0) break;
  }
  rejections.view_points_kept += kept;
  return kept;
}

/// One goal that can be searched: where it is seen from, and starts in random order.
struct Search {
  PhraseGoal goal;   ///< Without a phrase and instances: all objects of the class.
  std::string name;  ///< In ids.
  ViewPoints seen_from;
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
                                           const sim::GoalObjects& goal, int count,
                                           const EpisodeRules& rules, RobotEye& eye,
                                           EpisodeRejections& rejections) {
  constexpr int kRounds = 6;
  sim::StartRules start_rules;
  start_rules.min_geodesic_m = rules.min_start_m;
  start_rules.max_geodesic_m = rules.max_start_m;
  start_rules.min_ratio = rules.min_ratio;
  std::vector<sim::SampledStart> starts;
  for (int round = 0; round < kRounds && static_cast<int>(starts.size()) < count; ++round) {
    const std::uint64_t seed =
        core::hash64(search.name + "/" + std::to_string(round), rules.seed);
    sim::StartRejections refused;
    const std::vector<sim::SampledStart> drawn = sim::sample_starts(
        world, search.seen_from.place_m, 2 * count, seed, start_rules, &refused);
    add(refused, rejections.starts);
    for (const sim::SampledStart& start : drawn) {
      if (static_cast<int>(starts.size()) == count) break;
      if (!rules.allow_visible_start) {
        eye.look(start.pose);
        if (eye.pixels_of(goal) >= rules.visible_start_pixels) {
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

std::string number_text(double number) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", number);
  return text;
}

std::string episode_id(const std::string& scene, const std::string& goal, std::size_t n) {
  char number[32];
  std::snprintf(number, sizeof number, "%02zu", n);
  return scene + "/" + goal + "/" + number;
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
      episode.id = episode_id(scene_name, search.name, turn);
      episode.class_name = search.goal.class_name;
      episode.phrase = search.goal.phrase;
      episode.goal_instances = search.goal.instances;
      episode.start = search.starts[turn].pose;
      episode.view_points_m = search.seen_from.place_m;
      episode.view_point_instance = search.seen_from.instance;
      episode.view_point_iou = search.seen_from.iou;
      episode.shortest_path_m = search.starts[turn].geodesic_m;
      episode.seed = core::hash64(episode.id, rules.seed);
      episodes.push_back(std::move(episode));
    }
    if (!any) return episodes;
  }
}

void check_island(const core::SceneBundle& bundle, const sim::World& world,
                  const EpisodeRules& rules) {
  const double needed_m2 =
      std::numbers::pi * rules.min_island_radius_m * rules.min_island_radius_m;
  const double found_m2 = world.free_space().area_m2(1);
  if (found_m2 >= needed_m2) return;
  char expected[96], found[64];
  std::snprintf(expected, sizeof expected,
                "room to drive of at least %.1f m2 (a disc of %g m)", needed_m2,
                rules.min_island_radius_m);
  std::snprintf(found, sizeof found, "%.1f m2 for %s", found_m2, world.robot().name.c_str());
  throw core::InputError::expected(bundle.folder.string(), expected, found);
}

/// The goals of the rules, without what is known of them yet.
std::vector<Search> searches_of(const EpisodeRules& rules) {
  std::vector<Search> searches;
  for (const std::string& name : rules.goals)
    searches.push_back({{{}, name, {}}, name, {}, {}});
  for (const PhraseGoal& goal : rules.phrases) {
    searches.push_back({goal, sim::phrase_word(goal.phrase), {}, {}});
  }
  return searches;
}

/// What the goals have to offer in the scene, one after another.
std::vector<Search> find_searches(const core::SceneBundle& bundle, const sim::World& world,
                                  const EpisodeRules& rules, RobotEye& eye,
                                  EpisodeRejections& rejections) {
  std::vector<Search> wanted = searches_of(rules), searches;
  core::Progress progress("episodes", static_cast<std::int64_t>(wanted.size()));
  std::int64_t done = 0;
  for (Search& search : wanted) {
    progress.update(done++, search.name);
    const sim::GoalObjects goal(bundle.manifest, search.goal.class_name,
                                search.goal.instances);
    bool any_instance = false;
    for (const core::SceneInstance& instance : bundle.manifest.instances) {
      if (!goal.holds(instance)) continue;
      any_instance = true;
      if (add_view_points(world, instance, rules, eye, rejections, search.seen_from) == 0) {
        ++rejections.instances_not_visible;
      }
    }
    if (!any_instance) ++rejections.goals_without_instance;
    if (search.seen_from.place_m.empty()) continue;
    search.starts = draw_starts(world, search, goal, rules.count, rules, eye, rejections);
    searches.push_back(std::move(search));
  }
  progress.update(done);
  progress.finish();
  return searches;
}

}  // namespace

std::string navmesh_settings_hash(const sim::RobotModel& robot) {
  const sim::NavmeshSettings n = sim::navmesh_settings_for(robot);
  std::string text = "free space " + number_text(sim::FreeSpace::kCell_m);
  for (const double number :
       {n.cell_m, n.cell_height_m, n.agent_height_m, n.agent_radius_m, n.max_climb_m,
        n.max_slope_deg, n.region_min_cells, n.region_merge_cells, n.edge_max_m,
        n.edge_max_error_cells, n.detail_sample_cells, n.detail_max_error_cells}) {
    text += "|" + number_text(number);
  }
  return core::sha256_hex(text);
}

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
  for (const double number : numbers) text += "|" + number_text(number);
  // Named, and only where they are set: sets from before these rules keep their hash.
  const EpisodeRules plain;
  const auto add = [&](const char* name, double value, double usual) {
    if (value != usual) text += std::string("|") + name + "=" + number_text(value);
  };
  add("view_lattice_m", r.view_lattice_m, plain.view_lattice_m);
  add("min_ratio", r.min_ratio, plain.min_ratio);
  add("min_island_radius_m", r.min_island_radius_m, plain.min_island_radius_m);
  for (const PhraseGoal& goal : r.phrases) {
    text += "|phrase=" + goal.phrase + "|" + goal.class_name;
    for (const std::uint16_t id : goal.instances) text += "," + std::to_string(id);
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

  set.generator = std::string("segsim ") + core::version();
  set.seed = rules.seed;
  set.navmesh_sha256 = navmesh_settings_hash(world.robot());
  set.viewer = EpisodeViewer{rules.camera, rules.camera_height_m, rules.camera_pitch_down_rad};

  check_island(bundle, world, rules);
  RobotEye eye(renderer, rules);
  const std::vector<Search> searches =
      find_searches(bundle, world, rules, eye, set.rejections);
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

}  // namespace segsim::experiments::episodes
