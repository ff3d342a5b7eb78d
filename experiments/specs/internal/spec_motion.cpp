// Who moves the robot: this program, or a Gazebo that runs beside it.
#include "experiments/specs/internal/spec_readers.h"
#include "experiments/support/numbers_in_range.h"

namespace segsim::experiments::specs::internal {

void read_motion(const core::ConfigNode& root, ExperimentSpec& spec) {
  const std::optional<core::ConfigNode> node = root.optional_child("motion");
  if (!node) return;
  (void)core::choice(*node, "type", {"gazebo"});
  sim::GazeboDriveOptions motion;
  motion.world = node->text("world");
  motion.model = node->text_or("model", motion.model);
  motion.pose_topic = node->text_or("pose_topic", "");
  motion.command_topic = node->text_or("command_topic", "");
  if (node->has("flavour")) {
    motion.flavour = static_cast<sim::GazeboFlavour>(
        core::choice(*node, "flavour", {"ignition", "gz", "both"}));
  }
  motion.patience_s =
      support::number_within(*node, "patience_s", motion.patience_s, 0.1, 3600.0);
  motion.most_lag_s =
      support::number_within(*node, "most_lag_s", motion.most_lag_s, 0.01, 60.0);
  node->finish();
  if (spec.clock.mode != sim::ClockMode::kRealtime) {
    node->fail("`clock: {mode: realtime}` beside motion by Gazebo, which does not wait",
               sim::to_string(spec.clock.mode));
  }
  if (spec.collision != sim::CollisionMode::kFootprint) {
    node->fail("`collision: footprint` beside motion by Gazebo", "navmesh");
  }
  if (spec.scenes.size() != 1) {
    node->fail("one scene and one reconstruction of it, as a world of Gazebo is one place",
               std::to_string(spec.scenes.size()) + " scenes");
  }
  if (root.has("replays") && spec.replays.of != Recorded::kNone) {
    root.child("replays").fail("`of: none`: a trial in Gazebo cannot be played again",
                               "replays");
  }
  spec.replays.of = Recorded::kNone;
  spec.motion = std::move(motion);
}

}  // namespace segsim::experiments::specs::internal
