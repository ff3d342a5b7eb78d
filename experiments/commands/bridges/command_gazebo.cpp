#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "core/progress.h"
#include "experiments/commands/bridges/bridge_commands.h"
#include "experiments/commands/light/flag_values.h"
#include "experiments/reproducibility/backend_warning.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/support/stop_signal.h"
#include "renderer/renderer_backend.h"
#include "renderer/scene/render_options.h"
#include "sim/gazebo/gazebo_bridge.h"
#include "sim/gazebo/gazebo_cameras.h"
#include "sim/gazebo/gazebo_world.h"

namespace segsim::experiments::commands::bridges {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr double kDegree = std::numbers::pi / 180.0;

struct CameraFlags {
  double height_m = 0.0;  ///< 0 = as in the bundle.
  double pitch_down_deg = 0.0, hfov_deg = 70.0, rate_hz = 30.0;
  int width_px = 640, height_px = 480;
};

struct ServeFlags {
  fs::path bundle, world_file;
  std::string world, pose_topic, flavour = "both", backend = "auto";
  CameraFlags camera;
  int threads = 0;
  double duration_s = 0.0;
  bool expect_no_loss = false;
};

struct ExportFlags {
  fs::path bundle, out;
  std::string robot = "jackal-gentle", flavour = "ignition";
  CameraFlags camera;
  std::vector<double> start;
};

sim::GazeboFlavour flavour_of(const std::string& name) {
  if (name == "ignition") return sim::GazeboFlavour::kIgnition;
  if (name == "gz") return sim::GazeboFlavour::kGz;
  return sim::GazeboFlavour::kBoth;
}

sim::GazeboWorldOptions world_options(const CameraFlags& camera,
                                      const core::SceneManifest& scene) {
  sim::GazeboWorldOptions options;
  if (scene.camera_height_m > 0.0) options.camera_height_m = scene.camera_height_m;
  if (camera.height_m > 0.0) options.camera_height_m = camera.height_m;
  options.camera_pitch_down_rad = camera.pitch_down_deg * kDegree;
  options.horizontal_fov_rad = camera.hfov_deg * kDegree;
  options.rate_hz = camera.rate_hz;
  options.width_px = camera.width_px;
  options.height_px = camera.height_px;
  return options;
}

/// The cameras of the user's world, or those that `export-world` would describe.
sim::GazeboCameras find_cameras(const ServeFlags& flags, const core::SceneManifest& scene) {
  if (!flags.world_file.empty()) return sim::read_gazebo_cameras(flags.world_file);
  return sim::parse_gazebo_cameras(
      sim::gazebo_world_sdf(scene, world_options(flags.camera, scene)), "the world's default");
}

/// "2 superseded, 1 not finite", or "nothing".
std::string losses(const sim::GazeboTraffic& traffic) {
  std::string text;
  const auto add = [&text](std::uint64_t count, const std::string& what) {
    if (count > 0) text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + what;
  };
  add(traffic.superseded, "superseded");
  for (int fault = 1; fault < sim::kPoseFaults; ++fault) {
    add(traffic.faulty[static_cast<std::size_t>(fault)],
        std::string("poses ") + sim::to_string(static_cast<sim::PoseFault>(fault)));
  }
  return text.empty() ? "nothing" : text;
}

/// One line on standard error: redrawn every second on a terminal, printed every ten seconds
/// elsewhere.
class StatusLine {
 public:
  explicit StatusLine(std::string pose_topic)
      : pose_topic_(std::move(pose_topic)), terminal_(::isatty(STDERR_FILENO) == 1) {}
  ~StatusLine() {
    if (terminal_ && printed_) std::fputc('\n', stderr);
  }
  StatusLine(const StatusLine&) = delete;
  StatusLine& operator=(const StatusLine&) = delete;

  void update(const sim::GazeboBridge& bridge) {
    const Clock::time_point now = Clock::now();
    const double passed_s = std::chrono::duration<double>(now - last_).count();
    if (passed_s < (terminal_ ? 1.0 : 10.0)) return;
    if (!warned_) warn_of_rivals(bridge);
    const sim::GazeboStatus status = bridge.status();
    const double images_hz = static_cast<double>(status.traffic.frames - frames_) / passed_s;
    const double poses_hz = static_cast<double>(status.traffic.poses - poses_) / passed_s;
    char line[512];
    if (status.since_pose_s < 0.0 || status.since_pose_s > kSilence_s) {
      std::snprintf(
          line, sizeof line, "gazebo: no poses on %s for %s, %llu frames so far",
          pose_topic_.c_str(),
          core::format_duration(status.since_pose_s < 0.0
                                    ? std::chrono::duration<double>(now - start_).count()
                                    : status.since_pose_s)
              .c_str(),
          static_cast<unsigned long long>(status.traffic.frames));
    } else {
      std::snprintf(line, sizeof line,
                    "gazebo: %.1f frames/s of %.1f poses/s, render %.1f ms, answer %.1f ms, "
                    "dropped %s%s%s",
                    images_hz, poses_hz, status.render_median_ms, status.answer_median_ms,
                    losses(status.traffic).c_str(),
                    status.traffic.last_fault.empty() ? "" : "; last: ",
                    status.traffic.last_fault.c_str());
    }
    std::fprintf(stderr, terminal_ ? "\r\033[K%s" : "%s\n", line);
    std::fflush(stderr);
    printed_ = true;
    last_ = now;
    frames_ = status.traffic.frames;
    poses_ = status.traffic.poses;
  }

 private:
  void warn_of_rivals(const sim::GazeboBridge& bridge) {
    for (const std::string& topic : bridge.contested_topics()) {
      std::fprintf(stderr,
                   "%swarning: somebody else publishes %s too; is Gazebo's Sensors system "
                   "loaded?\n",
                   terminal_ && printed_ ? "\n" : "", topic.c_str());
      warned_ = true;
    }
  }

  static constexpr double kSilence_s = 3.0;
  std::string pose_topic_;
  bool terminal_, printed_ = false, warned_ = false;
  Clock::time_point start_ = Clock::now(), last_ = start_;
  std::uint64_t frames_ = 0, poses_ = 0;
};

void print_topics(const sim::GazeboBridge& bridge, const sim::GazeboCameras& found) {
  std::printf("poses: %s\n", bridge.pose_topic().c_str());
  for (const sim::GazeboCamera& camera : found.cameras) {
    std::printf("%s: %d x %d, %g Hz\n", camera.frame_id.c_str(), camera.intrinsics.width_px,
                camera.intrinsics.height_px, camera.rate_hz);
    for (const std::string& topic : {camera.rgb_topic, camera.depth_topic, camera.labels_topic,
                                     camera.colored_topic, camera.info_topic}) {
      if (!topic.empty()) std::printf("  %s\n", topic.c_str());
    }
  }
  std::printf("serving\n");
  std::fflush(stdout);
}

void print_report(const sim::GazeboStatus& status, double served_s) {
  const sim::GazeboTraffic& traffic = status.traffic;
  const auto count = [](std::uint64_t value) {
    return static_cast<unsigned long long>(value);
  };
  std::printf("served %s: %llu poses, %llu frames, %llu messages, %.1f MB\n",
              core::format_duration(served_s).c_str(), count(traffic.poses),
              count(traffic.frames), count(traffic.images),
              static_cast<double>(traffic.bytes) * 1e-6);
  std::printf("render: median %.2f ms, p95 %.2f ms\n", status.render_median_ms,
              status.render_p95_ms);
  std::printf("answer: median %.2f ms, p95 %.2f ms\n", status.answer_median_ms,
              status.answer_p95_ms);
  std::printf("dropped: %s\n", losses(traffic).c_str());
  std::printf(
      "no loss: %llu between frames, %llu while paused, %llu unwatched; clock set back "
      "%llu times\n",
      count(traffic.early), count(traffic.repeated), count(traffic.unwatched),
      count(traffic.restarts));
}

void serve(const ServeFlags& flags) {
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  sim::GazeboCameras found = find_cameras(flags, bundle.manifest);
  for (const std::string& warning : found.warnings) {
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  }
  const scenes::SceneSurfels scene = scenes::load_scene_surfels(bundle);
  renderer::RenderOptions render_options;
  render_options.threads = flags.threads;
  const auto renderer = renderer::make_renderer(renderer::backend_of(flags.backend),
                                                scene.surfels, render_options, scene.labels,
                                                reproducibility::warn_about_backend);
  sim::GazeboBridgeOptions options;
  options.world = flags.world.empty() ? found.world : flags.world;
  options.pose_topic = flags.pose_topic;
  options.flavour = flavour_of(flags.flavour);
  options.cameras = found.cameras;

  const support::StopOnSignal signals;
  sim::GazeboBridge bridge(options, *renderer, bundle.manifest);
  print_topics(bridge, found);
  const Clock::time_point start = Clock::now();
  const auto served_s = [start] {
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  {
    StatusLine line(bridge.pose_topic());
    bridge.run([&] {
      line.update(bridge);
      return !support::StopOnSignal::requested() &&
             (flags.duration_s <= 0.0 || served_s() < flags.duration_s);
    });
  }
  const sim::GazeboStatus status = bridge.status();
  print_report(status, served_s());
  if (flags.expect_no_loss && status.traffic.superseded + status.traffic.faults() > 0) {
    throw core::CheckFailed("gazebo serve: expected no loss, found " + losses(status.traffic));
  }
}

void export_world(const ExportFlags& flags) {
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  core::require_drivable(bundle);
  sim::GazeboWorldOptions options = world_options(flags.camera, bundle.manifest);
  options.robot = sim::RobotModel::by_name(flags.robot);
  options.flavour = flavour_of(flags.flavour);
  options.start = flags.start.empty()
                      ? sim::roomiest_start(bundle, options.robot)
                      : core::Pose2{flags.start[0], flags.start[1], flags.start[2] * kDegree};
  sim::export_gazebo_world(bundle, flags.out, options);
  const std::string world = (flags.out / "world.sdf").string();
  std::printf(
      "%s: robot at %.2f, %.2f m; next:\n  %s -r %s\n  segsim gazebo serve %s --world "
      "%s\n",
      world.c_str(), options.start.x_m, options.start.y_m,
      options.flavour == sim::GazeboFlavour::kGz ? "gz sim" : "ign gazebo", world.c_str(),
      flags.bundle.string().c_str(), world.c_str());
}

void add_camera_flags(CLI::App& command, CameraFlags& camera) {
  command
      .add_option("--camera-height", camera.height_m, "Above the floor [m]; 0 = the bundle's")
      ->check(CLI::Range(0.0, 10.0))
      ->capture_default_str();
  command.add_option("--pitch-down-deg", camera.pitch_down_deg, "Of the camera [degrees]")
      ->check(CLI::Range(-90.0, 90.0))
      ->capture_default_str();
  command.add_option("--hfov-deg", camera.hfov_deg, "Horizontal field of view [degrees]")
      ->check(light::field_of_view_deg())
      ->capture_default_str();
  command.add_option("--rate", camera.rate_hz, "Images a second, in simulated time")
      ->check(CLI::Range(0.1, 1000.0))
      ->capture_default_str();
  command.add_option("--width", camera.width_px, "Image width [px]")
      ->check(light::image_side())
      ->capture_default_str();
  command.add_option("--height", camera.height_px, "Image height [px]")
      ->check(light::image_side())
      ->capture_default_str();
}

void add_serve(CLI::App& gazebo) {
  auto flags = std::make_shared<ServeFlags>();
  CLI::App* command = gazebo.add_subcommand(
      "serve", "Be the camera of a running Gazebo: poses in, images out");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("--world", flags->world_file,
                      "SDF file that Gazebo runs: its camera sensors are served. Without it: "
                      "the cameras that export-world describes, from the flags below");
  command->add_option("--world-name", flags->world,
                      "World in the pose topic; default: the SDF file's");
  command->add_option("--pose-topic", flags->pose_topic,
                      "Default: /world/NAME/dynamic_pose/info");
  command
      ->add_option("--flavour", flags->flavour,
                   "Names of messages: ignition (Fortress), gz (Garden and later), both")
      ->check(CLI::IsMember({"ignition", "gz", "both"}))
      ->capture_default_str();
  command->add_option("--backend", flags->backend, "cpu | cuda | auto")->capture_default_str();
  command->add_option("--threads", flags->threads, "Of the CPU renderer; 0 = all processors")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->add_option("--duration", flags->duration_s, "End after so many seconds; 0 = never")
      ->check(CLI::Range(0.0, 1e9))
      ->capture_default_str();
  command->add_flag("--expect-no-loss", flags->expect_no_loss,
                    "Exit with code 1 if a frame was dropped or a pose was faulty");
  add_camera_flags(*command, flags->camera);
  command->callback([flags] { serve(*flags); });
}

void add_export(CLI::App& gazebo) {
  auto flags = std::make_shared<ExportFlags>();
  CLI::App* command = gazebo.add_subcommand(
      "export-world", "Write a world for Gazebo: collision mesh and a Jackal with cameras");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("-o,--out", flags->out, "Folder for world.sdf, meshes/, models/")
      ->required();
  command->add_option("--robot", flags->robot, "Whose size and limits (see `segsim robots`)")
      ->capture_default_str();
  command
      ->add_option("--start", flags->start,
                   "x y [m], yaw [degrees]; default: where there is most room")
      ->expected(3)
      ->check(light::coordinate());
  command
      ->add_option("--flavour", flags->flavour,
                   "Names of plugins: ignition (Fortress), gz (Garden and later)")
      ->check(CLI::IsMember({"ignition", "gz"}))
      ->capture_default_str();
  add_camera_flags(*command, flags->camera);
  command->callback([flags] { export_world(*flags); });
}

}  // namespace

void add_gazebo_command(CLI::App& app) {
  CLI::App* gazebo = light::add_listed(app, light::kCommands, "gazebo");
  gazebo->require_subcommand(1);
  add_serve(*gazebo);
  add_export(*gazebo);
  add_gazebo_drive(*gazebo);
}

}  // namespace segsim::experiments::commands::bridges
