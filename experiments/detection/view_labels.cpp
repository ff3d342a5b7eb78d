#include "experiments/detection/view_labels.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>

#include "core/check.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/render.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/support/stop_signal.h"
#include "perception/data/image_file.h"
#include "renderer/cpu_renderer.h"
#include "sim/ground/world.h"

namespace segsim::experiments::detection {
namespace {

namespace fs = std::filesystem;
using renderer::SurfelCloud;

SurfelCloud surfels_of_instance(const SurfelCloud& all, std::uint16_t instance_id) {
  SurfelCloud part;
  part.sh_degree = all.sh_degree;
  const std::size_t n = all.sh_count();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all.instance_id[i] != instance_id) continue;
    part.position_m.push_back(all.position_m[i]);
    part.R_world_surfel.push_back(all.R_world_surfel[i]);
    part.scale_m.push_back(all.scale_m[i]);
    part.opacity.push_back(all.opacity[i]);
    for (std::size_t k = 0; k < n; ++k) part.sh.push_back(all.sh[i * n + k]);
    part.semantic_id.push_back(all.semantic_id[i]);
    part.instance_id.push_back(all.instance_id[i]);
  }
  return part;
}

/// How much of an instance would be seen if nothing hid it.
class InstanceRenderers {
 public:
  explicit InstanceRenderers(std::shared_ptr<const SurfelCloud> all) : all_(std::move(all)) {}

  int unoccluded_pixels(std::uint16_t instance_id, const core::Frame& view) {
    auto& entry = renderers_[instance_id];
    if (entry == nullptr) {
      entry = renderer::make_cpu_renderer(
          std::make_shared<SurfelCloud>(surfels_of_instance(*all_, instance_id)), {});
    }
    entry->render(view.T_world_camera, view.intrinsics, core::Channels::kDepth, frame_);
    return static_cast<int>(std::count_if(frame_.alpha.pixels().begin(),
                                          frame_.alpha.pixels().end(),
                                          [](float alpha) { return alpha >= 0.5F; }));
  }

 private:
  std::shared_ptr<const SurfelCloud> all_;
  std::map<std::uint16_t, std::unique_ptr<core::Renderer>> renderers_;
  core::Frame frame_;
};

/// False for a view that teaches nothing: out of the reconstruction, or a wall right in front.
bool is_useful(const core::Frame& frame, const ViewLabelOptions& options) {
  std::vector<float> depths_m;
  for (const float depth_m : frame.depth_m.pixels()) {
    if (std::isfinite(depth_m)) depths_m.push_back(depth_m);
  }
  const auto valid = static_cast<double>(depths_m.size());
  if (valid < (1.0 - options.max_invalid_share) * static_cast<double>(frame.depth_m.size())) {
    return false;
  }
  const auto middle = depths_m.begin() + static_cast<std::ptrdiff_t>(depths_m.size() / 2);
  std::nth_element(depths_m.begin(), middle, depths_m.end());
  return *middle >= options.min_view_distance_m;
}

std::map<std::uint16_t, int> count_pixels(const core::Image<std::uint16_t>& ids) {
  std::map<std::uint16_t, int> counts;
  for (const std::uint16_t id : ids.pixels()) {
    if (id != 0) ++counts[id];
  }
  return counts;
}

/// The scene's classes with the names that the detector's vocabulary has for them.
std::vector<core::SceneClass> mapped_classes(const core::SceneManifest& manifest,
                                             const ViewLabelOptions& options,
                                             std::vector<std::string>& unmapped) {
  std::vector<core::SceneClass> classes = manifest.classes;
  if (!options.class_map) return classes;
  for (core::SceneClass& scene_class : classes) {
    const auto target = options.class_map->find(scene_class.name);
    if (!target && scene_class.thing) unmapped.push_back(scene_class.name);
    if (target) scene_class.name = *target;
  }
  return classes;
}

scenes::ViewSamplerOptions sampler_options(const ViewLabelOptions& options) {
  scenes::ViewSamplerOptions result;
  result.seed = options.seed;
  result.share_facing_object = options.share_facing_object;
  result.max_object_distance_m = options.max_object_distance_m;
  result.near_duplicate = options.near_duplicate;
  result.avoid_m = options.avoid_m;
  result.avoid_radius_m = options.avoid_radius_m;
  return result;
}

/// Renders, judges and labels one view after another.
class ViewLabeller {
 public:
  ViewLabeller(const LabelledScene& scene, const ViewLabelOptions& options,
               const std::vector<core::SceneClass>& classes, const fs::path& folder)
      : bundle_(scene.bundle),
        options_(options),
        classes_(classes),
        folder_(folder),
        renderer_(
            renderer::make_cpu_renderer(scene.surfels.surfels, {}, scene.surfels.labels)),
        alone_(scene.surfels.surfels),
        consistency_(bundle_.manifest),
        T_robot_camera_(
            core::mast_camera(options.camera_height_m, options.camera_pitch_down_rad)) {
    dataset_.folder = folder;
    dataset_.class_names = options.class_names;
    dataset_.scenes = std::vector<perception::ImagedScene>{
        {bundle_.manifest.name, bundle_.manifest.surfels.sha256}};
  }

  /// False if the view is of no use. @param wanted_instance  That it must show; 0 = none.
  bool add(const core::Pose2& pose, std::uint16_t wanted_instance) {
    renderer_->render(core::transform_from_pose2<core::frame::World>(pose) * T_robot_camera_,
                      options_.camera, core::Channels::kRgbd | core::Channels::kLabels,
                      frame_);
    if (!is_useful(frame_, options_)) return false;
    const std::map<std::uint16_t, int> pixels = count_pixels(frame_.instance);
    // A wall may stand between: such views would leave rare classes without examples.
    if (wanted_instance != 0 && (!pixels.contains(wanted_instance) ||
                                 pixels.at(wanted_instance) < options_.min_wanted_pixels)) {
      return false;
    }
    append(pose, pixels);
    return true;
  }

  [[nodiscard]] std::size_t size() const { return dataset_.images.size(); }

  void finish(ViewLabels& labels) {
    labels.instances = consistency_.result();
    for (const InstanceConsistency& instance : labels.instances) {
      if (instance.label_agreement < options_.min_label_agreement) {
        ignore_instance(instance.instance_id);
      }
    }
    labels.dataset = std::move(dataset_);
  }

 private:
  void append(const core::Pose2& pose, const std::map<std::uint16_t, int>& pixels) {
    const auto visible_fraction = [&](std::uint16_t id) {
      const int visible = pixels.at(id);
      const int all = std::max(visible, alone_.unoccluded_pixels(id, frame_));
      return static_cast<double>(visible) / all;
    };
    const perception::LabelView view{&frame_.semantic, &frame_.instance, &frame_.depth_m,
                                     visible_fraction};
    perception::LabeledImage image;
    image.id = static_cast<std::int64_t>(dataset_.images.size()) + 1;
    char name[32];
    std::snprintf(name, sizeof name, "%05d.png", static_cast<int>(image.id));
    image.file = "images/" + options_.prefix + name;
    image.width_px = options_.camera.width_px;
    image.height_px = options_.camera.height_px;
    image.scene = bundle_.manifest.name;
    image.view = pose;
    image.boxes =
        perception::label_boxes(view, classes_, options_.class_names, options_.boxes);
    consistency_.add(frame_, image.boxes);
    perception::write_image(folder_ / image.file, frame_.rgb);
    dataset_.images.push_back(std::move(image));
  }

  void ignore_instance(int instance_id) {
    for (perception::LabeledImage& image : dataset_.images) {
      for (perception::LabeledBox& box : image.boxes) {
        if (box.instance_id == instance_id) box.ignore = true;
      }
    }
  }

  const core::SceneBundle& bundle_;
  const ViewLabelOptions& options_;
  const std::vector<core::SceneClass>& classes_;
  const fs::path& folder_;
  std::unique_ptr<core::Renderer> renderer_;
  InstanceRenderers alone_;
  LabelConsistency consistency_;
  core::Transform<core::frame::Robot, core::frame::Camera> T_robot_camera_;
  perception::CocoDataset dataset_;
  core::Frame frame_;
};

/// Every picture of the drives that is of use.
void add_drives(const sim::World& world, const ViewLabelOptions& options,
                scenes::ViewSampler& sampler, ViewLabeller& labeller, ViewLabels& labels) {
  for (const scenes::Drive& drive : options.drives) {
    if (!drive.scene.empty() && drive.scene != world.manifest().name) continue;
    for (const core::Pose2& pose : scenes::drive_poses(world, drive)) {
      const bool wanted = !sampler.is_avoided(pose) && !sampler.is_near_duplicate(pose);
      if (!wanted || !labeller.add(pose, 0)) {
        ++labels.drive_views_refused;
        continue;
      }
      sampler.accept(pose);
      ++labels.drive_views;
    }
  }
}

}  // namespace

ViewLabels label_views(const core::SceneBundle& bundle, const sim::RobotModel& robot,
                       const ViewLabelOptions& options, const fs::path& folder) {
  const sim::World world = sim::World::load(bundle, robot);
  return label_views({bundle, world, scenes::load_scene_surfels(bundle)}, options, folder);
}

ViewLabels label_views(const LabelledScene& scene, const ViewLabelOptions& options,
                       const fs::path& folder) {
  SEGSIM_CHECK(options.views > 0 || !options.drives.empty(), "neither views nor drives");
  SEGSIM_CHECK(!options.class_names.empty(), "no classes");
  const core::SceneManifest& manifest = scene.bundle.manifest;
  if (!scene.surfels.surfels->has_labels()) {
    throw core::InputError::expected(scene.bundle.surfels_file().string(), "labelled surfels",
                                     "no semantic_id property");
  }
  ViewLabels labels;
  const std::vector<core::SceneClass> classes =
      mapped_classes(manifest, options, labels.unmapped);
  ViewLabeller labeller(scene, options, classes, folder);
  scenes::ViewSampler sampler(scene.world, classes, options.class_names,
                              sampler_options(options));
  add_drives(scene.world, options, sampler, labeller, labels);

  std::unique_ptr<core::Progress> progress;
  if (options.show_progress && options.views > 0) {
    progress = std::make_unique<core::Progress>("label " + manifest.name, options.views);
  }
  const int max_tries = 60 * options.views;
  int added = 0;
  for (int i = 0; i < max_tries && added < options.views; ++i) {
    const auto [pose, wanted_instance] = sampler.next();
    if (sampler.is_near_duplicate(pose) || sampler.is_avoided(pose)) continue;
    if (!labeller.add(pose, wanted_instance)) continue;
    sampler.accept(pose);
    ++added;
    support::StopOnSignal::check();
    if (progress) progress->update(added);
    if (options.on_view) options.on_view();
  }
  labeller.finish(labels);
  return labels;
}

void append_dataset(perception::CocoDataset& all, const perception::CocoDataset& other) {
  if (all.images.empty()) {
    all = other;
    return;
  }
  SEGSIM_CHECK(all.class_names == other.class_names, "data sets of different classes");
  if (other.images.empty()) return;  // Nor does it show its places.
  for (perception::LabeledImage image : other.images) {
    image.id = static_cast<std::int64_t>(all.images.size()) + 1;
    all.images.push_back(std::move(image));
  }
  if (all.scenes && other.scenes) {
    all.scenes->insert(all.scenes->end(), other.scenes->begin(), other.scenes->end());
  } else {
    all.scenes.reset();
  }
}

}  // namespace segsim::experiments::detection
