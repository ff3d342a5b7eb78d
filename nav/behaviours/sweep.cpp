#include "nav/behaviours/sweep.h"

#include <algorithm>

#include <glm/geometric.hpp>

namespace segsim::nav {

void Sweep::begin(const std::vector<glm::dvec2>& places_m, core::TimeNs time_ns) {
  places_m_.assign(places_m.begin(), places_m.end());
  start(time_ns);
}

/// The way to the first place begins.
void Sweep::start(core::TimeNs time_ns) {
  since_ns_ = time_ns;
  if (places_m_.empty()) return;
  visited_m_.push_back(places_m_.front());
  ++count_;
}

std::optional<glm::dvec2> Sweep::place_m() const {
  if (places_m_.empty()) return std::nullopt;
  return places_m_.front();
}

void Sweep::leave(core::TimeNs time_ns) {
  if (places_m_.empty()) return;
  places_m_.pop_front();
  start(time_ns);
}

bool Sweep::late(core::TimeNs time_ns) const {
  return !places_m_.empty() && core::seconds(time_ns - since_ns_) > options_.patience_s;
}

bool Sweep::visited(const glm::dvec2& place_m) const {
  return std::any_of(visited_m_.begin(), visited_m_.end(), [&](const glm::dvec2& other_m) {
    return glm::distance(other_m, place_m) < options_.apart_m;
  });
}

}  // namespace segsim::nav
