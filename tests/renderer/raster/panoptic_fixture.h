#pragma once

/// @file
/// A scene with features, its panoptic field without losses, and dense blending of selections
/// from it, for the tests of the resolve.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

#include "core/random.h"
#include "renderer/raster/label_resolve.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::renderer::testing {

using internal::WeightedSurfel;

inline std::uint32_t random_index(core::RandomStream& random, std::size_t count) {
  return random.index(static_cast<std::uint32_t>(count));
}

inline float random_weight(core::RandomStream& random) {
  return static_cast<float>(std::exp(random.uniform(-8.0, 0.0)));
}

inline std::uint32_t label_of(std::uint32_t semantic, std::uint32_t instance) {
  return semantic | instance << 16U;
}

/// A scene with features, its field without losses, and selections from it.
class Panoptic : public ::testing::Test {
 protected:
  Panoptic() : model_(random_model(3, 9, 40, 0.1F, 1.2)), cloud_(random_scene(5, 400)) {
    add_random_features(cloud_, 9);
    field_ = fold_panoptic_model(cloud_, model_,
                                 {.max_classes = 9, .max_instances = 40, .min_excess = 0.0F});
  }

  std::vector<WeightedSurfel> random_selection(core::RandomStream& random, int count) const {
    std::vector<WeightedSurfel> selected;
    for (int i = 0; i < count; ++i) {
      selected.push_back({random_weight(random), random_index(random, cloud_.size())});
    }
    return selected;
  }

  /// Dense blending in double precision of rows given by a function of the surfel.
  template <class Row>
  static std::vector<double> blend(const std::vector<WeightedSurfel>& selected,
                                   const Row& row_of) {
    std::vector<double> mean;
    double total = 0.0;
    for (const WeightedSurfel& s : selected) {
      const std::vector<double> row = row_of(s.surfel);
      mean.resize(row.size(), 0.0);
      for (std::size_t i = 0; i < row.size(); ++i) {
        mean[i] += static_cast<double>(s.weight) * row[i];
      }
      total += static_cast<double>(s.weight);
    }
    for (double& m : mean) m /= total;
    return mean;
  }
  [[nodiscard]] std::vector<double> blended_classes(
      const std::vector<WeightedSurfel>& selected) const {
    return blend(selected, [&](std::uint32_t s) { return dense_classes(model_, cloud_, s); });
  }
  [[nodiscard]] std::vector<double> blended_instances(
      const std::vector<WeightedSurfel>& selected) const {
    return blend(selected,
                 [&](std::uint32_t s) { return dense_instances(model_, cloud_, s); });
  }

  PanopticModel model_;
  SurfelCloud cloud_;
  PanopticField field_;
};

/// The id at the largest score, and whether another comes within 1e-5 of it.
struct ArgMax {
  std::size_t index;
  double score;
  bool tied;
};
inline ArgMax arg_max(const std::vector<double>& scores) {
  const auto best = static_cast<std::size_t>(std::max_element(scores.begin(), scores.end()) -
                                             scores.begin());
  bool tied = false;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    tied |= i != best && scores[best] - scores[i] < 1e-5;
  }
  return {best, scores[best], tied};
}

}  // namespace segsim::renderer::testing
