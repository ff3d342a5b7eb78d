#pragma once

/// @file
/// RGB-D recording -> scene bundle: lifting and training (renderer), levelling, collision mesh
/// and navmesh (sim), label distributions, manifest.

#include <filesystem>
#include <optional>
#include <string>

#include "core/scene_bundle.h"
#include "experiments/scenes/bundle_shape.h"
#include "experiments/training/training_run.h"
#include "reconstruction/datasets/point_cloud_file.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/lifting/lifting.h"
#include "sim/ground/robot.h"
#include "worlds/surface/collision_mesh.h"

namespace segsim::experiments::scenes {

struct ReconstructOptions {
  std::string name;           ///< Of the scene.
  std::string source;         ///< Where the recording comes from, in words.
  std::string credits;        ///< Of the recording (read_credits()); goes into the bundle.
  std::string source_sha256;  ///< Of the recipe that made the recording; may be empty.
  reconstruction::LiftOptions lift;
  /// Surfels begin with this cloud (reconstruction/lifting/cloud_start.h) instead of the
  /// frames' depth.
  std::optional<reconstruction::PointCloud> start;
  /// None: lifting alone. Its `set` decides about held-out frames; `lift` follows it. Its
  /// `work` is filled in (<folder>.training) if empty.
  std::optional<training::TrainingOptions> training;
  /// Surfels that training starts from instead of the lifted ones, for example those that were
  /// trained elsewhere on an exported pack (PLY); empty: the lifted ones.
  std::filesystem::path surfels;
  std::filesystem::path pictures;  ///< robot_pictures() of the result (PNG); empty: none.
  MeshSource mesh = MeshSource::kAuto;
  SurfaceOptions surface;  ///< For MeshSource::kDepth.
  worlds::CollisionMeshOptions collision;
  sim::RobotModel robot = sim::RobotModel::jackal_gentle();
  double camera_height_m = 1.2;  ///< Mast height that suits the recording.
  /// Where the world origin is put on the earth. The default is the origin that the Jackal's
  /// own simulation uses (jackal.gazebo: 49.9 N, 8.9 E).
  core::GeodeticOrigin origin{49.9, 8.9, 0.0, 0.0};
};

/// Surfels to start from, with progress lines: the cloud's, or lifted from the frames' depth.
/// @throws core::InputError for frames without depth and no cloud.
[[nodiscard]] reconstruction::LiftResult lift_recording(
    const reconstruction::RgbdSequence& sequence, const reconstruction::LiftOptions& options,
    const std::optional<reconstruction::PointCloud>& cloud = {});

/// Makes the bundle in a temporary folder beside `folder` and renames it: a bundle is there
/// wholly or not at all. An existing bundle is replaced. Without training, frames held out by
/// `lift` are not looked at; with it, the manifest tells the quality on them. Without a floor
/// or room for the robot the bundle is for rendering and labels only, without pictures.
/// @throws core::InputError if frames cannot be read or have no depth to start from.
core::SceneBundle reconstruct_bundle(const reconstruction::RgbdSequence& sequence,
                                     const ReconstructOptions& options,
                                     const std::filesystem::path& folder);

/// Lifts, loads the frames as `options.training` says, and writes both to a training pack
/// (reconstruction/training/training_pack.h), to be trained on another machine. Makes no
/// bundle.
/// @throws core::InputError if frames have no depth or no labels.
void export_training_pack(const reconstruction::RgbdSequence& sequence,
                          const ReconstructOptions& options,
                          const std::filesystem::path& file);

}  // namespace segsim::experiments::scenes
