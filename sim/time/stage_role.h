#pragma once

/// @file
/// What a stage of a latency budget stands for. Budgets name their stages as they like; five
/// names mean something to the program.

#include <cstdint>
#include <string_view>

namespace segsim::sim {

enum class StageRole : std::uint8_t {
  kCapture,  ///< "capture": makes the image.
  kRender,   ///< "render": what this program needs to make it.
  kDetect,   ///< "detect": runs the detector.
  kPolicy,   ///< "policy": decides.
  kActuate,  ///< "actuate": carries the command to the wheels.
  kOther,    ///< Any other name: takes time, and is nothing that the program does.
};

[[nodiscard]] StageRole stage_role(std::string_view name);
/// The name of a role's stage; of kOther, "other".
[[nodiscard]] const char* to_string(StageRole role);

}  // namespace segsim::sim
