#include "experiments/scenes/reconstruct.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <span>

#include <glm/gtc/quaternion.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "core/version.h"
#include "experiments/scenes/bundle_folder.h"
#include "experiments/scenes/coverage.h"
#include "experiments/scenes/robot_pictures.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/scenes/scene_surfels.h"
#include "experiments/support/stop_signal.h"
#include "perception/data/image_file.h"
#include "reconstruction/lifting/cloud_start.h"
#include "reconstruction/training/training_pack.h"
#include "renderer/cpu_renderer.h"
#include "renderer/files/panoptic_field_file.h"
#include "renderer/files/ply_io.h"
#include "renderer/renderer_backend.h"
#include "renderer/scene/surfel_transform.h"
#include "sim/ground/world.h"

namespace segsim::experiments::scenes {
namespace {

namespace fs = std::filesystem;

std::vector<glm::vec3> surfel_normals(const renderer::SurfelCloud& surfels) {
  std::vector<glm::vec3> normals;
  normals.reserve(surfels.size());
  for (const glm::quat& R_world_surfel : surfels.R_world_surfel) {
    normals.push_back(R_world_surfel * glm::vec3(0.0F, 0.0F, 1.0F));
  }
  return normals;
}

/// Those of the options, without the frames that training holds out.
reconstruction::LiftOptions lift_options_of(const ReconstructOptions& options) {
  reconstruction::LiftOptions lift_options = options.lift;
  if (!options.training) return lift_options;
  lift_options.held_out_every = options.training->set.held_out_every;
  lift_options.frame_step = options.training->set.frame_step;
  return lift_options;
}

/// What goes into the bundle.
struct Scene {
  renderer::SurfelCloud surfels;
  std::optional<renderer::PanopticModel> model;
  std::shared_ptr<const renderer::PanopticField> field;
  std::vector<core::SceneClass> classes;
  std::vector<core::SceneInstance> instances;
  std::vector<std::pair<std::string, double>> statistics;
  /// T_world_camera by frame of the recording, of those that training moved.
  std::map<std::size_t, core::CameraPose> refined_poses;
};

fs::path training_folder(const ReconstructOptions& options, const fs::path& folder) {
  return options.training->work.empty() ? fs::path(folder.string() + ".training")
                                        : options.training->work;
}

Scene trained(const reconstruction::RgbdSequence& sequence,
              const reconstruction::LiftResult& lifted, const ReconstructOptions& options,
              const fs::path& folder) {
  training::TrainingOptions training = *options.training;
  training.work = training_folder(options, folder);
  const reconstruction::TrainingSet set = training::load_set(sequence, training);
  const renderer::SurfelCloud start =
      options.surfels.empty() ? lifted.surfels : renderer::read_surfels_ply(options.surfels);
  int& sh_degree = training.config.geometry.sh_degree;
  sh_degree = std::max(sh_degree, start.sh_degree);
  training::TrainedScene result = training::train_scene(set, start, training);
  std::printf("%s\n", result.quality.text().c_str());
  if (result.aligned_quality) {
    std::printf("at aligned poses: %s\n", result.aligned_quality->text().c_str());
  }
  Scene scene{std::move(result.surfels),
              std::move(result.model),
              std::move(result.field),
              std::move(result.classes),
              std::move(result.instances),
              lifted.statistics.listing(),
              {}};
  if (!scene.surfels.has_labels()) {
    scene.classes.clear();
  } else if (training.head == "none") {  // Those of the lift, which survived.
    scene.instances = lifted.instances;
  }
  scene.statistics.insert(scene.statistics.end(), result.statistics.begin(),
                          result.statistics.end());
  for (std::size_t i = 0; i < result.refined_poses.size(); ++i) {
    scene.refined_poses[set.training[i].frame] = result.refined_poses[i];
  }
  return scene;
}

/// The cameras of the frames that the scene was made from, where training left them.
core::CameraPath camera_path(const reconstruction::RgbdSequence& sequence,
                             const reconstruction::LiftOptions& options,
                             const std::map<std::size_t, core::CameraPose>& refined) {
  core::CameraPath path{sequence.intrinsics(), {}};
  for (const std::size_t i :
       reconstruction::split_frames(sequence.frame_count(), options.frame_step,
                                    options.held_out_every)
           .used) {
    const auto moved = refined.find(i);
    path.views.push_back(
        {moved == refined.end() ? sequence.pose(i) : moved->second, sequence.frame_name(i)});
  }
  return path;
}

/// By the source that was asked for. Training moves surfels to please pictures, so that their
/// centres are no measurement any more; where they hide the light is.
SceneShape shape_of(const Scene& scene, const core::CameraPath& cameras,
                    const ReconstructOptions& options, SceneShape lifted) {
  const bool depth = options.mesh == MeshSource::kDepth ||
                     (options.mesh == MeshSource::kAuto && options.training);
  if (!depth) return lifted;
  const auto renderer = renderer::make_renderer(
      options.training ? options.training->device.backend : renderer::Backend::kCpu,
      std::make_shared<const renderer::SurfelCloud>(scene.surfels));
  return fuse_rendered_depth(*renderer, cameras.intrinsics, cameras.poses(), options.surface);
}

/// Moves the scene along with its shape.
void follow(const core::SceneLevelling& levelling, Scene& scene) {
  const glm::dquat& R = levelling.R_world_source;
  const glm::dvec3& t_m = levelling.p_world_source_m;
  if (R == glm::dquat(1.0, 0.0, 0.0, 0.0) && t_m == glm::dvec3(0.0)) return;
  renderer::transform_surfels(R, t_m, scene.surfels);
  if (scene.model) renderer::transform_panoptic_model(R, t_m, *scene.model);
  scene.instances = reconstruction::instance_boxes(scene.surfels, scene.instances);
}

/// Draws the finished bundle from where a robot can stand; the figures join the manifest.
void add_coverage(const fs::path& folder, const Scene& scene,
                  std::span<const glm::dvec3> camera_positions_m,
                  const ReconstructOptions& options, core::SceneManifest& manifest) {
  const sim::World world = sim::World::load(core::load_bundle(folder), options.robot);
  const auto renderer = renderer::make_cpu_renderer(
      std::make_shared<const renderer::SurfelCloud>(scene.surfels), {}, scene.field);
  const auto figures = robot_coverage(*renderer, world, manifest.camera_height_m).listing();
  manifest.statistics.insert(manifest.statistics.end(), figures.begin(), figures.end());
  const std::string warning = coverage_warning(manifest);
  if (!warning.empty()) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  if (options.pictures.empty()) return;
  RobotPictureOptions pictures;
  pictures.mast_height_m = manifest.camera_height_m;
  perception::write_image(options.pictures,
                          robot_pictures(*renderer, world, camera_positions_m, pictures));
}

}  // namespace

reconstruction::LiftResult lift_recording(
    const reconstruction::RgbdSequence& sequence, const reconstruction::LiftOptions& options,
    const std::optional<reconstruction::PointCloud>& cloud) {
  std::unique_ptr<core::Progress> progress;
  std::string current;
  const auto report = [&](const std::string& stage, std::int64_t done, std::int64_t total) {
    if (stage != current) {
      current = stage;
      progress = std::make_unique<core::Progress>("lift: " + stage, total);
    }
    progress->update(done);
    support::StopOnSignal::check();
  };
  if (cloud) return reconstruction::start_from_cloud(*cloud, sequence, options, report);
  if (!sequence.has_depth()) {
    throw core::InputError::expected(sequence.name(),
                                     "frames with depth, or a cloud to start from (--start)",
                                     "colour alone");
  }
  return reconstruction::lift(sequence, options, report);
}

core::SceneBundle reconstruct_bundle(const reconstruction::RgbdSequence& sequence,
                                     const ReconstructOptions& options,
                                     const fs::path& folder) {
  for (const std::string& warning : sequence.warnings()) {
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  }
  const reconstruction::LiftOptions lift_options = lift_options_of(options);
  reconstruction::LiftResult lifted = lift_recording(sequence, lift_options, options.start);
  SceneShape lifted_shape;
  lifted_shape.points_m = lifted.surfels.position_m;
  lifted_shape.normals = surfel_normals(lifted.surfels);
  lifted_shape.camera_positions_m = lifted.camera_positions_m;
  lifted_shape.source = "lifted points";
  Scene scene;
  if (options.training) {
    scene = trained(sequence, lifted, options, folder);
  } else {
    scene = {std::move(lifted.surfels),
             std::nullopt,
             nullptr,
             lifted.classes,
             lifted.instances,
             lifted.statistics.listing(),
             {}};
  }
  core::CameraPath cameras = camera_path(sequence, lift_options, scene.refined_poses);
  SceneShape shape = shape_of(scene, cameras, options, std::move(lifted_shape));
  core::BundleParts parts;
  parts.levelling = level_shape(shape);
  follow(parts.levelling, scene);
  move_cameras(parts.levelling, cameras);
  decimate_shape(shape, options.surface.max_error_m);

  write_bundle_folder(folder, [&](const fs::path& temporary) {
    core::SceneManifest manifest;
    manifest.name = options.name;
    manifest.created_by = std::string("segsim ") + core::version();
    manifest.source = options.source;
    manifest.source_sha256 = options.source_sha256;
    manifest.origin = options.origin;
    manifest.camera_height_m = options.camera_height_m;
    manifest.classes = scene.classes;
    manifest.instances = scene.instances;
    manifest.surfels.name = "surfels.ply";
    manifest.statistics = scene.statistics;
    manifest.statistics.emplace_back("surfels", static_cast<double>(scene.surfels.size()));
    manifest.statistics.emplace_back("frames_skipped",
                                     static_cast<double>(sequence.warnings().size()));
    worlds::CollisionMeshOptions collision = options.collision;
    const reconstruction::WorldPlacement* placement = sequence.placement();
    if (placement != nullptr &&
        placement->floor_source == reconstruction::FloorSource::kGuessed) {
      manifest.statistics.emplace_back("floor_guessed", 1.0);
      collision.floor_is_known = true;  // It was not seen, but walls tell where it is.
    }

    renderer::write_surfels_ply(temporary / manifest.surfels.name, scene.surfels);
    parts.labels.name = write_label_files(temporary, scene.model, scene.field);
    parts.cameras.name = core::kCamerasFileName;
    core::write_camera_path(temporary / parts.cameras.name, cameras);
    for (const std::string& warning :
         write_shape(temporary, shape, options.robot, collision, manifest, parts)) {
      std::fprintf(stderr, "warning: %s\n", warning.c_str());
    }
    if (!options.credits.empty()) {
      core::write_file_atomically(temporary / kCreditsFileName,
                                  [&](std::ostream& out) { out << options.credits; });
    }
    core::write_bundle_manifest(temporary, manifest, parts);
    if (options.training && !parts.rendering_only) {
      add_coverage(temporary, scene, shape.camera_positions_m, options, manifest);
      core::write_bundle_manifest(temporary, manifest, parts);
    }
  });
  if (options.training) training::remove_training_state(training_folder(options, folder));
  return core::load_bundle(folder);
}

void export_training_pack(const reconstruction::RgbdSequence& sequence,
                          const ReconstructOptions& options, const fs::path& file) {
  SEGSIM_CHECK(options.training.has_value(), "a pack is for training");
  if (!sequence.has_masks()) {
    throw core::InputError::expected(
        sequence.name(), "labels (a capture, a labelled data set, or --boxes)", "none");
  }
  if (sequence.sensor() != reconstruction::DepthSensor::kUnstated) {
    std::fprintf(stderr,
                 "warning: a pack does not hold --sensor: train_pack weighs all depth "
                 "alike\n");
  }
  const reconstruction::LiftResult lifted =
      lift_recording(sequence, lift_options_of(options), options.start);
  reconstruction::write_training_pack(file, training::load_set(sequence, *options.training),
                                      lifted.surfels);
}

}  // namespace segsim::experiments::scenes
