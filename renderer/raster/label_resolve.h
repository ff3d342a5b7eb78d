#pragma once

/// @file
/// From the surfels that a pixel selected to its labels and features: the deferred half of the
/// paper's Top-K Hard Selection. The blend loop only remembers (weight, surfel); rows of the
/// scene are read here, once the tile is finished.

#include <cstdint>
#include <span>
#include <vector>

#include "core/render.h"
#include "renderer/raster/label_vote.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer::internal {

class FieldTops;

/// What a renderer resolves with; the same for all tiles of a frame.
struct ResolveJob {
  /// Rows of kFeatures; may be null if they are never wanted.
  const SurfelCloud* cloud = nullptr;
  /// Labels come from here if it is there, else from the surfels' own ids.
  const PanopticField* field = nullptr;
  /// Of the field, where labels of slots are those of FieldTops; else null.
  const FieldTops* tops = nullptr;
  bool labelled = false;  ///< The surfels have ids.
  int top_k = 4;          ///< 1 ... kMaxTopK, or kAllSurfels.
  TopKRule rule = TopKRule::kHeaviest;
};

/// Whether there are labels, or features, to be had of those that are wanted.
[[nodiscard]] inline bool wants_labels(const ResolveJob& job, core::Channels channels) {
  return core::has(channels, core::Channels::kLabels) &&
         (job.field != nullptr || job.labelled);
}
[[nodiscard]] inline bool wants_features(const ResolveJob& job, core::Channels channels) {
  return core::has(channels, core::Channels::kFeatures) && job.cloud != nullptr &&
         job.cloud->has_features();
}
/// Whether the blend loop must select surfels: else keys stay untouched.
[[nodiscard]] inline bool wants_candidates(const ResolveJob& job, core::Channels channels) {
  return wants_labels(job, channels) || wants_features(job, channels);
}

/// A surfel that a pixel selected, by its slot in ProjectedSurfels.
struct WeightedSlot {
  float weight;  ///< alpha * T, > 0.
  std::uint32_t slot;
};

/// The same by its index in the cloud.
struct WeightedSurfel {
  float weight;          ///< alpha * T, > 0.
  std::uint32_t surfel;  ///< Index in the cloud.
};

/// Sums of scores by dense index; only the entries in use are visited and emptied.
class ScoreSums {
 public:
  struct Best {
    int index = -1;  ///< -1: no entry has a positive sum.
    double sum = 0.0;
  };

  /// @param count  Indices are below it.
  void reserve(std::size_t count) {
    if (sums_.size() >= count) return;
    sums_.resize(count, 0.0);
    used_.resize(count + 1);
  }
  /// @param score  > 0.
  void add(std::uint16_t index, double score) {
    used_[used_count_] = index;
    used_count_ += sums_[index] == 0.0 ? 1 : 0;
    sums_[index] += score;
  }
  /// The largest sum, ties to the lower index; empties the table.
  [[nodiscard]] Best take_best();

 private:
  std::vector<double> sums_;
  std::vector<std::uint16_t> used_;  ///< One entry more than can be in use at a time.
  std::size_t used_count_ = 0;
};

/// Memory of resolve_panoptic(); one object serves one thread.
struct ResolveScratch {
  ScoreSums classes, instances;
};

/// Class and instance with the largest weighted mean score (weights renormalised to 1).
/// Confidences are these means: blended probabilities. A pixel of a class that is no thing has
/// instance 0, with the class's confidence; so has one whose surfels no query claims. Where
/// the winning query has a class, it is the pixel's; if queries have classes, a thing that
/// none of them claims is void.
[[nodiscard]] PixelLabel resolve_panoptic(const PanopticField& field,
                                          std::span<const WeightedSurfel> selected,
                                          ResolveScratch& scratch);

/// Weighted means of the surfels' features, weights renormalised to 1; zero without surfels.
/// @param selected  At most kMaxTopK.
void resolve_features(const SurfelCloud& cloud, std::span<const WeightedSurfel> selected,
                      core::SemanticFeature& semantic, core::InstanceFeature& instance);

}  // namespace segsim::renderer::internal
