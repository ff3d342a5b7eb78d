#include "renderer/internal/reference_resolve.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <utility>

namespace segsim::renderer::internal {
namespace {

using Votes = std::map<std::uint16_t, double>;

/// Maps are in order of id, and the first of equal maxima is returned.
std::pair<std::uint16_t, double> winner(const Votes& votes) {
  return *std::max_element(votes.begin(), votes.end(),
                           [](const auto& a, const auto& b) { return a.second < b.second; });
}

template <std::size_t kSize>
std::array<float, kSize> mean_of(const std::vector<std::array<float, kSize>>& features,
                                 const std::vector<ReferenceWeight>& selected, double total) {
  std::array<float, kSize> mean{};
  for (std::size_t c = 0; c < kSize; ++c) {
    double sum = 0.0;
    for (const auto& [weight, surfel] : selected) {
      sum += weight * static_cast<double>(features[surfel][c]);
    }
    mean[c] = static_cast<float>(sum / total);
  }
  return mean;
}

double total_of(const std::vector<ReferenceWeight>& selected) {
  double total = 0.0;
  for (const ReferenceWeight& s : selected) total += s.weight;
  return total;
}

}  // namespace

std::vector<ReferenceWeight> select_top_k(std::vector<ReferenceWeight> met,
                                          const RenderOptions& options) {
  if (options.top_k == kAllSurfels) return met;
  if (options.top_k_rule == TopKRule::kHeaviest) {
    std::stable_sort(met.begin(), met.end(),
                     [](const ReferenceWeight& a, const ReferenceWeight& b) {
                       return a.weight > b.weight;
                     });
  }
  met.resize(std::min(met.size(), static_cast<std::size_t>(options.top_k)));
  return met;
}

void write_reference_labels(const SurfelCloud& cloud,
                            const std::vector<ReferenceWeight>& selected, int x, int y,
                            core::Frame& frame) {
  Votes semantic, instance;
  for (const auto& [weight, surfel] : selected) {
    semantic[cloud.semantic_id[surfel]] += weight;
    instance[cloud.instance_id[surfel]] += weight;
  }
  const double total = total_of(selected);
  const auto [semantic_id, semantic_weight] = winner(semantic);
  const auto [instance_id, instance_weight] = winner(instance);
  frame.semantic(x, y) = semantic_id;
  frame.instance(x, y) = instance_id;
  frame.confidence(x, y) = static_cast<float>(semantic_weight / total);
  frame.instance_confidence(x, y) = static_cast<float>(instance_weight / total);
}

void write_reference_features(const SurfelCloud& cloud,
                              const std::vector<ReferenceWeight>& selected, int x, int y,
                              core::Frame& frame) {
  const double total = total_of(selected);
  frame.semantic_feature(x, y) = mean_of(cloud.semantic_feature, selected, total);
  frame.instance_feature(x, y) = mean_of(cloud.instance_feature, selected, total);
}

}  // namespace segsim::renderer::internal
