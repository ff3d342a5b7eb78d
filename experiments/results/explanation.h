#pragma once

/// @file
/// The story of one trial: what happened when, why it failed, and the images that show it.

#include <string>
#include <vector>

#include "core/image.h"
#include "core/render.h"
#include "core/scene_bundle.h"
#include "experiments/drawing/floor_plan.h"
#include "experiments/records/store.h"
#include "experiments/records/trial_log.h"

namespace segsim::experiments::results {

/// A moment worth looking at.
struct KeyMoment {
  int tick = 0;
  std::string what;  ///< "first in view, first detected": all that it is.
};

/// First view of the goal, first true and first false detection, the decisive tick, the tick
/// from which on it could not succeed, the end; in order of time, equal ticks merged.
[[nodiscard]] std::vector<KeyMoment> key_moments(const records::TrialRow& trial,
                                                 const records::TrialLog& log);

/// Lines of text for a terminal, without pictures.
[[nodiscard]] std::vector<std::string> tell_story(const records::TrialRow& trial,
                                                  const records::TrialLog& log);

/// The path from above, as draw_trial(), with the key moments as numbers.
[[nodiscard]] core::Image<core::Rgb8> draw_story_map(const records::TrialRow& trial,
                                                     const records::TrialLog& log,
                                                     const core::SceneManifest& manifest,
                                                     const drawing::FloorPlan& plan);

/// What the camera saw at the key moments: goal objects outlined, detections of its class
/// dashed. @param renderer  Of the scene.
[[nodiscard]] core::Image<core::Rgb8> draw_story_frames(const records::TrialRow& trial,
                                                        const records::TrialLog& log,
                                                        const core::SceneManifest& manifest,
                                                        core::Renderer& renderer);

}  // namespace segsim::experiments::results
