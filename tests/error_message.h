#pragma once

/// @file
/// What an action complains about.

#include <string>

#include "core/error.h"

namespace segsim::tests {

/// Message of the InputError that the action throws; "no error" if it throws nothing. Others
/// pass through: they are bugs, not bad input.
template <class Action>
std::string input_error_of(const Action& action) {
  try {
    action();
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "no error";
}

}  // namespace segsim::tests
