#include "experiments/source_dataset.h"

#include <cstdio>
#include <sstream>

#include "core/file_io.h"
#include "core/progress.h"
#include "experiments/step_record.h"
#include "perception/box_labels.h"
#include "perception/dataset.h"
#include "perception/image_file.h"
#include "sim/mesh_renderer.h"
#include "sim/procedural_furniture.h"
#include "sim/source_domain.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

std::string describe(const SourceDatasetOptions& options) {
  std::ostringstream text;
  text << "source dataset v1: seed " << options.seed << ", rooms " << options.rooms
       << ", views " << options.views_per_room << ", image " << options.camera.width_px << "x"
       << options.camera.height_px << ", f " << options.camera.fx_px;
  return text.str();
}

}  // namespace

fs::path render_source_dataset(const SourceDatasetOptions& options, const fs::path& folder) {
  const fs::path json = folder / "labels.json";
  const StepRecord record(folder / "labels.step", describe(options));
  if (fs::exists(json) && record.is_current()) return json;

  perception::CocoDataset dataset;
  dataset.class_names = sim::goal_class_names();
  core::Progress progress("source views", options.rooms * options.views_per_room);
  core::Frame frame;
  for (int room = 0; room < options.rooms; ++room) {
    const std::uint64_t seed = options.seed + static_cast<std::uint64_t>(room);
    const sim::MeshScene scene = sim::make_source_room(seed);
    const auto renderer = sim::make_mesh_renderer(scene, {});
    for (const core::CameraPose& pose : sim::source_viewpoints(seed, options.views_per_room)) {
      renderer->render(pose, options.camera, core::Channels::kAll, frame);
      perception::LabeledImage image;
      image.id = static_cast<std::int64_t>(dataset.images.size()) + 1;
      char name[40];
      std::snprintf(name, sizeof name, "images/%06d.png", static_cast<int>(image.id));
      image.file = name;
      image.width_px = options.camera.width_px;
      image.height_px = options.camera.height_px;
      const perception::LabelView view{&frame.semantic, &frame.instance, &frame.depth_m, {}};
      image.boxes = perception::label_boxes(view, scene.classes, dataset.class_names);
      perception::write_image(folder / image.file, frame.rgb);
      dataset.images.push_back(std::move(image));
      progress.update(static_cast<std::int64_t>(dataset.images.size()));
    }
  }
  perception::write_coco(json, dataset);
  record.mark_done();
  return json;
}

}  // namespace segsim::experiments
