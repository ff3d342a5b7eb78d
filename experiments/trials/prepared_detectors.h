#pragma once

/// @file
/// What the preparation of a run hands to its trials.

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "experiments/records/held_out_precision.h"

namespace segsim::experiments::trials {

struct PreparedWeights {
  std::filesystem::path file;                         ///< Empty if no arm needs them.
  std::optional<records::HeldOutPrecision> held_out;  ///< None if nothing was fine-tuned here.
  std::optional<records::StartLeak> start_leak;  ///< None if these were not fine-tuned here.
};

/// Starts of a scene's evaluation episodes [m].
using Starts = std::vector<glm::dvec2>;

/// By the name of the arm: those with detectors 'before' and 'after'.
using PreparedDetectors = std::map<std::string, PreparedWeights>;

}  // namespace segsim::experiments::trials
