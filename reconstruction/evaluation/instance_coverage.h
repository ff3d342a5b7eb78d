#pragma once

/// @file
/// How well the best predicted id covers each true object of a scene (PVLFF, PanopticRecon++;
/// the paper's columns mCov and mW-Cov). Classes of the prediction play no part.
///
///     Cov(g) = |p and g| / |p or g|,   p = the predicted id with the most pixels on g
///
/// Void is not taken out of the union: all of p's pixels in the scene count.

#include <cstdint>
#include <span>
#include <vector>

#include "core/scene_bundle.h"
#include "reconstruction/evaluation/contingency.h"

namespace segsim::reconstruction {

struct CoverageRules {
  /// Id 0 (none) may be the best id: PVLFF's reading. Else an object that only id 0 covers has
  /// coverage 0.
  bool zero_id_may_cover = false;
  /// Of `precision` and `recall`: 0.5 in PVLFF, 0.1 in PanopticRecon++.
  double min_coverage = 0.5;
};

struct InstanceCoverage {
  std::uint16_t truth_id = 0;
  std::uint16_t predicted_id = 0;  ///< 0 = none.
  std::uint64_t pixels = 0;        ///< Of the true object.
  double coverage = 0.0;
};

struct CoverageQuality {
  std::vector<InstanceCoverage> instances;  ///< Ascending by true id.
  double mean = 0.0;                        ///< mCov; 0 without objects.
  double weighted = 0.0;                    ///< mW-Cov: weighted by the objects' pixels.
  double precision = 0.0;  ///< Covered objects / predicted ids that occur on objects.
  double recall = 0.0;     ///< Covered objects / objects.
};

/// Objects are the true ids > 0 whose majority class is an evaluated thing.
[[nodiscard]] CoverageQuality instance_coverage(const ContingencyTable& table,
                                                std::span<const core::SceneClass> classes,
                                                const CoverageRules& rules = {});

}  // namespace segsim::reconstruction
