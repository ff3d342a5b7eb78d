#pragma once

/// @file
/// Lifted surfels -> trained surfels with labels: geometry first, then a panoptic head on the
/// frozen result, or together with it (docs/training.md). Long, so it can be stopped and gone
/// on with:
///
///     <work>/geometry.state, <work>/head.state   everything that training needs to go on;
///     <work>/joint.state                         the surfels that belong to a head's state
///     <work>/preview.png                         rendered | recorded | panoptic, every few s
///     <work>/surfels.ply, cameras.txt            the scene so far, to look at
///     <work>/losses.csv                          iteration, losses, surfels, seconds

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/scene_bundle.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "reconstruction/training/geometry_training.h"
#include "reconstruction/training/training_config.h"
#include "reconstruction/training/training_evaluation.h"
#include "reconstruction/training/training_set.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::experiments::training {

struct TrainingOptions {
  reconstruction::TrainingConfig config;
  std::string head = "query";  ///< panoptic_head_names(), or "none": shape and colour only.
  /// The head and the surfels learn together (joint_training.h), on the CPU.
  bool joint = false;
  std::filesystem::path masks;  ///< Folder of per-view masks; empty: the recording's labels.
  reconstruction::TrainingSetOptions set;
  reconstruction::GeometryDevice device;
  std::uint64_t seed = 1;
  std::filesystem::path work;   ///< Folder of the state.
  bool resume = false;          ///< Go on from the state if there is one; else begin anew.
  bool align_held_out = false;  ///< Also test at poses that fit the surfels best.
  double time_limit_s = 0.0;    ///< > 0: geometry may use 60 % of it, the head the rest.
  double checkpoint_every_s = 60.0, preview_every_s = 15.0;
};

struct TrainedScene {
  renderer::SurfelCloud surfels;                 ///< With ids if a head was trained.
  std::optional<renderer::PanopticModel> model;  ///< Of query heads.
  /// Label distributions of the surfels; nullptr without a head.
  std::shared_ptr<const renderer::PanopticField> field;
  std::vector<core::SceneClass> classes;
  std::vector<core::SceneInstance> instances;
  reconstruction::HeldOutQuality quality;
  std::optional<reconstruction::HeldOutQuality> aligned_quality;  ///< With align_held_out.
  /// T_world_camera of the training views; empty unless training moved them.
  std::vector<core::CameraPose> refined_poses;
  std::vector<std::pair<std::string, double>> statistics;  ///< For the manifest.
};

/// Loads frames and masks as the options say.
[[nodiscard]] reconstruction::TrainingSet load_set(
    const reconstruction::RgbdSequence& recording, const TrainingOptions& options);

/// @param start  From lift() of the training frames, or start_from_cloud().
/// @throws core::InputError: a state of another run, no GPU; a loss that is not finite or too
///     little memory, with the last state kept.
[[nodiscard]] TrainedScene train_scene(const reconstruction::TrainingSet& set,
                                       const renderer::SurfelCloud& start,
                                       const TrainingOptions& options);

/// @throws core::InputError if these options cannot train jointly, and are to.
void check_joint(const TrainingOptions& options);

/// What a state belongs to: other settings, frames or seeds are another run.
[[nodiscard]] std::string training_identity(const TrainingOptions& options,
                                            const reconstruction::TrainingSet& set,
                                            const renderer::SurfelCloud& start);

/// Removes what is only good until the bundle is there; pictures and losses stay.
void remove_training_state(const std::filesystem::path& work);

}  // namespace segsim::experiments::training
