#pragma once

/// @file
/// The detector of an arm: weights of this program, a model of others (docs/models.md), or
/// another program (docs/connect.md).

#include <memory>
#include <string>
#include <vector>

#include "core/stages.h"
#include "experiments/specs/spec.h"
#include "experiments/trials/prepared_detectors.h"
#include "experiments/trials/trial_runner.h"
#include "peers/peer.h"
#include "perception/data/compute_device.h"

namespace segsim::experiments::trials {

/// Whether the arm's detector is asked for the goals of each scene.
[[nodiscard]] bool is_prompted(const specs::ArmSpec& arm);

/// Where the experiment's networks run.
[[nodiscard]] perception::ComputeDevice compute_device(const specs::ExperimentSpec& spec);

/// The program that is the arm's detector, not yet started; null if it is none.
[[nodiscard]] std::shared_ptr<peers::Peer> detector_process(const specs::ArmSpec& arm,
                                                            const LoadedScene& scene);

/// @param arm  Not the oracle's.
/// @throws core::InputError if its file is missing or damaged, or its program cannot be
/// started.
[[nodiscard]] std::unique_ptr<core::Detector> load_arm_detector(
    const specs::ArmSpec& arm, const PreparedDetectors& detectors, const LoadedScene& scene,
    perception::ComputeDevice device);

/// The arm's second detector, asked for the goals of the scene if it takes a prompt.
/// @throws core::InputError if its file is missing or damaged.
[[nodiscard]] std::unique_ptr<core::Detector> load_open_detector(const specs::ArmSpec& arm,
                                                                 const LoadedScene& scene);

/// Classes of the goals of the scene's episodes, sorted.
[[nodiscard]] std::vector<std::string> searched_classes(const LoadedScene& scene);

/// Those of `goals` that are not among `known`: a robot could never find them.
[[nodiscard]] std::vector<std::string> unknown_goals(const std::vector<std::string>& goals,
                                                     const std::vector<std::string>& known);

}  // namespace segsim::experiments::trials
