#include "reconstruction/labels/internal/nearest_surfels.h"

#include <algorithm>
#include <cmath>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

namespace segsim::reconstruction::internal {
namespace {

constexpr int kMostRings = 6;  ///< Beyond them all surfels are compared.

std::uint64_t key_of(const glm::ivec3& cell) {
  std::uint64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    key = key << 21 | (static_cast<std::uint64_t>(cell[axis] + (1 << 20)) & 0x1fffff);
  }
  return key;
}

float distance2(const glm::vec3& a, const glm::vec3& b) {
  const glm::vec3 d = a - b;
  return glm::dot(d, d);
}

}  // namespace

NearestSurfels::NearestSurfels(const std::vector<glm::vec3>& position_m)
    : position_m_(position_m) {
  if (position_m.empty()) return;
  glm::vec3 low = position_m[0], high = low;
  for (const glm::vec3& p : position_m) low = glm::min(low, p), high = glm::max(high, p);
  // Surfels lie on surfaces, whose area is that of the box around them or a few times more: a
  // few surfels a cell.
  const glm::vec3 size = high - low;
  const float area = 2.0F * (size.x * size.y + size.y * size.z + size.z * size.x);
  const float spacing = std::sqrt(area / static_cast<float>(position_m.size()));
  cell_m_ = std::max({2.0F * spacing, 1e-6F * std::max({size.x, size.y, size.z}), 1e-6F});
  for (std::size_t i = 0; i < position_m.size(); ++i) {
    cells_[key_of(cell_of(position_m[i]))].push_back(static_cast<std::int32_t>(i));
  }
}

glm::ivec3 NearestSurfels::cell_of(const glm::vec3& p_m) const {
  return {glm::floor(p_m / cell_m_)};
}

void NearestSurfels::look_in(const glm::ivec3& cell, std::int64_t surfel,
                             std::vector<Found>& found) const {
  const auto at = cells_.find(key_of(cell));
  if (at == cells_.end()) return;
  const glm::vec3& p_m = position_m_[static_cast<std::size_t>(surfel)];
  for (const std::int32_t other : at->second) {
    if (other == surfel) continue;
    found.emplace_back(distance2(position_m_[static_cast<std::size_t>(other)], p_m), other);
  }
}

std::vector<std::int64_t> NearestSurfels::nearest(std::int64_t surfel, int count) const {
  const glm::vec3& p_m = position_m_[static_cast<std::size_t>(surfel)];
  const glm::ivec3 centre = cell_of(p_m);
  std::vector<Found> found;
  const auto enough = static_cast<std::size_t>(count);
  bool complete = false;
  for (int ring = 0; ring <= kMostRings && !complete; ++ring) {
    for (int x = -ring; x <= ring; ++x) {
      for (int y = -ring; y <= ring; ++y) {
        const bool side = std::abs(x) == ring || std::abs(y) == ring;
        for (int z = -ring; z <= ring; z += side || ring == 0 ? 1 : 2 * ring) {
          look_in(centre + glm::ivec3(x, y, z), surfel, found);
        }
      }
    }
    std::sort(found.begin(), found.end());
    const float reach = static_cast<float>(ring) * cell_m_;  // Nothing nearer is left out.
    complete = found.size() >= enough && found[enough - 1].first <= reach * reach;
  }
  if (!complete) {
    found.clear();
    for (std::size_t i = 0; i < position_m_.size(); ++i) {
      const auto other = static_cast<std::int64_t>(i);
      if (other != surfel) found.emplace_back(distance2(position_m_[i], p_m), other);
    }
    std::sort(found.begin(), found.end());
  }
  std::vector<std::int64_t> result;
  for (std::size_t i = 0; i < std::min(enough, found.size()); ++i) {
    result.push_back(found[i].second);
  }
  return result;
}

}  // namespace segsim::reconstruction::internal
