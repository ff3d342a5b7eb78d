#include "nav/frontier/value_search.h"

#include <cmath>

namespace segsim::nav {
namespace {

class ValueSearch final : public core::Policy {
 public:
  explicit ValueSearch(const ValueSearchOptions& options)
      : options_(options), values_(std::make_shared<ValueMap>(options.values)) {
    if (options_.scorer == nullptr) options_.scorer = make_constant_scorer();
    FrontierPolicyOptions frontier = options_.frontier;
    frontier.scorer = [values = values_, nearest = make_nearest_scorer(frontier.selector),
                       radius_m = options_.value_radius_m, weight_m = options_.value_weight_m,
                       unseen = options_.unseen_value](const Frontier& f) {
      const double value = values->median_around(f.waypoint_m, radius_m).value_or(unseen);
      return nearest(f) + weight_m * value;
    };
    search_ = make_frontier_policy(frontier);
  }

  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override {
    goal_ = goal;
    values_->reset();
    search_->reset(goal, seed);
  }
  core::Decision decide(const core::Observation& observation,
                        std::span<const core::Detection> detections) override {
    values_->update(observation, options_.scorer->score(observation, detections, goal_));
    return search_->decide(observation, detections);
  }
  [[nodiscard]] core::PolicyView view() const override { return search_->view(); }

 private:
  ValueSearchOptions options_;
  core::ObjectGoal goal_;
  std::shared_ptr<ValueMap> values_;
  std::unique_ptr<core::Policy> search_;
};

}  // namespace

std::unique_ptr<core::Policy> make_value_search(const ValueSearchOptions& options) {
  return std::make_unique<ValueSearch>(options);
}

}  // namespace segsim::nav
