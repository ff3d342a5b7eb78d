#pragma once

/// @file
/// Surfels in groups of like features, in two levels (OpenGaussian): k-means over features and
/// places, and in each of its groups k-means over features alone. Tensor by tensor, because it
/// is done again every few steps of training, on the device of the features.

#include <cstdint>

#include "reconstruction/internal/tensors/state_file.h"
#include "reconstruction/internal/tensors/tensors.h"

namespace segsim::reconstruction::internal {

class Codebook {
 public:
  /// @param coarse, fine  Groups, and groups in each.  @param rounds  Of k-means at a time.
  Codebook(std::int64_t surfels, int coarse, int fine, int rounds, std::uint64_t seed,
           const at::Device& device);

  enum class Level : std::uint8_t { kNone, kCoarse, kFine };
  [[nodiscard]] Level level() const { return level_; }

  /// Assigns surfels anew, from where the groups are now; the first time from surfels drawn at
  /// random.
  /// @param feature  [surfels, n].  @param place  [surfels, 3].
  void assign_coarse(const Tensor& feature, const Tensor& place);
  void assign_fine(const Tensor& feature);

  /// [surfels] int64 in [0, size()): the group, of the finest level there is.
  [[nodiscard]] const Tensor& group() const { return group_; }
  [[nodiscard]] std::int64_t size() const { return coarse_ * fine_; }
  /// [size(), n]: the mean of each group's features; 0 without surfels.
  [[nodiscard]] Tensor means(const Tensor& feature) const;

  void save(StateWriter& out) const;
  void load(const StateReader& in);

 private:
  /// A random order of the surfels, always the same.
  [[nodiscard]] std::vector<std::int64_t> drawn() const;

  std::int64_t coarse_, fine_;
  int rounds_;
  std::uint64_t seed_;
  Level level_ = Level::kNone;
  Tensor group_;
};

}  // namespace segsim::reconstruction::internal
