// A policy in C++, in a process of its own:
//
//     policy: {type: process, command: [build/release/examples/peer_policy]}
//
// Any core::Policy will do. This one looks around, drives towards the goal when the detector
// sees it, stops in front of it, and turns away from whatever stands in its way, by an angle
// of chance. The same in Python: peer_policy.py.
#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <optional>

#include "core/error.h"
#include "core/random.h"
#include "peers/serve.h"

using namespace segsim;

namespace {

class TurnAwayPolicy final : public core::Policy {
 public:
  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override {
    goal_ = goal;
    random_.emplace(seed, "turns");
    turn_until_s_ = 8.0;  // It looks around first.
  }

  core::Decision decide(const core::Observation& seen,
                        std::span<const core::Detection> detections) override {
    const core::Image<float>& depth_m = *seen.depth_m;
    double ahead_m = 10.0;
    for (int y = depth_m.height_px() / 3; y < 2 * depth_m.height_px() / 3; ++y) {
      for (int x = depth_m.width_px() / 3; x < 2 * depth_m.width_px() / 3; ++x) {
        // Where nothing was measured the depth is NaN, which is not the smaller one.
        ahead_m = std::min(ahead_m, static_cast<double>(depth_m(x, y)));
      }
    }
    for (const core::Detection& found : detections) {
      if (found.class_index != goal_.class_index) continue;
      const double x_px = 0.5 * (found.box.x0 + found.box.x1);
      const double left_rad =
          std::atan((seen.intrinsics.cx_px - x_px) / seen.intrinsics.fx_px);
      if (std::abs(left_rad) < 0.2 && ahead_m < 1.0) {
        return {{}, core::PolicyMode::kStop, core::StopReason::kGoalReached};
      }
      const double forward_mps = std::abs(left_rad) < 0.2 ? 0.4 : 0.0;
      return {{forward_mps, left_rad}, core::PolicyMode::kNavigate, {}};
    }
    const double now_s = core::seconds(seen.capture_time_ns);
    if (now_s > turn_until_s_ && ahead_m < 1.2) {
      turn_until_s_ = now_s + random_->uniform(0.5, 4.0);
    }
    if (now_s < turn_until_s_) return {{0.0, 0.8}, core::PolicyMode::kExplore, {}};
    return {{0.6, 0.0}, core::PolicyMode::kExplore, {}};
  }

  [[nodiscard]] core::PolicyView view() const override { return {}; }  // It keeps no map.

 private:
  core::ObjectGoal goal_;
  std::optional<core::RandomStream> random_;
  double turn_until_s_ = 0.0;
};

}  // namespace

int main() try {
  peers::Channel channel = peers::standard_streams();
  peers::serve_policy(
      channel, [](const peers::EpisodeStart&) { return std::make_unique<TurnAwayPolicy>(); });
  return 0;
} catch (const core::InputError& error) {
  std::cerr << "error: " << error.what() << '\n';
  return 2;
}
