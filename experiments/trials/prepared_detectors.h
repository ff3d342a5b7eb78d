#pragma once

/// @file
/// What the preparation of a run hands to its trials.

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "experiments/records/held_out_precision.h"
#include "experiments/specs/spec.h"
#include "experiments/specs/tuning_set.h"
#include "perception/data/dataset.h"

namespace segsim::experiments::trials {

struct PreparedWeights {
  std::filesystem::path file;                         ///< Empty if no arm needs them.
  std::optional<records::HeldOutPrecision> held_out;  ///< None if nothing was fine-tuned here.
  std::optional<records::StartLeak> start_leak;  ///< None if these were not fine-tuned here.
  std::shared_ptr<const perception::CocoDataset> tuned_on;  ///< The same.
};

/// Starts of a scene's evaluation episodes [m].
using Starts = std::vector<glm::dvec2>;

/// By the name of the arm, of those with detectors 'before' and 'after'; by prepared_key() of
/// those that are tuned scene by scene.
using PreparedDetectors = std::map<std::string, PreparedWeights>;

/// Where an arm's weights for a scene are. @param scene  Its name.
[[nodiscard]] inline std::string prepared_key(const specs::ArmSpec& arm,
                                              const std::string& scene) {
  return specs::is_tuned_by_scene(arm.detector) ? arm.name + "\n" + scene : arm.name;
}

}  // namespace segsim::experiments::trials
