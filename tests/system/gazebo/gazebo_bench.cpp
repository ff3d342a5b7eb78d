// From the pose that Gazebo sends to the images that it receives, over the real transport with
// a second process: latency beside the time to draw, and loss.
//
//     gazebo_bench [seconds=60] [rate=30] [bundle=DIR] [limits=on|off] [--record=FILE]
//
// Without a bundle: the two rooms of TinyScene. 640 x 480, colour, depth and labels. Exits
// with 1 if the median latency exceeds 1.2 x the median time to draw + 3 ms, or a frame that
// was due did not come back. --record saves a record for results/ (results/README.md).

#include <cstdio>
#include <ostream>
#include <string>

#include "core/file_io.h"
#include "core/process/measurement_record.h"
#include "core/scene_bundle.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/system/gazebo_processes.h"

namespace {

using segsim::tests::number_after;
using segsim::tests::Process;

std::string option(int argc, char** argv, const std::string& key,
                   const std::string& otherwise) {
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument.rfind(key + "=", 0) == 0) return argument.substr(key.size() + 1);
  }
  return otherwise;
}

struct Figures {
  double render_ms, latency_ms, limit_ms, memory_mb;
  int complete, due;  ///< Frames.
};

segsim::core::MeasurementRecord record_of(const Figures& f) {
  using Goal = segsim::core::MeasurementGoal;
  return {"Gazebo bridge",
          false,
          {{"", "frames due", "", static_cast<double>(f.due)},
           {"", "frames that came back", "", static_cast<double>(f.complete),
            Goal{Goal::Kind::kAtLeast, static_cast<double>(f.due), {}}},
           {"", "drawing, median", "ms", f.render_ms},
           {"", "pose to images, median", "ms", f.latency_ms,
            Goal{Goal::Kind::kAtMost, f.limit_ms, {}}},
           {"", "memory", "MB", f.memory_mb}}};
}

}  // namespace

int main(int argc, char** argv) {
  using namespace segsim;  // NOLINT(google-build-using-namespace)
  const double seconds = std::stod(option(argc, argv, "seconds", "60"));
  const double rate_hz = std::stod(option(argc, argv, "rate", "30"));
  const bool limits = option(argc, argv, "limits", "on") == "on";
  std::string bundle = option(argc, argv, "bundle", "");
  const experiments::TemporaryFolder folder("gazebo_bench");
  std::string world = "tiny";
  if (bundle.empty()) {
    bundle = experiments::TinyScene().write(folder.path() / "bundle").string();
  } else {
    world = "bench";
  }
  tests::record_drive(folder.path() / "drive.txt", 2.0 * rate_hz, 20.0);
  const std::string partition = "segsim_bench_" + std::to_string(::getpid());
  char rate[32];
  std::snprintf(rate, sizeof rate, "%g", rate_hz);

  Process server(
      {SEGSIM_BINARY, "gazebo", "serve", bundle, "--rate", rate, "--world-name", world},
      partition, folder.path() / "server.txt");
  if (!server.says("serving\n", 600.0)) {
    std::fprintf(stderr, "%s", server.output().c_str());
    return 2;
  }
  const int poses =
      static_cast<int>(2.0 * rate_hz * seconds);  // Gazebo's are the faster ones.
  char pose_rate[48], frames[48];
  std::snprintf(pose_rate, sizeof pose_rate, "rate=%.17g", 2.0 * rate_hz);
  std::snprintf(frames, sizeof frames, "frames=%d", poses);
  Process peer({SEGSIM_GAZEBO_PEER, "drive=" + (folder.path() / "drive.txt").string(),
                "world=" + world, pose_rate, frames, "image=/camera/image",
                "image=/camera/depth_image", "image=/panoptic/labels_map"},
               partition, folder.path() / "peer.txt");
  if (peer.wait(seconds * 2.0 + 120.0) != 0) {
    std::fprintf(stderr, "%s%s", peer.output().c_str(), server.output().c_str());
    return 2;
  }
  const double memory_mb = server.resident_mb();
  server.stop();
  std::printf("%s%sresident memory of the server: %.0f MB\n", peer.output().c_str(),
              server.output().c_str(), memory_mb);

  const double render_ms = number_after(server.output(), "render: median ");
  const double latency_ms = peer.value("latency_p50_ms");
  const double limit_ms = 1.2 * render_ms + 3.0;
  const int due = (poses + 1) / 2;
  const int complete = static_cast<int>(peer.value("complete"));
  std::printf(
      "pose in to images out: median %.2f ms, limit 1.2 x %.2f + 3 = %.2f ms\n"
      "frames: %d of %d\n",
      latency_ms, render_ms, limit_ms, complete, due);
  const std::string record = option(argc, argv, "--record", "");
  if (!record.empty()) {
    core::write_file_atomically(record, [&](std::ostream& out) {
      out << core::record_text(
          record_of({render_ms, latency_ms, limit_ms, memory_mb, complete, due}));
    });
  }
  return limits && (latency_ms > limit_ms || complete != due) ? 1 : 0;
}
