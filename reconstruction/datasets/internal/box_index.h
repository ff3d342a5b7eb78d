#pragma once

/// @file
/// Which annotated box holds a point: a coarse grid lists the few candidates of each cell.

#include <cstdint>
#include <vector>

#include <glm/vec3.hpp>

#include "reconstruction/datasets/box_annotation.h"

namespace segsim::reconstruction::internal {

struct BoxLabel {
  std::uint16_t class_id = 0, instance_id = 0;
  bool operator==(const BoxLabel&) const = default;
};

class BoxIndex {
 public:
  /// @param margin_m  Added around objects, not around slabs.
  BoxIndex(const BoxAnnotation& annotation, double margin_m);

  /// Floor slabs first, then objects and parts by volume, then the other slabs by volume.
  [[nodiscard]] BoxLabel at(const glm::dvec3& point_m) const;

 private:
  struct Candidate {
    glm::dvec3 center_m, half_m;
    double cos_yaw, sin_yaw;
    BoxLabel label;
    [[nodiscard]] bool contains(const glm::dvec3& point_m) const;
  };

  void build_grid(const std::vector<glm::dvec3>& lows, const std::vector<glm::dvec3>& highs);
  /// Of a block of this size, at most.
  [[nodiscard]] double cells_along(const glm::dvec3& extent_m) const;
  /// Of all boxes in all cells, at most.
  [[nodiscard]] double entries(const std::vector<glm::dvec3>& lows,
                               const std::vector<glm::dvec3>& highs) const;
  /// Into cells_; -1 outside the grid.
  [[nodiscard]] std::int64_t cell_of(const glm::dvec3& point_m) const;

  std::vector<Candidate> candidates_;  ///< By priority.
  double cell_m_ = 0.25;
  glm::dvec3 origin_m_{0.0};
  glm::ivec3 size_{0};
  std::vector<std::vector<std::uint16_t>> cells_;  ///< Into candidates_, ascending.
};

}  // namespace segsim::reconstruction::internal
