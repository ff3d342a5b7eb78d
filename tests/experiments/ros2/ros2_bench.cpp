// From a pose to the colour and depth images in another process, over DDS on this machine. The
// views are drawn beforehand, so that the figures are those of messages and network alone; the
// time to draw one comes on top.
//
//     ros2_bench [seconds=60] [rate=30] [limits=on|off] [--record=FILE]
//
// The two rooms of TinyScene, 640 x 480; ten minutes are seconds=600. Exits with 1 if the
// median exceeds 15 ms, or an image was lost. --record saves a record for results/
// (results/README.md).
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "core/file_io.h"
#include "core/process/measurement_record.h"
#include "experiments/ros2/robot_node.h"
#include "renderer/cpu_renderer.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/ros/dds/loopback.h"

namespace {

using namespace segsim;  // NOLINT(google-build-using-namespace)
using Clock = std::chrono::steady_clock;

constexpr int kDomain = 74;
constexpr double kMost_ms = 15.0;

std::string option(int argc, char** argv, const std::string& key,
                   const std::string& otherwise) {
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument.rfind(key + "=", 0) == 0) return argument.substr(key.size() + 1);
  }
  return otherwise;
}

/// What ros_dds_peer says: "name value", line by line.
class Peer {
 public:
  explicit Peer(int frames)
      : pipe_(popen((std::string(DDS_PEER) + " measure " + std::to_string(kDomain) + " " +
                     std::to_string(frames))
                        .c_str(),
                    "r")) {}
  ~Peer() { (void)finish(); }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  std::map<std::string, double> finish() {
    std::map<std::string, double> values;
    if (pipe_ == nullptr) return values;
    char name[64];
    double value = 0.0;
    while (std::fscanf(pipe_, "%63s %lf", name, &value) == 2) values[name] = value;
    pclose(pipe_);
    pipe_ = nullptr;
    return values;
  }

 private:
  std::FILE* pipe_;
};

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0.0 : values[values.size() / 2];
}

core::TimeNs wall_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch())
      .count();
}

/// Views on a circle, so that every image differs from the one before.
struct Views {
  std::vector<core::Frame> frames{16};
  std::vector<core::Pose2> poses;
  double draw_ms = 0.0;  ///< Median, on one thread.
};

core::Observation camera() {
  core::Observation seen;
  seen.intrinsics = core::CameraIntrinsics::from_fov(640, 480, 1.2);
  seen.T_robot_camera = core::mast_camera(1.0, 0.1);
  return seen;
}

Views draw() {
  const experiments::TinyScene scene;
  renderer::RenderOptions options;
  options.threads = 1;
  const auto renderer = renderer::make_cpu_renderer(
      std::make_shared<const renderer::SurfelCloud>(scene.surfels()), options);
  const core::Observation seen = camera();
  Views views;
  std::vector<double> draw_ms;
  for (core::Frame& frame : views.frames) {
    const double angle_rad = static_cast<double>(views.poses.size()) * 0.4;
    const core::Pose2& pose = views.poses.emplace_back(
        core::Pose2{-2.0 + 0.5 * std::cos(angle_rad), 0.5 * std::sin(angle_rad), angle_rad});
    const core::TimeNs start_ns = wall_ns();
    renderer->render(
        core::transform_from_pose2<core::frame::World>(pose) * seen.T_robot_camera,
        seen.intrinsics, core::Channels::kRgbd, frame);
    draw_ms.push_back(static_cast<double>(wall_ns() - start_ns) * 1e-6);
  }
  views.draw_ms = median(draw_ms);
  return views;
}

/// Publishes them at that rate, stamped with the time at which their pose was due.
void play(const Views& views, experiments::ros2::RobotNode& robot, int frames,
          double rate_hz) {
  core::Observation seen = camera();
  const Clock::time_point start = Clock::now();
  for (int k = 0; k < frames; ++k) {
    const std::chrono::duration<double> due(k / rate_hz);
    std::this_thread::sleep_until(start + std::chrono::duration_cast<Clock::duration>(due));
    const std::size_t view = static_cast<std::size_t>(k) % views.frames.size();
    seen.capture_time_ns = wall_ns();
    seen.T_odom_robot = core::transform_from_pose2<core::frame::Odom>(views.poses[view]);
    seen.rgb = &views.frames[view].rgb;
    seen.depth_m = &views.frames[view].depth_m;
    robot.publish(seen, {});
  }
}

core::MeasurementRecord record_of(int due, double draw_ms,
                                  std::map<std::string, double>& heard) {
  using Goal = core::MeasurementGoal;
  return {"Images over DDS",
          false,
          {{"", "frames due", "", static_cast<double>(due)},
           {"", "frames that came", "", heard["frames"],
            Goal{Goal::Kind::kAtLeast, static_cast<double>(due), {}}},
           {"", "drawing, median", "ms", draw_ms},
           {"", "pose to images, median", "ms", heard["age_p50_ms"],
            Goal{Goal::Kind::kAtMost, kMost_ms, {}}},
           {"", "pose to images, p99", "ms", heard["age_p99_ms"]},
           {"", "pose to images, longest", "ms", heard["age_max_ms"]}}};
}

}  // namespace

int main(int argc, char** argv) {
  const double seconds = std::stod(option(argc, argv, "seconds", "60"));
  const double rate_hz = std::stod(option(argc, argv, "rate", "30"));
  const bool limits = option(argc, argv, "limits", "on") == "on";
  const int frames = static_cast<int>(std::lround(seconds * rate_hz));

  nav::Ros2Settings settings;
  settings.domain = kDomain;
  settings.config = ros::dds::kLoopback;
  experiments::ros2::RobotNode robot(settings);
  Peer peer(frames);
  robot.begin({"couch", 0}, {"couch"}, nullptr);
  while (robot.viewers() == 0) robot.wait(0.02);
  const Views views = draw();
  play(views, robot, frames, rate_hz);
  std::map<std::string, double> heard = peer.finish();
  std::printf(
      "frames: %.0f of %d came, %llu messages could not be sent\n"
      "drawing a view: median %.2f ms (not in what follows)\n"
      "pose to images in another process: median %.2f ms, p99 %.2f ms, longest %.2f ms\n",
      heard["frames"], frames, static_cast<unsigned long long>(robot.traffic().lost),
      views.draw_ms, heard["age_p50_ms"], heard["age_p99_ms"], heard["age_max_ms"]);
  const std::string record = option(argc, argv, "--record", "");
  if (!record.empty()) {
    core::write_file_atomically(record, [&](std::ostream& out) {
      out << core::record_text(record_of(frames, views.draw_ms, heard));
    });
  }
  const bool held = heard["frames"] == frames && heard["age_p50_ms"] <= kMost_ms;
  return limits && !held ? 1 : 0;
}
