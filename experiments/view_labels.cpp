#include "experiments/view_labels.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <numbers>

#include "core/check.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/random.h"
#include "core/render.h"
#include "experiments/scene_surfels.h"
#include "perception/image_file.h"
#include "renderer/cpu_renderer.h"
#include "renderer/ply_io.h"
#include "sim/episode_sampling.h"
#include "sim/world.h"

namespace segsim::experiments {
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

/// Places and directions for the camera, drawn until the scene is exhausted.
class ViewSampler {
 public:
  ViewSampler(const sim::World& world, const ViewLabelOptions& options)
      : world_(world), options_(options), random_(options.seed, "label_views") {
    const sim::FreeSpace& space = world.free_space();
    for (int y = 0; y < space.island.height_px(); ++y) {
      for (int x = 0; x < space.island.width_px(); ++x) {
        if (space.island(x, y) == 1) cells_.push_back(space.frame.center_m(x, y));
      }
    }
    if (cells_.empty()) {
      throw core::InputError::expected(world.manifest().name, "room for the robot", "none");
    }
    for (const core::SceneInstance& instance : world.manifest().instances) {
      const std::string name = world.manifest().class_name(instance.class_id);
      const auto& names = options.class_names;
      if (std::find(names.begin(), names.end(), name) != names.end()) {
        objects_by_class_[instance.class_id].push_back(&instance);
      }
    }
  }

  struct View {
    core::Pose2 pose;
    std::uint16_t wanted_instance = 0;  ///< That the view was made for; 0 = none.
  };

  View next() {
    const glm::dvec2 p_m = cells_[random_.index(static_cast<std::uint32_t>(cells_.size()))];
    core::Pose2 pose{p_m.x, p_m.y, random_.uniform(-std::numbers::pi, std::numbers::pi)};
    if (objects_by_class_.empty() || !random_.chance(options_.share_facing_object))
      return {pose};
    // A class first, then one of its objects: frequent classes would dominate otherwise.
    auto entry = objects_by_class_.begin();
    std::advance(entry, random_.index(static_cast<std::uint32_t>(objects_by_class_.size())));
    const core::SceneInstance& object =
        *entry->second[random_.index(static_cast<std::uint32_t>(entry->second.size()))];
    const glm::dvec3 centre = 0.5 * (object.box_min_m + object.box_max_m);
    for (int attempt = 0; attempt < 40; ++attempt) {
      const glm::dvec2 q_m = cells_[random_.index(static_cast<std::uint32_t>(cells_.size()))];
      if (std::hypot(q_m.x - centre.x, q_m.y - centre.y) > options_.max_object_distance_m) {
        continue;
      }
      pose = sim::facing(q_m, object.box_min_m, object.box_max_m);
      pose.yaw_rad = core::wrap_angle_rad(pose.yaw_rad + random_.uniform(-0.4, 0.4));
      return {pose, object.id};
    }
    return {pose};
  }

  [[nodiscard]] bool is_near_duplicate(const core::Pose2& pose) const {
    return std::any_of(accepted_.begin(), accepted_.end(), [&](const core::Pose2& other) {
      return std::hypot(pose.x_m - other.x_m, pose.y_m - other.y_m) <
                 options_.near_duplicate_m &&
             std::abs(core::wrap_angle_rad(pose.yaw_rad - other.yaw_rad)) <
                 options_.near_duplicate_rad;
    });
  }
  void accept(const core::Pose2& pose) { accepted_.push_back(pose); }

 private:
  const sim::World& world_;
  const ViewLabelOptions& options_;
  core::RandomStream random_;
  std::vector<glm::dvec2> cells_;
  std::map<std::uint16_t, std::vector<const core::SceneInstance*>> objects_by_class_;
  std::vector<core::Pose2> accepted_;
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

}  // namespace

perception::CocoDataset label_views(const core::SceneBundle& bundle,
                                    const sim::RobotModel& robot,
                                    const ViewLabelOptions& options, const fs::path& folder) {
  SEGSIM_CHECK(options.views > 0 && !options.class_names.empty(), "views and classes");
  const sim::World world = sim::World::load(bundle, robot);
  auto surfels =
      std::make_shared<SurfelCloud>(renderer::read_surfels_ply(bundle.surfels_file()));
  if (!surfels->has_labels()) {
    throw core::InputError::expected(bundle.surfels_file().string(), "labelled surfels",
                                     "no semantic_id property");
  }
  const auto view_renderer =
      renderer::make_cpu_renderer(surfels, {}, load_scene_labels(bundle, *surfels));
  InstanceRenderers alone(surfels);
  ViewSampler sampler(world, options);
  const auto T_robot_camera =
      core::mast_camera(options.camera_height_m, options.camera_pitch_down_rad);

  perception::CocoDataset dataset;
  dataset.folder = folder;
  dataset.class_names = options.class_names;
  core::Frame frame;
  std::unique_ptr<core::Progress> progress;
  if (options.show_progress) {
    progress =
        std::make_unique<core::Progress>("label " + bundle.manifest.name, options.views);
  }
  const int max_tries = 60 * options.views;
  for (int i = 0; i < max_tries && static_cast<int>(dataset.images.size()) < options.views;
       ++i) {
    const auto [pose, wanted_instance] = sampler.next();
    if (sampler.is_near_duplicate(pose)) continue;
    view_renderer->render(
        core::transform_from_pose2<core::frame::World>(pose) * T_robot_camera, options.camera,
        core::Channels::kRgbd | core::Channels::kLabels, frame);
    if (!is_useful(frame, options)) continue;
    const std::map<std::uint16_t, int> pixels = count_pixels(frame.instance);
    // A wall may stand between: such views would leave rare classes without examples.
    if (wanted_instance != 0 && (!pixels.contains(wanted_instance) ||
                                 pixels.at(wanted_instance) < options.min_wanted_pixels)) {
      continue;
    }
    sampler.accept(pose);

    perception::LabelView view{&frame.semantic, &frame.instance, &frame.depth_m, {}};
    for (const auto& [id, visible] : pixels) {
      const int all = std::max(visible, alone.unoccluded_pixels(id, frame));
      view.visible_fraction[id] = static_cast<double>(visible) / all;
    }
    perception::LabeledImage image;
    image.id = static_cast<std::int64_t>(dataset.images.size()) + 1;
    char name[32];
    std::snprintf(name, sizeof name, "%05d.png", static_cast<int>(image.id));
    image.file = "images/" + options.prefix + name;
    image.width_px = options.camera.width_px;
    image.height_px = options.camera.height_px;
    image.boxes = perception::label_boxes(view, bundle.manifest.classes, options.class_names,
                                          options.boxes);
    perception::write_image(folder / image.file, frame.rgb);
    dataset.images.push_back(std::move(image));
    if (progress) progress->update(static_cast<std::int64_t>(dataset.images.size()));
  }
  return dataset;
}

void append_dataset(perception::CocoDataset& all, const perception::CocoDataset& other) {
  if (all.images.empty()) {
    all = other;
    return;
  }
  SEGSIM_CHECK(all.class_names == other.class_names, "data sets of different classes");
  for (perception::LabeledImage image : other.images) {
    image.id = static_cast<std::int64_t>(all.images.size()) + 1;
    all.images.push_back(std::move(image));
  }
}

}  // namespace segsim::experiments
