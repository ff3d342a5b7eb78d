#include "experiments/detection/source_dataset.h"

#include <cstdio>
#include <sstream>
#include <utility>
#include <vector>

#include "core/file_io.h"
#include "core/progress.h"
#include "experiments/support/step_record.h"
#include "experiments/support/stop_signal.h"
#include "perception/data/box_labels.h"
#include "perception/data/dataset.h"
#include "perception/data/image_file.h"
#include "worlds/capture/capture_plan.h"
#include "worlds/capture/mesh_renderer.h"
#include "worlds/procedural/procedural_flat.h"
#include "worlds/procedural/procedural_furniture.h"
#include "worlds/procedural/source_domain.h"

namespace segsim::experiments::detection {
namespace {

namespace fs = std::filesystem;

std::string describe(const SourceDatasetOptions& options) {
  std::ostringstream text;
  text << "source dataset v2: seed " << options.seed << ", rooms " << options.rooms
       << ", views " << options.views_per_room << ", image " << options.camera.width_px << "x"
       << options.camera.height_px << ", f " << options.camera.fx_px;
  return text.str();
}

std::string describe(const UnseenHomesOptions& options) {
  std::ostringstream text;
  text << "unseen homes v2: seed " << options.seed << ", homes " << options.homes << ", views "
       << options.views_per_home << ", image " << options.camera.width_px << "x"
       << options.camera.height_px << ", f " << options.camera.fx_px << ", camera "
       << options.camera_height_m << " m, pitch " << options.camera_pitch_down_rad;
  return text.str();
}

perception::ImagedScene generated(const char* generator, std::uint64_t seed, int count) {
  return {.generator = generator,
          .first_seed = seed,
          .last_seed = seed + static_cast<std::uint64_t>(count) - 1};
}

/// Collects labelled views of one scene after another.
class SceneViews {
 public:
  SceneViews(const std::string& title, int count, const core::CameraIntrinsics& camera,
             fs::path folder, const perception::ImagedScene& places)
      : camera_(camera), folder_(std::move(folder)), progress_(title, count) {
    dataset_.class_names = worlds::goal_class_names();
    dataset_.scenes = std::vector<perception::ImagedScene>{places};
  }

  void add(const sim::MeshScene& scene, const std::vector<core::CameraPose>& poses) {
    const auto renderer = worlds::make_mesh_renderer(scene, {});
    for (const core::CameraPose& pose : poses) {
      renderer->render(pose, camera_, core::Channels::kAll, frame_);
      perception::LabeledImage image;
      image.id = static_cast<std::int64_t>(dataset_.images.size()) + 1;
      char name[40];
      std::snprintf(name, sizeof name, "images/%06d.png", static_cast<int>(image.id));
      image.file = name;
      image.width_px = camera_.width_px;
      image.height_px = camera_.height_px;
      const perception::LabelView view{
          &frame_.semantic, &frame_.instance, &frame_.depth_m, {}};
      image.boxes = perception::label_boxes(view, scene.classes, dataset_.class_names);
      perception::write_image(folder_ / image.file, frame_.rgb);
      dataset_.images.push_back(std::move(image));
      progress_.update(static_cast<std::int64_t>(dataset_.images.size()));
      support::StopOnSignal::check();
    }
  }

  void write(const fs::path& json) const { perception::write_coco(json, dataset_); }

 private:
  core::CameraIntrinsics camera_;
  fs::path folder_;
  core::Progress progress_;
  perception::CocoDataset dataset_;
  core::Frame frame_;
};

}  // namespace

fs::path render_source_dataset(const SourceDatasetOptions& options, const fs::path& folder) {
  fs::path json = folder / "labels.json";
  const support::StepRecord record(folder / "labels.step", describe(options));
  if (fs::exists(json) && record.is_current()) return json;

  SceneViews views("source views", options.rooms * options.views_per_room, options.camera,
                   folder, generated(worlds::kRoomGenerator, options.seed, options.rooms));
  for (int room = 0; room < options.rooms; ++room) {
    const std::uint64_t seed = options.seed + static_cast<std::uint64_t>(room);
    views.add(worlds::make_source_room(seed),
              worlds::source_viewpoints(seed, options.views_per_room));
  }
  views.write(json);
  record.mark_done();
  return json;
}

fs::path render_unseen_homes(const UnseenHomesOptions& options, const fs::path& folder) {
  fs::path json = folder / "labels.json";
  const support::StepRecord record(folder / "labels.step", describe(options));
  if (fs::exists(json) && record.is_current()) return json;

  SceneViews views("views of unseen homes", options.homes * options.views_per_home,
                   options.camera, folder,
                   generated(worlds::kFlatGenerator, options.seed, options.homes));
  for (int home = 0; home < options.homes; ++home) {
    worlds::FlatOptions flat;
    flat.seed = options.seed + static_cast<std::uint64_t>(home);
    const sim::MeshScene scene = worlds::make_flat(flat);
    worlds::CapturePlan plan;
    plan.seed = flat.seed;
    plan.max_views = options.views_per_home;
    plan.heights_m = {options.camera_height_m};
    plan.pitches_down_rad = {options.camera_pitch_down_rad};
    views.add(scene, worlds::plan_capture_trajectory(scene, plan));
  }
  views.write(json);
  record.mark_done();
  return json;
}

}  // namespace segsim::experiments::detection
