#include "sim/trial/environment/episode_pool.h"

#include <algorithm>
#include <mutex>
#include <numeric>
#include <utility>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {

struct EpisodePool::Goal {
  std::size_t episode = 0;  ///< The first one with it.
  std::once_flag once;
  std::shared_ptr<const DistanceField> field;
};

EpisodePool::EpisodePool(const World& world, std::vector<Episode> episodes)
    : world_(world), episodes_(std::move(episodes)) {
  SEGSIM_CHECK(!episodes_.empty(), "episodes");
  for (std::size_t i = 0; i < episodes_.size(); ++i) {
    const auto same = std::find_if(goals_.begin(), goals_.end(), [&](const auto& goal) {
      return episodes_[goal->episode].view_points_m == episodes_[i].view_points_m;
    });
    goal_of_.push_back(static_cast<std::size_t>(same - goals_.begin()));
    if (same != goals_.end()) continue;
    goals_.push_back(std::make_unique<Goal>());
    goals_.back()->episode = i;
  }
}

EpisodePool::~EpisodePool() = default;

std::shared_ptr<const DistanceField> EpisodePool::to_goal(std::size_t index) const {
  Goal& goal = *goals_[goal_of_[index]];
  std::call_once(goal.once, [&] {
    const std::vector<glm::dvec2>& places_m = episodes_[goal.episode].view_points_m;
    if (places_m.empty()) return;
    goal.field = std::make_shared<const DistanceField>(world_.distance_to(places_m));
  });
  return goal.field;
}

void EpisodeOrder::restart(std::uint64_t seed) {
  seed_ = seed;
  drawn_ = 0;
}

std::size_t EpisodeOrder::next() {
  const std::uint64_t k = drawn_++;
  if (kind_ == Kind::kInTurn) return (first_ + k * stride_) % episodes_;
  const std::size_t place = k % episodes_;
  if (place == 0) {
    core::RandomStream random(seed_, "episode_order", k / episodes_);
    round_.resize(episodes_);
    std::iota(round_.begin(), round_.end(), std::size_t{0});
    for (std::size_t left = episodes_; left > 1; --left) {
      std::swap(round_[left - 1], round_[random.index(static_cast<std::uint32_t>(left))]);
    }
  }
  return round_[place];
}

}  // namespace segsim::sim
