#pragma once

/// @file
/// What would make a whole run worthless is told before its trials.

#include <string>

#include "experiments/runs/prepare.h"
#include "experiments/specs/spec.h"

namespace segsim::experiments::runs::internal {

/// A goal that no detector of an arm knows would fail every trial without a word.
/// @throws core::InputError
void check_goals_known(const specs::ExperimentSpec& spec, const Inputs& inputs);

/// Whether Gazebo can move the robots of so many workers. @throws core::InputError
void check_motion(const specs::ExperimentSpec& spec, int workers);

/// Networks that policies and phrases name are read, and other programs started, before
/// anything is made.
/// @param workers  Of the run. @throws core::InputError
void check_policy_models(const specs::ExperimentSpec& spec, int workers);

/// New classes that a robot searches for by a head that no scene has taught: those of one
/// scene alone, where the detector is tuned on others. "Small house: wardrobe; ..."
[[nodiscard]] std::string untaught_goals(const specs::ExperimentSpec& spec,
                                         const Inputs& inputs);

}  // namespace segsim::experiments::runs::internal
