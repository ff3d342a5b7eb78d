#pragma once

/// @file
/// Actions as Python gives them.

#include <span>
#include <vector>

#include <nanobind/nanobind.h>

#include "sim/trial/environment/discrete_actions.h"
#include "sim/trial/environment/object_nav_environment.h"

namespace segsim::python {

class ActionArrays {
 public:
  /// STOP of a continuous action lies above.
  static constexpr double kStopAbove = 0.5;

  /// @param array  Integers [count] with `discrete`, which outlives this; else numbers
  ///     [count, 3]: metres and radians per second, and STOP.
  /// @throws core::InputError naming what is wrong.
  ActionArrays(nanobind::handle array, const sim::DiscreteActions* discrete,
               std::size_t count);
  ActionArrays(const ActionArrays&) = delete;
  ActionArrays& operator=(const ActionArrays&) = delete;

  [[nodiscard]] std::span<const sim::EnvironmentAction> actions() const { return actions_; }

 private:
  std::vector<core::VelocityCommand> commands_;  ///< That continuous actions refer to.
  std::vector<sim::EnvironmentAction> actions_;
};

}  // namespace segsim::python
