#include "sim/trial/internal/robot_camera.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace segsim::sim::internal {

GoalView look_for_goal(const core::Frame& frame, const GoalObjects& goal) {
  GoalView view;
  if (goal.empty()) return view;
  std::vector<std::pair<std::uint16_t, int>>
      counts;  // Few instances of one class are in view.
  for (std::size_t k = 0; k < frame.semantic.size(); ++k) {
    const std::uint16_t id = frame.instance.pixels()[k];
    if (!goal.holds(frame.semantic.pixels()[k], id)) continue;
    ++view.pixels;
    auto found = std::find_if(counts.begin(), counts.end(),
                              [id](const auto& entry) { return entry.first == id; });
    if (found == counts.end()) found = counts.insert(counts.end(), {id, 0});
    view.largest_instance = std::max(view.largest_instance, ++found->second);
  }
  return view;
}

RobotCamera::RobotCamera(const TrialOptions& options, std::uint64_t seed)
    : options_(options),
      T_robot_camera_(
          core::mast_camera(options.camera_height_m, options.camera_pitch_down_rad)),
      seed_(seed) {
  if (options_.sensors) depth_model_ = options_.sensors->camera.depth;
  depth_model_.max_range_m = options_.depth_range_m;
}

void RobotCamera::render(core::Renderer& renderer, const core::Pose2& pose,
                         core::Channels channels, core::Frame& frame) const {
  const auto T_world_robot = core::transform_from_pose2<core::frame::World>(pose);
  renderer.render(T_world_robot * T_robot_camera_, options_.camera, channels, frame);
}

void RobotCamera::measure(std::uint64_t capture, const core::Image<float>& true_depth_m,
                          core::Image<float>& measured_m) const {
  measure_depth(depth_model_, options_.camera, PixelNoise(seed_, "camera/depth", capture),
                true_depth_m, measured_m);
}

}  // namespace segsim::sim::internal
