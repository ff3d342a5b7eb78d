#pragma once

/// @file
/// Makes what the trials need and does not exist yet: scene bundles and detector weights.
/// Every step is skipped if its result lies there already, so an interrupted preparation goes
/// on.

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "experiments/specs/spec.h"
#include "experiments/support/stage_times.h"
#include "experiments/trials/prepared_detectors.h"
#include "experiments/trials/trial_runner.h"

namespace segsim::experiments::runs {

/// Makes the bundle of a scene if it does not exist: capture (mesh sources), lifting, labels,
/// collision mesh, navigation mesh.
/// @param work  Folder for intermediate files, below which nothing but this experiment writes.
/// @return  The bundle's folder.
/// @throws core::InputError if the bundle is missing and the scene names no source.
std::filesystem::path prepare_scene(const specs::ExperimentSpec& spec,
                                    const specs::SceneSpec& scene,
                                    const std::filesystem::path& work);

/// What the trials need.
struct Inputs {
  std::vector<trials::LoadedScene> scenes;  ///< As many as spec.scenes, in that order.
  trials::PreparedDetectors detectors;
  /// Goals that the detector 'before' does not know and fine-tuning teaches.
  std::vector<std::string> new_classes;
  /// What fine-tuning learns scenes from whose labels come from masks: by name, in words, and
  /// the folders of those bundles.
  std::map<std::string, std::string> masks;
  std::vector<std::filesystem::path> learnt_bundles;
};

/// Makes what is missing, and loads it: scenes and their episodes, views of them, weights
/// (those of a spec that fine-tunes once for each reconstruction and seed). Up to `workers`
/// things are made side by side, each as soon as what it needs is there; what comes out does
/// not depend on how many.
/// @param spec  Outlives the result.
/// @throws core::InputError if something is missing that nothing makes.
[[nodiscard]] Inputs prepare_inputs(const specs::ExperimentSpec& spec,
                                    const std::filesystem::path& work, int workers,
                                    support::StageTimes& times);

}  // namespace segsim::experiments::runs
