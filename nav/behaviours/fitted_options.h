#pragma once

/// @file
/// Options of maps, planners, followers and behaviours for one robot. Each function takes the
/// options that are wanted and replaces what the robot decides: its shape sets distances, its
/// limits bound speeds from above.

#include "core/robot_base.h"
#include "nav/behaviours/recovery.h"
#include "nav/grid/robot_fit.h"
#include "nav/mapping/occupancy_map.h"
#include "nav/motion/discrete_motion.h"
#include "nav/motion/path_follower.h"
#include "nav/planning/approach.h"
#include "nav/planning/cost_map.h"

namespace segsim::nav {

[[nodiscard]] OccupancyOptions fitted(OccupancyOptions options, const core::RobotBase& robot);
[[nodiscard]] CostMapOptions fitted(CostMapOptions options, const core::RobotBase& robot);
[[nodiscard]] FollowerOptions fitted(FollowerOptions options, const core::RobotBase& robot);
[[nodiscard]] DiscreteMotionOptions fitted(DiscreteMotionOptions options,
                                           const core::RobotBase& robot);
[[nodiscard]] RecoveryOptions fitted(RecoveryOptions options, const core::RobotBase& robot);
[[nodiscard]] ApproachDistances fitted(ApproachDistances distances,
                                       const core::RobotBase& robot);

}  // namespace segsim::nav
