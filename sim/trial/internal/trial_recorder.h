#pragma once

/// @file
/// Writes down what happened tick by tick, and chains it into the state hash.

#include "sim/trial/internal/trial_eye.h"

namespace segsim::sim::internal {

class TrialRecorder {
 public:
  /// @param goal_class  Into the detector's class names; -1: it cannot name the goal.
  /// @param observer  Called for each tick from the first image on; may be empty. Outlives the
  /// recorder, as the policy that it is shown does.
  TrialRecorder(int goal_class, const core::Policy& policy, const TickObserver& observer)
      : goal_class_(goal_class), policy_(policy), observer_(observer) {}

  /// The images at a tick; borrowed for the call.
  struct Images {
    const Capture* newest = nullptr;  ///< Null before the first one.
    bool goal_in_view = false;        ///< In the newest one.
    const Capture* in_use = nullptr;  ///< By the policy; null before the first decision.
  };
  /// Adds the next tick. @param record  With time, poses, contact, command, mode and
  /// freshness; the images fill in the rest.
  void add(TickRecord record, const Images& images);
  /// The program was late for a tick, in real time.
  void overrun() { ++overruns_; }

  /// Moves the ticks into the result, with all that was counted over them.
  void report(TrialResult& result);

 private:
  int goal_class_;
  const core::Policy& policy_;
  const TickObserver& observer_;
  std::vector<TickRecord> track_;
  std::uint64_t state_hash_ = 0;
  int first_visible_tick_ = -1, first_detected_tick_ = -1;
  DurationSamples age_;
  int ticks_without_image_ = 0, ticks_without_news_ = 0, overruns_ = 0;
};

}  // namespace segsim::sim::internal
