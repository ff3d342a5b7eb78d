#include "renderer/internal/label_vote.h"

namespace segsim::renderer::internal {
namespace {

struct Winner {
  std::uint16_t id = 0;
  float weight = 0.0F;
};

/// Heaviest value of 16 bits of the labels, from bit `shift` on.
Winner heaviest(const WeightedLabel* candidates, int count, unsigned shift) {
  const auto id_of = [&](int i) {
    return static_cast<std::uint16_t>(candidates[i].label >> shift);
  };
  Winner best;
  for (int i = 0; i < count; ++i) {
    const std::uint16_t id = id_of(i);
    float sum = 0.0F;
    for (int j = 0; j < count; ++j) sum += id_of(j) == id ? candidates[j].weight : 0.0F;
    if (sum > best.weight || (sum == best.weight && id < best.id)) best = {id, sum};
  }
  return best;
}

}  // namespace

PixelLabel vote(const WeightedLabel* candidates, int count) {
  if (count == 0) return {};
  float total = 0.0F;
  bool unanimous = true;  // Most pixels are.
  for (int i = 0; i < count; ++i) {
    total += candidates[i].weight;
    unanimous &= candidates[i].label == candidates[0].label;
  }
  if (unanimous) {
    return {static_cast<std::uint16_t>(candidates[0].label),
            static_cast<std::uint16_t>(candidates[0].label >> 16U), 1.0F};
  }
  const Winner semantic = heaviest(candidates, count, 0);
  const Winner instance = heaviest(candidates, count, 16);
  return {semantic.id, instance.id, semantic.weight / total};
}

}  // namespace segsim::renderer::internal
