#pragma once

/// @file
/// Makes what the trials need and does not exist yet: scene bundles and detector weights.
/// Every step is skipped if its result lies there already, so an interrupted preparation goes
/// on.

#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include <glm/vec2.hpp>

#include "experiments/detection/arm_weights.h"
#include "experiments/runs/spec.h"

namespace segsim::experiments {

/// Makes the bundle of a scene if it does not exist: capture (mesh sources), lifting, labels,
/// collision mesh, navigation mesh.
/// @param work  Folder for intermediate files, below which nothing but this experiment writes.
/// @return  The bundle's folder.
/// @throws core::InputError if the bundle is missing and the scene names no source.
std::filesystem::path prepare_scene(const ExperimentSpec& spec, const SceneSpec& scene,
                                    const std::filesystem::path& work);

struct PreparedWeights {
  std::filesystem::path file;                ///< Empty if no arm needs them.
  std::optional<HeldOutPrecision> held_out;  ///< None if nothing was fine-tuned here.
};

/// Starts of a scene's evaluation episodes [m].
using Starts = std::vector<glm::dvec2>;

struct PreparedDetectors {
  PreparedWeights before, after;
  std::optional<StartLeak> start_leak;  ///< Of 'after'; none if nothing was fine-tuned here.
};

/// Makes the weights that the arms of the spec need: pre-training, then fine-tuning on views
/// rendered from the bundles of `spec.detectors.finetune->scenes`.
/// @param bundles  Result of prepare_scene for each of spec.scenes, in that order.
/// @param starts  Of each of them.
PreparedDetectors prepare_detectors(const ExperimentSpec& spec,
                                    std::span<const std::filesystem::path> bundles,
                                    std::span<const Starts> starts,
                                    const std::filesystem::path& work);

}  // namespace segsim::experiments
