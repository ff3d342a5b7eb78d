#pragma once

/// @file
/// Stages whose answers depend on every pixel and number that they get, and no other: what
/// comes through another process can be compared to the bit.

#include <cmath>
#include <string>
#include <vector>

#include "core/stages.h"

namespace segsim::tests {

class SummingPolicy final : public core::Policy {
 public:
  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override {
    goal_ = goal;
    seed_ = seed;
    decisions_ = 0;
  }
  core::Decision decide(const core::Observation& seen,
                        std::span<const core::Detection> detections) override {
    double sum = static_cast<double>(seed_ % 1000 + goal_.phrase.size()) + goal_.class_index;
    if (seen.rgb != nullptr) {
      for (const core::Rgb8& p : seen.rgb->pixels()) sum = 0.999 * sum + p.r + 2 * p.g + p.b;
    }
    if (seen.depth_m != nullptr) {
      for (const float depth_m : seen.depth_m->pixels()) {
        sum = 0.999 * sum + (std::isnan(depth_m) ? 0.5 : static_cast<double>(depth_m));
      }
    }
    for (const core::Detection& d : detections) {
      sum += d.class_index + static_cast<double>(d.score + d.box.x0 * d.box.y1);
    }
    const core::Point<core::frame::Camera> ahead{{0.1, 0.2, 1.0}};
    const glm::dvec3 p_m = (seen.T_odom_camera() * ahead).xyz_m;
    sum += p_m.x + p_m.y * p_m.z + seen.intrinsics.fx_px / seen.intrinsics.cy_px +
           core::seconds(seen.capture_time_ns) + static_cast<double>(seen.capture_index);
    view_.path_m = {{sum, -sum}, {p_m.x, p_m.y}};
    view_.target_m = glm::dvec2(p_m.x, sum);
    core::Decision decision;
    decision.command = {std::sin(sum), std::cos(sum)};
    decision.mode = core::PolicyMode::kNavigate;
    if (++decisions_ == 3) decision.stop = core::StopReason::kNothingNew;
    return decision;
  }
  [[nodiscard]] core::PolicyView view() const override { return view_; }

 private:
  core::ObjectGoal goal_;
  std::uint64_t seed_ = 0;
  int decisions_ = 0;
  core::PolicyView view_;
};

class SummingDetector final : public core::Detector {
 public:
  [[nodiscard]] const std::vector<std::string>& class_names() const override { return names_; }
  std::vector<core::Detection> detect(const core::Observation& seen) override {
    int sum = 0;
    for (const core::Rgb8& p : seen.rgb->pixels()) sum = (31 * sum + p.r + p.g + p.b) % 9973;
    const float share = static_cast<float>(sum) / 9973.0F;
    return {{1, 0.5F + 0.5F * share, {share, 0.1F, 7.3F, 9.0F}},
            {0, 0.5F * share, {1, 2, 3, 4}}};
  }

 private:
  std::vector<std::string> names_{"chair", "couch"};
};

}  // namespace segsim::tests
