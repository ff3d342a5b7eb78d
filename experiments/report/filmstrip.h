#pragma once

/// @file
/// A trial in one picture: at each moment worth looking at, what the camera saw, how the scene
/// is labelled there, and how far the robot had come.

#include "core/image.h"
#include "core/render.h"
#include "core/scene_bundle.h"
#include "experiments/drawing/floor_plan.h"
#include "experiments/records/store.h"
#include "experiments/records/trial_log.h"

namespace segsim::experiments::report {

/// One column for the start and for each of key_moments(): camera image with the goal's boxes
/// and detections, panoptic image, map with the path so far.
/// @param log  With at least one tick. @param renderer  Of the scene.
[[nodiscard]] core::Image<core::Rgb8> draw_filmstrip(const records::TrialRow& trial,
                                                     const records::TrialLog& log,
                                                     const core::SceneManifest& manifest,
                                                     const drawing::FloorPlan& plan,
                                                     core::Renderer& renderer);

}  // namespace segsim::experiments::report
