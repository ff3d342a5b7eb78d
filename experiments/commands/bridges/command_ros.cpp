// `segsim ros serve`: a robot in a scene as a node of ROS 2, without an experiment. It is one
// trial of a spec that is written here, so it has the parts and the rules of any other.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "core/scene_bundle.h"
#include "experiments/commands/bridges/bridge_commands.h"
#include "experiments/commands/bridges/bundle_spec.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/specs/spec.h"
#include "experiments/suites/layered_yaml.h"
#include "experiments/support/stop_signal.h"
#include "experiments/trials/trial_runner.h"
#include "experiments/trials/trial_viewer.h"
#include "ros/dds/transport.h"

namespace segsim::experiments::commands::bridges {
namespace {

namespace fs = std::filesystem;

struct ServeFlags : BundleSpec {
  ServeFlags() { arm = "ros2"; }

  fs::path work = "out/ros";
  std::vector<double> start;
  int domain = -1;
  std::string distro = "jazzy", cmd_vel = "twist", dds = "cyclone", dds_config;
  bool realtime = false, depth_mm = false, truth = false, map = false;
  double answer_s = 60.0, wait_s = 3600.0;
};

std::string policy_text(const ServeFlags& flags) {
  std::string text = "policy: {type: ros2, domain: " + std::to_string(flags.domain) +
                     ", distro: " + flags.distro + ", cmd_vel: " + flags.cmd_vel +
                     ", commands: " + (flags.realtime ? "newest" : "each") +
                     core::print(", answer_s: %g, start_s: %g", flags.answer_s, flags.wait_s) +
                     ", dds: " + flags.dds;
  if (flags.depth_mm) text += ", depth: 16uc1";
  if (flags.truth) text += ", truth: true";
  if (flags.map) text += ", map: true";
  if (flags.detector == "none") text += ", detections: false";
  if (!flags.dds_config.empty()) text += ", config: " + suites::yaml_scalar(flags.dds_config);
  return text + "}\n";
}

/// An experiment of one scene, one arm and one episode.
std::string spec_text(const ServeFlags& flags, const core::SceneManifest& scene) {
  return flags.text(scene) + policy_text(flags) +
         (flags.realtime ? "clock: {mode: realtime}\n" : "") + "pictures: false\n";
}

/// The robot's domain: the flag's, else ROS_DOMAIN_ID, else 0.
int domain_of(const ServeFlags& flags) {
  if (flags.domain >= 0) return flags.domain;
  const char* text = std::getenv("ROS_DOMAIN_ID");
  if (text == nullptr || *text == '\0') return 0;
  int domain = -1;
  if (!CLI::detail::lexical_cast(text, domain) || domain < 0 || domain > 232) {
    throw core::InputError::expected("ROS_DOMAIN_ID", "a whole number in [0, 232]",
                                     "\"" + std::string(text) + "\"");
  }
  return domain;
}

/// Where the robot is, on the progress line.
class ProgressViewer final : public trials::TrialViewer {
 public:
  explicit ProgressViewer(double limit_s)
      : progress_("robot [s]", static_cast<std::int64_t>(std::ceil(limit_s))) {}
  void begin(const drawing::TrialScene& /*scene*/,
             const std::vector<std::string>& /*detector_classes*/) override {}
  void add(const sim::TickRecord& tick, const core::Frame& /*frame*/,
           std::span<const core::Detection> /*detections*/,
           const core::PolicyView& /*view*/) override {
    images_ = static_cast<int>(tick.capture_index) + 1;
    progress_.update(
        tick.time_ns / core::kNsPerSecond,
        core::print("%d images, %.2f m/s, %.2f rad/s%s", images_, tick.command.forward_mps,
                    tick.command.turn_radps, tick.in_contact ? ", in contact" : ""));
  }
  void finish(const sim::TrialResult& /*result*/) override { progress_.finish(); }
  [[nodiscard]] int images() const { return images_; }

 private:
  core::Progress progress_;
  int images_ = 0;
};

/// The episode that was generated, from where the flags say.
sim::Episode episode_of(const ServeFlags& flags, const trials::LoadedScene& scene) {
  if (scene.episodes.episodes.empty()) {
    throw core::InputError::expected("--goal " + flags.goals.front(),
                                     "a goal that the robot can reach and see", "none");
  }
  sim::Episode episode = scene.episodes.episodes.front();
  if (flags.start.empty()) return episode;
  episode.start = {flags.start[0], flags.start[1], flags.start[2] * std::numbers::pi / 180.0};
  if (scene.world.collision().collides(episode.start)) {
    throw core::InputError::expected("--start", "a free place", "an obstacle");
  }
  episode.shortest_path_m =
      scene.world.distance_to(episode.view_points_m)
          .at({episode.start.x_m, episode.start.y_m}, sim::DistanceField::kBaseSnap_m);
  if (!std::isfinite(episode.shortest_path_m)) {
    throw core::InputError::expected("--start", "a place with a way to the goal", "none");
  }
  return episode;
}

void print_start(const ServeFlags& flags, const sim::Episode& episode) {
  std::printf(
      "ROS 2 (%s), domain %d, node /segsim: robot at %.2f, %.2f m, %.0f degrees, searching "
      "\"%s\"\n%s\n",
      flags.distro.c_str(), flags.domain, episode.start.x_m, episode.start.y_m,
      episode.start.yaw_rad * 180.0 / std::numbers::pi, episode.class_name.c_str(),
      flags.realtime ? "waiting for a publisher of /cmd_vel; then real time"
                     : "waiting for a publisher of /cmd_vel; then one command for each image");
  std::fflush(stdout);
}

void print_outcome(const records::TrialRow& row, int images) {
  std::printf("outcome: %s after %.1f s (simulated), %d images, %.2f m driven, %d contacts\n",
              records::to_string(row.outcome), row.sim_s, images, row.path_m, row.contacts);
  if (row.distance_to_goal_m) {
    std::printf("goal: %.2f m away, SPL %.3f (shortest way %.2f m)\n", *row.distance_to_goal_m,
                row.spl, row.shortest_path_m);
  }
}

void serve(ServeFlags flags) {
  ros::dds::TransportOptions network;
  if (flags.dds == "fast") network.implementation = ros::dds::Implementation::kFast;
  // Says what is missing, before anything is read.
  if (!ros::dds::has_transport(network.implementation))
    (void)ros::dds::open_transport(network);
  flags.domain = domain_of(flags);
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  core::require_drivable(bundle);
  flags.check(bundle.manifest);
  specs::SpecFolders folders{{}, flags.work};
  const specs::ExperimentSpec spec =
      specs::parse_spec(spec_text(flags, bundle.manifest), "segsim ros serve", folders);
  const support::StopOnSignal signals;
  const trials::LoadedScene scene =
      trials::load_scene(spec, spec.scenes.front(), flags.bundle, folders.work);
  const sim::Episode episode = episode_of(flags, scene);
  ProgressViewer viewer(flags.limit_s);
  trials::TrialTask task{&scene, &episode, &spec.arms.front()};
  task.record = false;
  task.viewer = &viewer;
  trials::TrialRunner runner(spec, {}, folders.work);
  print_start(flags, episode);
  const records::TrialRow row = runner.run(task);
  if (row.failed() && support::StopOnSignal::requested()) {
    std::printf("stopped by a signal after %d images\n", viewer.images());
    return;
  }
  if (row.failed()) throw core::CheckFailed(row.error);
  print_outcome(row, viewer.images());
}

void add_robot_flags(CLI::App& command, ServeFlags& flags) {
  command.add_option("--goal", flags.goals, "Class of the scene to search for")
      ->expected(1)
      ->required();
  command
      .add_option("--start", flags.start,
                  "X,Y,YAW [m, degrees]; default: a place that --seed draws")
      ->delimiter(',')
      ->expected(3)
      ->check(light::coordinate());
  command
      .add_option(
          "--detector", flags.detector,
          "Who fills /detections: none, oracle (the truth), or a file of weights or of "
          "a model")
      ->capture_default_str();
  command
      .add_option("--sensors", flags.sensors,
                  "Besides the camera, with commas: lidar, imu, gps, with their usual errors")
      ->delimiter(',')
      ->check(CLI::IsMember({"lidar", "imu", "gps"}));
  command.add_option("--work", flags.work, "Folder for the episode and the live view")
      ->capture_default_str();
}

void add_topic_flags(CLI::App& command, ServeFlags& flags) {
  command.add_flag("--depth-mm", flags.depth_mm,
                   "Depth as 16UC1, whole millimetres; without: 32FC1, metres");
  command.add_flag("--truth", flags.truth,
                   "Publish what the scene knows of every image: /truth/panoptic, "
                   "/truth/detections");
  command.add_flag("--map", flags.map,
                   "Publish the scene's obstacles on /map, and the frame \"map\"");
}

void add_network_flags(CLI::App& command, ServeFlags& flags) {
  command.add_option("--domain", flags.domain, "Of DDS; default: ROS_DOMAIN_ID, else 0")
      ->check(CLI::Range(0, 232));
  command.add_option("--ros-distro", flags.distro, "humble, or jazzy (Iron and all later)")
      ->check(CLI::IsMember({"humble", "jazzy"}))
      ->capture_default_str();
  command.add_option("--cmd-vel", flags.cmd_vel, "Type of /cmd_vel: twist or twist_stamped")
      ->check(CLI::IsMember({"twist", "twist_stamped"}))
      ->capture_default_str();
  command
      .add_option("--dds", flags.dds,
                  "Implementation, cyclone or fast; both understand each other")
      ->check(CLI::IsMember({"cyclone", "fast"}))
      ->capture_default_str();
  command.add_option(
      "--dds-config", flags.dds_config,
      "XML: for Cyclone DDS besides CYCLONEDDS_URI; for Fast DDS profiles with a "
      "participant \"segsim\"");
  command.add_flag("--realtime", flags.realtime,
                   "Simulated time follows the wall clock, and the newest command counts for "
                   "0.5 s. Without: the world waits for one command for each image");
  command
      .add_option("--answer", flags.answer_s,
                  "Seconds for each command, without --realtime; then it fails")
      ->check(CLI::Range(0.001, 3600.0))
      ->capture_default_str();
  command
      .add_option("--wait", flags.wait_s, "Seconds for somebody to come who sends commands")
      ->check(CLI::Range(0.001, 3600.0))
      ->capture_default_str();
}

}  // namespace

void add_ros_command(CLI::App& app) {
  CLI::App* ros = light::add_listed(app, light::kCommands, "ros");
  ros->require_subcommand(1);
  auto flags = std::make_shared<ServeFlags>();
  CLI::App* command =
      ros->add_subcommand("serve", "Put a robot into a scene and let a ROS 2 system drive it");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  add_robot_flags(*command, *flags);
  add_topic_flags(*command, *flags);
  add_network_flags(*command, *flags);
  add_bundle_flags(*command, *flags);
  command->callback([flags] { serve(*flags); });
}

}  // namespace segsim::experiments::commands::bridges
