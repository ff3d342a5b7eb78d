#include "experiments/scenes/scene_source.h"

#include <cstdio>
#include <numbers>
#include <sstream>

#include "core/file_io.h"
#include "core/progress.h"
#include "experiments/scenes/mesh_source.h"
#include "experiments/specs/gazebo_spec.h"
#include "experiments/specs/home_spec.h"
#include "experiments/support/stop_signal.h"
#include "reconstruction/datasets/box_annotation.h"
#include "worlds/capture/capture.h"
#include "worlds/capture/capture_plan.h"
#include "worlds/capture/mesh_renderer.h"

namespace segsim::experiments::scenes {
namespace {

namespace fs = std::filesystem;

std::vector<core::CameraPose> plan_path(const sim::MeshScene& scene,
                                        const specs::SourceSpec& source) {
  worlds::CapturePlan plan;
  plan.heights_m = {source.capture.camera_height_m, source.capture.camera_height_m - 0.4,
                    source.capture.camera_height_m + 0.2};
  // Dense places and every pitch: what no frame has seen is a hole in the reconstruction.
  plan.spacing_m = 0.8;
  plan.views_per_place = 6;
  plan.pitches_down_rad = {0.1, 0.45, -0.25, 0.25, 0.7, 0.0};
  plan.max_views = source.capture.frames;
  plan.seed = source.seed;
  return worlds::plan_capture_trajectory(scene, plan);
}

void write_credits(const std::vector<std::string>& credits, const fs::path& folder) {
  const fs::path file = folder / kCreditsFileName;
  fs::remove(file);
  if (credits.empty()) return;
  core::write_file_atomically(file, [&](std::ostream& out) {
    for (const std::string& credit : credits) out << credit << '\n';
  });
}

}  // namespace

std::string describe_capture(const specs::SourceSpec& source) {
  std::ostringstream text;
  switch (source.type) {
    case specs::SourceType::kFlat:
      text << "procedural flat, seed " << source.seed;
      break;
    case specs::SourceType::kHome:
      text << "procedural home, seed " << source.seed << specs::describe(source.home);
      break;
    case specs::SourceType::kGazebo:
      text << "Gazebo world " << source.world.filename().string()
           << specs::describe(source.gazebo);
      break;
    case specs::SourceType::kMesh:
      text << "mesh " << source.world.filename().string();
      break;
    case specs::SourceType::kRgbd:
      text << "recording " << source.folder.filename().string() << ", every "
           << source.frame_step << ". frame";
      if (!source.boxes.empty()) text << ", boxes " << source.boxes.filename().string();
      text << source.rig.text();
      return text.str();
  }
  const specs::CaptureSpec& capture = source.capture;
  text << ", path seed " << source.seed << ", up to " << capture.frames << " frames "
       << capture.width_px << "x" << capture.height_px << ", hfov " << capture.hfov_deg
       << " deg, camera " << capture.camera_height_m << " m high";
  return text.str();
}

void capture_mesh_source(const specs::SourceSpec& source, const fs::path& folder,
                         const fs::path& trajectory, bool depth_exr, bool overwrite) {
  worlds::Home home;
  if (source.type == specs::SourceType::kHome) {
    home = load_home(source);
  } else {
    home.scene = load_mesh_source(source);
  }
  const sim::MeshScene& scene = home.scene;
  for (const std::string& warning : scene.warnings) {
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  }
  std::printf("%s: %zu instances, %zu triangles, %zu warnings\n", scene.name.c_str(),
              scene.instances.size(), scene.triangle_count(), scene.warnings.size());
  const std::vector<core::CameraPose> path =
      trajectory.empty() ? plan_path(scene, source) : worlds::read_trajectory(trajectory);
  worlds::MeshRenderOptions light;
  if (source.type == specs::SourceType::kHome) {
    // Models have so many small surfaces that their light takes longer than the frames.
    light.cell_m = 0.08F;
    light.bounce_samples = 49;
  }
  const auto renderer = worlds::make_mesh_renderer(scene, light);
  const auto intrinsics =
      core::CameraIntrinsics::from_fov(source.capture.width_px, source.capture.height_px,
                                       source.capture.hfov_deg * std::numbers::pi / 180.0);

  core::Progress progress("capture", static_cast<std::int64_t>(path.size()));
  worlds::CaptureOptions options;
  options.depth_exr = depth_exr;
  options.overwrite = overwrite;
  options.source = describe_capture(source);
  if (!trajectory.empty()) options.source += ", trajectory " + trajectory.filename().string();
  options.on_frame = [&](int done, int) {
    progress.update(done);
    support::StopOnSignal::check();
  };
  worlds::capture_sequence(*renderer, path, intrinsics, folder, scene.classes, scene.instances,
                           options);
  write_credits(home.credits, folder);
}

std::string read_credits(const fs::path& folder) {
  const fs::path file = folder / kCreditsFileName;
  return fs::exists(file) ? core::read_file(file) : std::string();
}

std::unique_ptr<reconstruction::RgbdSequence> open_recording(
    const fs::path& folder, const fs::path& boxes,
    const reconstruction::SequenceOptions& options) {
  auto sequence = reconstruction::open_sequence(folder, options);
  if (boxes.empty()) return sequence;
  return reconstruction::with_box_labels(std::move(sequence), boxes);
}

}  // namespace segsim::experiments::scenes
