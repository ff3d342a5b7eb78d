#include "experiments/results/trial_insights.h"

#include <algorithm>
#include <map>

namespace segsim::experiments::results {
namespace {

std::optional<double> median(std::vector<int> values) {
  if (values.empty()) return std::nullopt;
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

}  // namespace

const ProfileRate* TrialInsights::by_rule(std::string_view profile) const {
  for (const ProfileRate& rate : profiles) {
    if (rate.profile == profile) return &rate;
  }
  return nullptr;
}

TrialInsights gain_insights(std::span<const records::TrialRow* const> trials) {
  TrialInsights insights;
  std::map<std::string, int> causes;
  std::vector<int> delays;
  int misplaced = 0;
  bool misplaced_known = true;
  for (const sim::SuccessProfile& profile : sim::success_profiles()) {
    insights.profiles.push_back({profile.name, 0, 0.0});
  }
  sim::SuccessProfile any_stop;
  any_stop.any_stop = true;
  for (const records::TrialRow* trial : trials) {
    const records::Attribution& why = trial->why;
    if (!trial->counts() || !why.known()) continue;
    ++insights.trials;
    if (!trial->success) ++causes[to_string(*why.cause)];
    insights.frames += why.images >= 0 ? why.images : trial->ticks;
    insights.visible_frames += why.visible_frames;
    insights.detected_frames += why.detected_frames;
    insights.false_detections += why.false_detections;
    insights.false_clouds += why.false_clouds;
    misplaced += std::max(0, why.misplaced_clouds);
    misplaced_known = misplaced_known && why.misplaced_clouds >= 0;
    insights.collision_ticks += why.collision_ticks;
    if (why.visible_frames > 0) {
      ++insights.saw_goal;
      if (why.first_true_tick < 0) ++insights.never_detected;
    }
    if (trial->first_visible_tick >= 0 && why.first_true_tick >= 0) {
      delays.push_back(why.first_true_tick - trial->first_visible_tick);
    }
    const sim::TrialEnd end = records::trial_end(*trial);
    insights.any_stop_successes += sim::succeeded(any_stop, end) ? 1 : 0;
    std::size_t k = 0;
    for (const sim::SuccessProfile& profile : sim::success_profiles()) {
      insights.profiles[k].successes += sim::succeeded(profile, end) ? 1 : 0;
      insights.profiles[k].spl += sim::profile_spl(profile, end);
      ++k;
    }
  }
  insights.delay_ticks = median(std::move(delays));
  insights.causes.assign(causes.begin(), causes.end());
  std::stable_sort(insights.causes.begin(), insights.causes.end(),
                   [](const auto& x, const auto& y) { return x.second > y.second; });
  const double n = std::max(1, insights.trials);
  insights.false_clouds /= n;
  if (misplaced_known) insights.misplaced_clouds = misplaced / n;
  insights.collision_ticks /= n;
  for (ProfileRate& rate : insights.profiles) rate.spl /= n;
  if (insights.trials == 0) insights.profiles.clear();
  return insights;
}

}  // namespace segsim::experiments::results
