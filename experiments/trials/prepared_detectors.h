#pragma once

/// @file
/// What the preparation of a run hands to its trials.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "experiments/records/held_out_precision.h"
#include "experiments/specs/spec.h"
#include "experiments/specs/tuning_set.h"

namespace segsim::experiments::trials {

/// A view that a detector was tuned on.
struct TunedView {
  std::string scene;  ///< Its manifest's name.
  glm::dvec2 position_m{0.0};
  std::vector<std::string> classes;  ///< That have a box in it.
};

/// How many of the views of a scene were taken within `radius_m` of a place and show a class.
[[nodiscard]] inline int views_showing(const std::vector<TunedView>& views,
                                       const std::string& scene, const std::string& class_name,
                                       const glm::dvec2& at_m, double radius_m) {
  return static_cast<int>(
      std::count_if(views.begin(), views.end(), [&](const TunedView& view) {
        const glm::dvec2 way_m = view.position_m - at_m;
        return view.scene == scene && std::hypot(way_m.x, way_m.y) < radius_m &&
               std::find(view.classes.begin(), view.classes.end(), class_name) !=
                   view.classes.end();
      }));
}

struct PreparedWeights {
  std::filesystem::path file;                         ///< Empty if no arm needs them.
  std::optional<records::HeldOutPrecision> held_out;  ///< None if nothing was fine-tuned here.
  std::optional<records::StartLeak> start_leak;  ///< None if these were not fine-tuned here.
  std::shared_ptr<const std::vector<TunedView>> tuned_views;  ///< The same.
};

/// Starts of a scene's evaluation episodes [m].
using Starts = std::vector<glm::dvec2>;

/// By the name of the arm, of those with detectors 'before' and 'after'; by prepared_key() of
/// those that are tuned scene by scene.
using PreparedDetectors = std::map<std::string, PreparedWeights>;

/// Where an arm's weights for a scene are. @param scene  Its name.
[[nodiscard]] inline std::string prepared_key(const specs::ArmSpec& arm,
                                              const std::string& scene) {
  return specs::is_tuned_by_scene(arm.detector) ? arm.name + "\n" + scene : arm.name;
}

}  // namespace segsim::experiments::trials
