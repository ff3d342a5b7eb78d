#pragma once

/// @file
/// The surfels nearest to a surfel, from a grid: the minimal build for CUDA machines has no
/// library that knows them.

#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include <glm/vec3.hpp>

namespace segsim::reconstruction::internal {

class NearestSurfels {
 public:
  /// @param position_m  [surfels]; borrowed.
  explicit NearestSurfels(const std::vector<glm::vec3>& position_m);

  /// Without the surfel itself, nearest first, ties to the lower index; fewer than `count`
  /// only in a cloud of as few.
  [[nodiscard]] std::vector<std::int64_t> nearest(std::int64_t surfel, int count) const;

 private:
  using Found = std::pair<float, std::int64_t>;  ///< Squared distance, surfel.

  [[nodiscard]] glm::ivec3 cell_of(const glm::vec3& p_m) const;
  void look_in(const glm::ivec3& cell, std::int64_t surfel, std::vector<Found>& found) const;

  const std::vector<glm::vec3>& position_m_;
  float cell_m_ = 1.0F;
  std::unordered_map<std::uint64_t, std::vector<std::int32_t>> cells_;  ///< Never walked.
};

}  // namespace segsim::reconstruction::internal
