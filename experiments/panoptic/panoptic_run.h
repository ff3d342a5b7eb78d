#pragma once

/// @file
/// Trains and tests every head in every scene, and keeps what is finished:
///
///     <work>/<scene>/recording-<recipe>/   captured scenes
///     <work>/<scene>/masks/                simulated masks
///     <work>/<scene>/surfels.ply           trained shape and colour, shared by all heads
///     <work>/<scene>/<head>.json           figures (scene_figures.h): the pair is finished
///     <work>/<scene>/<stage>-<recipe>.training/   state of a stage under way, its preview
///
/// Each has a record of its recipe (step_record.h) and is made again if the recipe differs.

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "experiments/panoptic/panoptic_scenes.h"
#include "experiments/panoptic/scene_figures.h"
#include "reconstruction/training/geometry_training.h"
#include "reconstruction/training/training_config.h"

namespace segsim::experiments::panoptic {

inline constexpr const char* kJointSuffix = ":joint";

struct PanopticRunOptions {
  std::vector<PanopticScene> scenes;
  /// Of panoptic_head_names(); with kJointSuffix those of joint_head_names(), trained together
  /// with the surfels that the others find frozen.
  std::vector<std::string> heads;
  reconstruction::TrainingConfig config;
  /// Level of simulated masks (docs/masks.md), for scenes without masks of their own; none:
  /// exact labels.
  std::optional<double> mask_level;
  bool fit_masks = true;  ///< Scale the noise to the published quality first.
  reconstruction::GeometryDevice device;
  std::uint64_t seed = 1;
  int held_out_every = 8;
  std::filesystem::path work;
  /// After each pair, with all that are finished, in the order of heads, then scenes.
  std::function<void(const std::vector<SceneFigures>&)> on_result;
};

/// @return  All pairs, in the order of heads, then scenes.
/// @throws core::InputError: a recording without labels, depth or held-out views; a loss that
///     is not finite.
std::vector<SceneFigures> run_panoptic_scenes(const PanopticRunOptions& options);

/// Reduces scenes and training to what runs in seconds and says nothing about quality.
void make_quick(PanopticRunOptions& options);

}  // namespace segsim::experiments::panoptic
