#pragma once

/// @file
/// Makes what the trials need and does not exist yet: scene bundles and detector weights.
/// Every step is skipped if its result lies there already, so an interrupted preparation goes
/// on.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "experiments/specs/spec.h"
#include "experiments/support/stage_times.h"
#include "experiments/trials/prepared_detectors.h"

namespace segsim::experiments::runs {

/// Makes the bundle of a scene if it does not exist: capture (mesh sources), lifting, labels,
/// collision mesh, navigation mesh.
/// @param work  Folder for intermediate files, below which nothing but this experiment writes.
/// @return  The bundle's folder.
/// @throws core::InputError if the bundle is missing and the scene names no source.
std::filesystem::path prepare_scene(const specs::ExperimentSpec& spec,
                                    const specs::SceneSpec& scene,
                                    const std::filesystem::path& work);

/// The same for all scenes of the spec, up to `workers` of them side by side. What comes out
/// does not depend on how many.
/// @return  A folder for each of spec.scenes, in that order.
std::vector<std::filesystem::path> prepare_scenes(const specs::ExperimentSpec& spec,
                                                  const std::filesystem::path& work,
                                                  int workers, support::StageTimes& times);

/// Makes the weights that the arms of the spec need: pre-training, then fine-tuning on views
/// rendered from the bundles of `spec.detectors.finetune->scenes`, once for each
/// reconstruction and seed. Up to `workers` / `finetune->threads` trainings run side by side;
/// the result does not depend on how many.
/// @param bundles  Result of prepare_scenes.
/// @param starts  Of each of them.
trials::PreparedDetectors prepare_detectors(const specs::ExperimentSpec& spec,
                                            std::span<const std::filesystem::path> bundles,
                                            std::span<const trials::Starts> starts,
                                            const std::filesystem::path& work, int workers,
                                            support::StageTimes& times);

}  // namespace segsim::experiments::runs
