#include "reconstruction/segmentation/room_parts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "renderer/scene/depth_normal.h"

namespace segsim::reconstruction {
namespace {

constexpr double kLevelCosine = 0.9, kUprightSine = 0.2;
constexpr int kDirections = 120;  ///< Of upright planes: one every 3 degrees.
constexpr double kSlot_m = 0.1;   ///< Of distances of planes from the origin.
constexpr double kSameWay = 0.9;  ///< Cosine between a plane's normal and its elements'.
constexpr int kMostPlanes = 400;

/// An upright plane: normal . p = offset_m.
struct Plane {
  glm::dvec3 normal;
  double offset_m;
};

/// The direction of an upright element in [0, kDirections).
int direction_of(const glm::dvec3& normal) {
  const double turn = std::atan2(normal.y, normal.x) / (2.0 * std::numbers::pi);
  const int direction = static_cast<int>(std::lround((turn + 1.0) * kDirections));
  return direction % kDirections;
}

glm::dvec3 normal_of(int direction) {
  const double angle_rad = 2.0 * std::numbers::pi * direction / kDirections;
  return {std::cos(angle_rad), std::sin(angle_rad), 0.0};
}

/// Elements vote for planes of their direction and the two beside it. The plane with most
/// votes; of equals the first in order of direction and distance.
std::pair<Plane, std::size_t> best_plane(std::span<const SurfaceElement> elements,
                                         const std::vector<std::uint32_t>& pool) {
  std::map<std::pair<int, int>, std::size_t> votes;
  for (const std::uint32_t i : pool) {
    const int own = direction_of(elements[i].normal);
    for (int turn = -1; turn <= 1; ++turn) {
      const int direction = (own + turn + kDirections) % kDirections;
      const double offset_m = glm::dot(normal_of(direction), elements[i].position_m);
      ++votes[{direction, static_cast<int>(std::floor(offset_m / kSlot_m))}];
    }
  }
  std::pair<int, int> best{0, 0};
  std::size_t most = 0;
  for (const auto& [slot, count] : votes) {
    if (count > most) best = slot, most = count;
  }
  return {{normal_of(best.first), (best.second + 0.5) * kSlot_m}, most};
}

std::vector<std::uint32_t> elements_on(const Plane& plane, double distance_m,
                                       std::span<const SurfaceElement> elements,
                                       const std::vector<std::uint32_t>& pool) {
  std::vector<std::uint32_t> on;
  for (const std::uint32_t i : pool) {
    if (std::abs(glm::dot(plane.normal, elements[i].position_m) - plane.offset_m) <=
            distance_m &&
        glm::dot(plane.normal, elements[i].normal) >= kSameWay) {
      on.push_back(i);
    }
  }
  return on;
}

/// Through the mean of the elements, along their mean normal made upright.
Plane fitted(std::span<const SurfaceElement> elements, const std::vector<std::uint32_t>& on,
             const Plane& before) {
  glm::dvec3 normal(0.0), mean_m(0.0);
  for (const std::uint32_t i : on) {
    normal += elements[i].normal;
    mean_m += elements[i].position_m;
  }
  normal.z = 0.0;
  const double length = glm::length(normal);
  if (on.empty() || !(length > 0.0)) return before;
  normal /= length;
  return {normal, glm::dot(normal, mean_m) / static_cast<double>(on.size())};
}

/// Elements of a plane that hang together, within `gap` cells along the plane and up.
std::vector<std::vector<std::uint32_t>> connected_pieces(
    std::span<const SurfaceElement> elements, const std::vector<std::uint32_t>& on,
    const Plane& plane, double cell_m, int gap) {
  const glm::dvec3 along(-plane.normal.y, plane.normal.x, 0.0);
  std::map<std::pair<int, int>, std::vector<std::uint32_t>> cells;
  for (const std::uint32_t i : on) {
    cells[{static_cast<int>(std::floor(glm::dot(along, elements[i].position_m) / cell_m)),
           static_cast<int>(std::floor(elements[i].position_m.z / cell_m))}]
        .push_back(i);
  }
  std::vector<std::vector<std::uint32_t>> pieces;
  while (!cells.empty()) {
    std::vector<std::pair<int, int>> stack{cells.begin()->first};
    pieces.emplace_back(std::move(cells.begin()->second));
    cells.erase(cells.begin());
    while (!stack.empty()) {
      const auto [s, z] = stack.back();
      stack.pop_back();
      for (int ds = -gap; ds <= gap; ++ds) {
        for (int dz = -gap; dz <= gap; ++dz) {
          const auto found = cells.find({s + ds, z + dz});
          if (found == cells.end()) continue;
          pieces.back().insert(pieces.back().end(), found->second.begin(),
                               found->second.end());
          stack.push_back(found->first);
          cells.erase(found);
        }
      }
    }
  }
  return pieces;
}

glm::ivec3 cell_of(const glm::dvec3& p_m, double element_m) {
  constexpr double kFarthest = (1 << 20) - 2;
  return glm::ivec3(glm::clamp(glm::floor(p_m / element_m), -kFarthest, kFarthest));
}

std::uint64_t packed(const glm::ivec3& cell) {
  const auto part = [](int v) { return static_cast<std::uint64_t>(v + (1 << 20)); };
  return part(cell.x) << 42U | part(cell.y) << 21U | part(cell.z);
}

}  // namespace

void FacingPoints::add_view(const core::Image<float>& depth_m,
                            const core::CameraIntrinsics& intrinsics,
                            const core::CameraPose& T_world_camera, int step) {
  SEGSIM_CHECK(step >= 1, std::to_string(step));
  const core::Image<glm::vec3> normals =
      renderer::depth_normals(depth_m, intrinsics, T_world_camera);
  const glm::vec3 from_m(T_world_camera.translation_m());
  constexpr float kSteep = 0.7F;
  for (int y = step / 2; y < depth_m.height_px(); y += step) {
    for (int x = step / 2; x < depth_m.width_px(); x += step) {
      const glm::vec3& n = normals(x, y);
      if (glm::dot(n, n) == 0.0F) continue;
      const core::Point<core::frame::World> p =
          T_world_camera * core::Point<core::frame::Camera>{
                               intrinsics.back_project({x + 0.5, y + 0.5}, depth_m(x, y))};
      std::size_t way = n.z > 0.0F ? 0 : 1;
      if (std::abs(n.z) < kSteep) {
        way = std::abs(n.x) > std::abs(n.y) ? (n.x > 0.0F ? 2 : 3) : (n.y > 0.0F ? 4 : 5);
      }
      seen_[way].push_back({glm::vec3(p.xyz_m), from_m});
    }
  }
}

bool FacingPoints::empty() const {
  return std::all_of(seen_.begin(), seen_.end(), [](const auto& s) { return s.empty(); });
}

std::vector<SurfaceElement> FacingPoints::elements(double element_m) const {
  std::vector<SurfaceElement> all;
  for (const auto& seen : seen_) {
    const std::vector<SurfaceElement> some = surface_elements(seen, element_m);
    all.insert(all.end(), some.begin(), some.end());
  }
  return all;
}

RoomParts::RoomParts(std::span<const SurfaceElement> elements, const RoomPartOptions& options,
                     double element_m)
    : options_(options),
      element_m_(element_m),
      elements_(elements.begin(), elements.end()),
      part_(elements.size(), RoomPart::kNone) {
  SEGSIM_CHECK(element_m > 0.0, std::to_string(element_m));
  find_level_parts();
  find_walls();
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    if (part_[i] == RoomPart::kNone) continue;
    const glm::ivec3 cell = cell_of(elements_[i].position_m, element_m_);
    for (int k = 0; k < 27; ++k) {
      near_[packed(cell + glm::ivec3(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1))].push_back(
          static_cast<std::uint32_t>(i));
    }
  }
}

void RoomParts::find_level_parts() {
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    const SurfaceElement& e = elements_[i];
    if (e.normal.z > kLevelCosine && std::abs(e.position_m.z) <= options_.floor_band_m) {
      part_[i] = RoomPart::kFloor;
    } else if (e.normal.z < -kLevelCosine && e.position_m.z >= options_.ceiling_above_m) {
      part_[i] = RoomPart::kCeiling;
    }
  }
}

void RoomParts::find_walls() {
  std::vector<std::uint32_t> pool;
  for (std::size_t i = 0; i < elements_.size(); ++i) {
    if (std::abs(elements_[i].normal.z) <= kUprightSine) {
      pool.push_back(static_cast<std::uint32_t>(i));
    }
  }
  const double fewest = options_.wall_area_m2 / (element_m_ * element_m_);
  const int gap = std::max(1, static_cast<int>(std::lround(options_.gap_m / element_m_)));
  for (int round = 0; round < kMostPlanes && !pool.empty(); ++round) {
    auto [plane, votes] = best_plane(elements_, pool);
    if (static_cast<double>(votes) < fewest) break;
    for (int fit = 0; fit < 2; ++fit) {
      plane = fitted(elements_, elements_on(plane, options_.plane_distance_m, elements_, pool),
                     plane);
    }
    std::vector<std::uint32_t> on =
        elements_on(plane, options_.plane_distance_m, elements_, pool);
    if (on.empty()) break;
    for (const auto& piece : connected_pieces(elements_, on, plane, element_m_, gap)) {
      double top_m = -std::numeric_limits<double>::infinity();
      for (const std::uint32_t i : piece) {
        top_m = std::max(top_m, elements_[i].position_m.z);
      }
      if (static_cast<double>(piece.size()) < fewest || top_m < options_.wall_top_m) continue;
      for (const std::uint32_t i : piece) part_[i] = RoomPart::kWall;
    }
    std::vector<std::uint32_t> rest;
    std::set_difference(pool.begin(), pool.end(), on.begin(), on.end(),
                        std::back_inserter(rest));
    pool = std::move(rest);
  }
}

RoomPart RoomParts::at(const glm::dvec3& p_m, const glm::vec3& normal,
                       double distance_m) const {
  const auto cell = near_.find(packed(cell_of(p_m, element_m_)));
  if (cell == near_.end()) return RoomPart::kNone;
  const bool normal_known = glm::dot(normal, normal) > 0.0F;
  RoomPart nearest = RoomPart::kNone;
  double least_m = distance_m;
  for (const std::uint32_t i : cell->second) {
    const SurfaceElement& e = elements_[i];
    if (normal_known && glm::dot(glm::dvec3(normal), e.normal) < options_.least_cosine) {
      continue;
    }
    const double off_m = std::abs(glm::dot(e.normal, p_m - e.position_m));
    if (off_m < least_m) nearest = part_[i], least_m = off_m;
  }
  return nearest;
}

core::Image<RoomPart> RoomParts::of_view(const core::Image<float>& depth_m,
                                         const core::CameraIntrinsics& intrinsics,
                                         const core::CameraPose& T_world_camera) const {
  SEGSIM_CHECK(
      depth_m.width_px() == intrinsics.width_px && depth_m.height_px() == intrinsics.height_px,
      "intrinsics of the depth image");
  core::Image<RoomPart> parts(depth_m.width_px(), depth_m.height_px(), RoomPart::kNone);
  const core::Image<glm::vec3> normals =
      renderer::depth_normals(depth_m, intrinsics, T_world_camera);
  for (int y = 0; y < depth_m.height_px(); ++y) {
    for (int x = 0; x < depth_m.width_px(); ++x) {
      const double d_m = depth_m(x, y);
      if (!(d_m > 0.0) || !std::isfinite(d_m)) continue;
      const core::Point<core::frame::World> p =
          T_world_camera *
          core::Point<core::frame::Camera>{intrinsics.back_project({x + 0.5, y + 0.5}, d_m)};
      parts(x, y) =
          at(p.xyz_m, normals(x, y), options_.distance_m + options_.distance_per_depth * d_m);
    }
  }
  return parts;
}

}  // namespace segsim::reconstruction
