#pragma once

/// @file
/// One picture per trial: the scene from above, what the robot explored of it, the path that
/// it drove, what it took for the goal and where the goal really is.

#include <functional>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/scene_bundle.h"
#include "experiments/drawing/floor_plan.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::drawing {

/// A numbered place.
struct TrialMark {
  glm::dvec2 position_m{0.0};
  std::string text;
};

/// What a picture shows; borrowed while it is drawn.
struct TrialScene {
  const FloorPlan* plan = nullptr;
  const core::SceneManifest* manifest = nullptr;
  const sim::Episode* episode = nullptr;
  std::string scene_title, arm;
  int goal_index = -1;  ///< Of the goal class among the detector's classes; -1 if it has none.
  std::vector<glm::dvec2> shortest_path_m;  ///< Empty if not known.
  std::vector<TrialMark> marks{};
  /// Geodesic, from a place in World to the goal; empty: not told.
  std::function<double(const glm::dvec2&)> distance_m{};
  std::string cause{};  ///< Why it failed (failure_cause.h); empty: not told.
};

/// @param long_side_px  Of the map within the picture.
[[nodiscard]] core::Image<core::Rgb8> draw_trial(const TrialScene& scene,
                                                 const sim::TrialResult& result,
                                                 int long_side_px = 1000);

}  // namespace segsim::experiments::drawing
