#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/robot_base.h"
#include "core/stages.h"

namespace segsim::peers {

/// What a policy is told when an episode begins. The same as a policy inside the program may
/// know: nothing of the truth.
struct EpisodeStart {
  core::ObjectGoal goal;
  std::uint64_t seed = 0;                ///< All randomness of the policy derives from it.
  std::vector<std::string> class_names;  ///< Of the detector.
  core::RobotBase robot;
  double camera_height_m = 0.0;
};

}  // namespace segsim::peers
