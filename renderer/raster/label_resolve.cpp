#include "renderer/raster/label_resolve.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/raster/label_resolve.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::CappedTag<float, core::kSemanticFeatureSize>;
using V = hn::Vec<Floats>;

/// Weighted mean of rows of features: lanes are channels.
template <std::size_t kSize>
HWY_INLINE void mean_of(const std::vector<std::array<float, kSize>>& rows,
                        std::span<const WeightedSurfel> selected, float scale,
                        std::array<float, kSize>& mean) {
  const Floats d;
  for (std::size_t i = 0; i < kSize; i += hn::Lanes(d)) {
    V sum = hn::Zero(d);
    for (const WeightedSurfel& s : selected) {
      sum = hn::MulAdd(hn::Set(d, s.weight), hn::LoadU(d, rows[s.surfel].data() + i), sum);
    }
    hn::StoreU(hn::Mul(sum, hn::Set(d, scale)), d, mean.data() + i);
  }
}

void mean_features(const SurfelCloud& cloud, std::span<const WeightedSurfel> selected,
                   core::SemanticFeature& semantic, core::InstanceFeature& instance) {
  float total = 0.0F;
  for (const WeightedSurfel& s : selected) total += s.weight;
  const float scale = total > 0.0F ? 1.0F / total : 0.0F;
  mean_of(cloud.semantic_feature, selected, scale, semantic);
  mean_of(cloud.instance_feature, selected, scale, instance);
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::renderer::internal {
namespace {

HWY_EXPORT(mean_features);

/// If the largest entries of all rows have the same index, no other index can have a larger
/// sum: that is so for most pixels, and the other entries need not be read.
/// @return  Index -1 without entries, -2 if the rows differ.
ScoreSums::Best unanimous_best(const SparseScores& scores,
                               std::span<const WeightedSurfel> selected) {
  ScoreSums::Best best;
  for (const WeightedSurfel& s : selected) {
    const std::span<const SparseScores::Entry> row = scores.row(s.surfel);
    if (row.empty()) continue;
    if (best.index >= 0 && best.index != row[0].index) return {-2, 0.0};
    best.index = row[0].index;
    best.sum += static_cast<double>(s.weight) * static_cast<double>(row[0].excess);
  }
  return best;
}

ScoreSums::Best best_score(const SparseScores& scores,
                           std::span<const WeightedSurfel> selected, std::size_t count,
                           ScoreSums& sums) {
  const ScoreSums::Best best = unanimous_best(scores, selected);
  if (best.index != -2) return best;
  sums.reserve(count);
  for (const WeightedSurfel& s : selected) {
    const auto weight = static_cast<double>(s.weight);
    for (const SparseScores::Entry& entry : scores.row(s.surfel)) {
      sums.add(entry.index, weight * static_cast<double>(entry.excess));
    }
  }
  return sums.take_best();
}

}  // namespace

ScoreSums::Best ScoreSums::take_best() {
  Best best;
  for (std::size_t i = 0; i < used_count_; ++i) {
    const std::uint16_t index = used_[i];
    const double sum = sums_[index];
    if (sum > best.sum || (sum == best.sum && static_cast<int>(index) < best.index)) {
      best = {static_cast<int>(index), sum};
    }
    sums_[index] = 0.0;
  }
  used_count_ = 0;
  return best;
}

PixelLabel resolve_panoptic(const PanopticField& field,
                            std::span<const WeightedSurfel> selected,
                            ResolveScratch& scratch) {
  if (selected.empty()) return {};
  double total = 0.0, instance_base = 0.0;
  for (const WeightedSurfel& s : selected) {
    total += static_cast<double>(s.weight);
    instance_base +=
        static_cast<double>(s.weight) * static_cast<double>(field.instances.base(s.surfel));
  }
  const ScoreSums::Best best_class =
      best_score(field.classes, selected, field.class_id.size(), scratch.classes);
  PixelLabel label;
  if (best_class.index >= 0) {
    const auto index = static_cast<std::size_t>(best_class.index);
    label.semantic = field.class_id[index];
    label.confidence = static_cast<float>(best_class.sum / total);
    if (field.class_is_thing[index] == 0) {
      label.instance_confidence = label.confidence;
      return label;
    }
  }
  const ScoreSums::Best best_instance =
      best_score(field.instances, selected, field.instance_id.size(), scratch.instances);
  if (best_instance.index >= 0) {
    const auto index = static_cast<std::size_t>(best_instance.index);
    label.instance = field.instance_id[index];
    if (!field.instance_class.empty() && field.instance_class[index] != 0) {
      label.semantic = field.instance_class[index];
    }
    label.instance_confidence =
        static_cast<float>((instance_base + best_instance.sum) / total);
  }
  if (label.instance == 0 && !field.instance_class.empty()) label.semantic = 0;
  return label;
}

void resolve_features(const SurfelCloud& cloud, std::span<const WeightedSurfel> selected,
                      core::SemanticFeature& semantic, core::InstanceFeature& instance) {
  HWY_DYNAMIC_DISPATCH(mean_features)(cloud, selected, semantic, instance);
}

}  // namespace segsim::renderer::internal
#endif  // HWY_ONCE
