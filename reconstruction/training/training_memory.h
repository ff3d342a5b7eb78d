#pragma once

/// @file
/// What training does when memory runs out.

#include <functional>
#include <string>

namespace segsim::reconstruction {

/// Runs the action. Memory that runs out, the host's or the GPU's, whoever asked for it,
/// becomes an error of the input, for what fills it is chosen there.
/// @param place  For the message: what was going on.
/// @param advice  What to lower; asked for when memory has run out.
/// @throws core::InputError "<place>: expected memory for it (<advice>), found <whose> full";
///     else what the action throws.
void with_memory_errors(const std::string& place, const std::function<std::string()>& advice,
                        const std::function<void()>& action);

}  // namespace segsim::reconstruction
