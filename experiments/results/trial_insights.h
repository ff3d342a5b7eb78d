#pragma once

/// @file
/// What a group of trials says beyond its success rate: why trials failed, what perception had
/// to do with it, and how the rate reads under other success rules. For tables.

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "experiments/records/store.h"
#include "sim/trial/success_profile.h"

namespace segsim::experiments::results {

/// Trials by a profile's rule; its own SPL (profile_spl()), mean over trials.
struct ProfileRate {
  std::string profile;
  int successes = 0;
  double spl = 0.0;
};

struct TrialInsights {
  int trials = 0;  ///< That enter rates and have an attribution.
  std::vector<std::pair<std::string, int>> causes;  ///< Of failures, most frequent first.
  // Perception, over all images that the policies of these trials decided on.
  int frames = 0, visible_frames = 0, detected_frames = 0;
  int false_detections = 0;
  int saw_goal = 0;                   ///< Trials with the goal in view at some time.
  int never_detected = 0;             ///< Of these, without a true detection.
  std::optional<double> delay_ticks;  ///< Median, first view to first true detection.
  double false_clouds = 0.0;          ///< Per trial, at its end.
  /// The same; none if a trial is older than the difference to false ones.
  std::optional<double> misplaced_clouds;
  double collision_ticks = 0.0;  ///< Per trial.
  /// By segsim-object, were a STOP for any reason good enough for it as for other rules.
  int any_stop_successes = 0;
  std::vector<ProfileRate> profiles;  ///< Of success_profiles(); empty without trials.

  /// Null without trials.
  [[nodiscard]] const ProfileRate* by_rule(std::string_view profile) const;
  /// Of the images that show the goal; none if there is no such image.
  [[nodiscard]] std::optional<double> recall() const {
    if (visible_frames == 0) return std::nullopt;
    return static_cast<double>(detected_frames) / visible_frames;
  }
};

[[nodiscard]] TrialInsights gain_insights(std::span<const records::TrialRow* const> trials);

}  // namespace segsim::experiments::results
