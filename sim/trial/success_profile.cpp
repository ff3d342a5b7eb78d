#include "sim/trial/success_profile.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "sim/trial/metrics.h"

namespace segsim::sim {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kBarnSpeed_mps = 2.0;
constexpr double kSemExpGrowth_m = 1.0, kSemExpFirstStep_m = 1e-5;

std::string print(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

}  // namespace

const std::vector<SuccessProfile>& success_profiles() {
  using enum SuccessRule;
  static const std::vector<SuccessProfile> profiles{
      {"segsim-object", kViewPoint, 1.0, true, 40, kInfinity, false},
      {"habitat-hm3d", kViewPoint, 0.1, false, 40, kInfinity, true},
      {"apexnav", kViewPoint, 0.2, false, 40, kInfinity, true},
      {"semexp-gibson", kObjectArea, 0.0, false, 40, kInfinity, true},
      {"allenact-robothor", kInView, 0.0, true, 40, kInfinity, true},
      {"barn", kGoalPosition, 1.0, false, 40, 100.0, true},
  };
  return profiles;
}

const SuccessProfile* find_success_profile(const std::string& name) {
  for (const SuccessProfile& profile : success_profiles()) {
    if (profile.name == name) return &profile;
  }
  return nullptr;
}

std::string in_words(const SuccessProfile& profile) {
  const std::string in_view =
      "at least " + std::to_string(profile.visible_px) + " px of one goal object in view";
  switch (profile.rule) {
    case SuccessRule::kViewPoint:
      return "STOP within " + print(profile.distance_m) + " m (geodesic) of a view point" +
             (profile.require_visible ? " and " + in_view : std::string());
    case SuccessRule::kObjectArea:
      return "STOP within " + print(kSemExpGrowth_m) + " m of a goal object";
    case SuccessRule::kInView:
      return "STOP with " + in_view;
    case SuccessRule::kGoalPosition:
      return "at most " + print(profile.distance_m) + " m from a view point within " +
             print(profile.time_limit_s) + " s and without a contact";
  }
  return {};
}

bool succeeded(const SuccessProfile& profile, const TrialEnd& end) {
  const bool in_view = end.visible_px >= profile.visible_px;
  const bool stopped = profile.any_stop ? end.stopped : end.declared;
  switch (profile.rule) {
    case SuccessRule::kViewPoint:
      return stopped && end.view_point_m < profile.distance_m &&
             (in_view || !profile.require_visible);
    case SuccessRule::kObjectArea:
      return stopped && end.object_m == 0.0;
    case SuccessRule::kInView:
      return stopped && in_view;
    case SuccessRule::kGoalPosition:
      return end.planar_m <= profile.distance_m && end.contacts == 0 &&
             end.time_s < profile.time_limit_s;
  }
  return false;
}

double barn_score(bool success, double shortest_path_m, double time_s) {
  if (!success || !std::isfinite(shortest_path_m) || shortest_path_m <= 0.0) return 0.0;
  const double best_s = shortest_path_m / kBarnSpeed_mps;
  return best_s / std::clamp(time_s, 2.0 * best_s, 8.0 * best_s);
}

double profile_spl(const SuccessProfile& profile, const TrialEnd& end) {
  const bool success = succeeded(profile, end);
  switch (profile.rule) {
    case SuccessRule::kObjectArea: {
      if (!success || !std::isfinite(end.shortest_object_m)) return 0.0;
      const double path_m = kSemExpFirstStep_m + end.path_m;
      return std::min(1.0, (end.shortest_object_m + kSemExpGrowth_m) / path_m);
    }
    case SuccessRule::kGoalPosition:
      return barn_score(success, end.shortest_path_m, end.time_s);
    case SuccessRule::kViewPoint:
    case SuccessRule::kInView:
      return spl(success, end.shortest_path_m, end.path_m);
  }
  return 0.0;
}

}  // namespace segsim::sim
