#pragma once

/// @file
/// Somebody who watches a trial with the truth in hand: videos of it are made so.

#include <span>
#include <string>
#include <vector>

#include "core/render.h"
#include "core/stages.h"
#include "experiments/drawing/trial_picture.h"
#include "sim/trial/trial.h"

namespace segsim::experiments::trials {

/// Called in this order: begin(), observe() and add(), finish(); add() once per tick from the
/// first image on. What it is handed is borrowed for the call, but for the scene, which lives
/// until finish().
class TrialViewer {
 public:
  virtual ~TrialViewer() = default;
  virtual void begin(const drawing::TrialScene& scene,
                     const std::vector<std::string>& detector_classes) = 0;
  /// @param frame  With RGB and labels. @param view  In Odom, see TickRecord::estimate.
  virtual void add(const sim::TickRecord& tick, const core::Frame& frame,
                   std::span<const core::Detection> detections,
                   const core::PolicyView& view) = 0;
  /// @param result  Judged by the success rule of the spec.
  virtual void finish(const sim::TrialResult& result) = 0;
  /// An image came to the detector, which found that in it: what the camera delivered, with
  /// its errors, and no truth. Before the add() of the tick that uses it.
  virtual void observe(const core::Observation& /*seen*/,
                       std::span<const core::Detection> /*detections*/) {}
};

}  // namespace segsim::experiments::trials
