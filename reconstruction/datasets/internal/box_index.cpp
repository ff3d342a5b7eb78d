#include "reconstruction/datasets/internal/box_index.h"

#include <algorithm>
#include <cmath>

#include <glm/common.hpp>

namespace segsim::reconstruction::internal {
namespace {

constexpr double kMostCells = 1e6;    // Boxes far apart get larger cells.
constexpr double kMostEntries = 1e7;  // So do many boxes that fill all cells.

struct Ranked {
  int rank;  ///< 0 floor, 1 object, 2 other slab.
  OrientedBox box;
  BoxLabel label;
};

std::vector<Ranked> rank_boxes(const BoxAnnotation& annotation, double margin_m) {
  std::vector<Ranked> ranked;
  for (const AnnotatedBox& annotated : annotation.boxes) {
    BoxLabel label;
    for (const core::SceneClass& entry : annotation.classes) {
      if (entry.name == annotated.class_name) label.class_id = entry.id;
    }
    if (annotated.structure) {
      ranked.push_back({annotated.class_name == "floor" ? 0 : 2, annotated.box, label});
      continue;
    }
    label.instance_id = annotated.id;
    for (OrientedBox box :
         annotated.parts.empty() ? std::vector{annotated.box} : annotated.parts) {
      ranked.push_back({1, box, label});
    }
  }
  std::stable_sort(ranked.begin(), ranked.end(), [](const Ranked& a, const Ranked& b) {
    return a.rank != b.rank ? a.rank < b.rank : a.box.volume_m3() < b.box.volume_m3();
  });
  for (Ranked& entry : ranked) {
    if (entry.rank == 1) entry.box.size_m += 2.0 * margin_m;
  }
  return ranked;
}

}  // namespace

BoxIndex::BoxIndex(const BoxAnnotation& annotation, double margin_m) {
  std::vector<glm::dvec3> lows, highs;
  for (const Ranked& entry : rank_boxes(annotation, margin_m)) {
    candidates_.push_back({entry.box.center_m, 0.5 * entry.box.size_m,
                           std::cos(entry.box.yaw_rad), std::sin(entry.box.yaw_rad),
                           entry.label});
    lows.push_back(entry.box.world_min_m());
    highs.push_back(entry.box.world_max_m());
  }
  if (!candidates_.empty()) build_grid(lows, highs);
}

void BoxIndex::build_grid(const std::vector<glm::dvec3>& lows,
                          const std::vector<glm::dvec3>& highs) {
  glm::dvec3 low = lows.front(), high = highs.front();
  for (std::size_t i = 1; i < lows.size(); ++i) {
    low = glm::min(low, lows[i]);
    high = glm::max(high, highs[i]);
  }
  origin_m_ = low;
  const glm::dvec3 extent_m = high - low;
  cell_m_ = std::max(cell_m_, std::cbrt(extent_m.x * extent_m.y * extent_m.z / kMostCells));
  // A long row of boxes has a small volume and still many cells. What the index answers does
  // not depend on its cells.
  while (cells_along(extent_m) > kMostCells || entries(lows, highs) > kMostEntries) {
    cell_m_ *= 2.0;
  }
  size_ = glm::ivec3(glm::ceil(extent_m / cell_m_)) + 1;
  cells_.resize(static_cast<std::size_t>(size_.x) * static_cast<std::size_t>(size_.y) *
                static_cast<std::size_t>(size_.z));
  for (std::size_t i = 0; i < lows.size(); ++i) {
    const glm::ivec3 first((lows[i] - origin_m_) / cell_m_);
    const glm::ivec3 last((highs[i] - origin_m_) / cell_m_);
    for (int z = first.z; z <= last.z; ++z) {
      for (int y = first.y; y <= last.y; ++y) {
        for (int x = first.x; x <= last.x; ++x) {
          cells_[static_cast<std::size_t>((z * size_.y + y) * size_.x + x)].push_back(
              static_cast<std::uint16_t>(i));
        }
      }
    }
  }
}

double BoxIndex::cells_along(const glm::dvec3& extent_m) const {
  const glm::dvec3 cells = glm::ceil(extent_m / cell_m_) + 1.0;
  return cells.x * cells.y * cells.z;
}

double BoxIndex::entries(const std::vector<glm::dvec3>& lows,
                         const std::vector<glm::dvec3>& highs) const {
  double sum = 0.0;
  for (std::size_t i = 0; i < lows.size(); ++i) sum += cells_along(highs[i] - lows[i]);
  return sum;
}

bool BoxIndex::Candidate::contains(const glm::dvec3& point_m) const {
  const glm::dvec3 d = point_m - center_m;
  return std::abs(d.x * cos_yaw + d.y * sin_yaw) <= half_m.x &&
         std::abs(d.y * cos_yaw - d.x * sin_yaw) <= half_m.y && std::abs(d.z) <= half_m.z;
}

std::int64_t BoxIndex::cell_of(const glm::dvec3& point_m) const {
  const glm::dvec3 cell = glm::floor((point_m - origin_m_) / cell_m_);
  if (!(cell.x >= 0 && cell.y >= 0 && cell.z >= 0 && cell.x < size_.x && cell.y < size_.y &&
        cell.z < size_.z)) {
    return -1;
  }
  return (static_cast<std::int64_t>(cell.z) * size_.y + static_cast<std::int64_t>(cell.y)) *
             size_.x +
         static_cast<std::int64_t>(cell.x);
}

BoxLabel BoxIndex::at(const glm::dvec3& point_m) const {
  const std::int64_t cell = cell_of(point_m);
  if (cell < 0) return {};
  for (const std::uint16_t i : cells_[static_cast<std::size_t>(cell)]) {
    if (candidates_[i].contains(point_m)) return candidates_[i].label;
  }
  return {};
}

}  // namespace segsim::reconstruction::internal
