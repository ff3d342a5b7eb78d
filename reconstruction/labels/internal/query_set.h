#pragma once

/// @file
/// The learnable queries of a scene (paper, "Query-guided Instance Segmentation"): places,
/// shapes and features, and the heads on the features.
///
///     embedding  e_q = LayerNorm(Linear 32 -> 32 (feature))      f_q of the attention
///
///     class      Linear 128 -> T + 1 (ReLU(Linear 32 -> 128 (class feature)))
///
/// with T thing classes, and "no object" last (PanopticRecon++'s sizes).

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/labels/internal/attention.h"
#include "reconstruction/labels/panoptic_head.h"

namespace segsim::reconstruction::internal {

class QuerySet {
 public:
  /// @param seeds  One for each query.
  QuerySet(const std::vector<QuerySeed>& seeds, int thing_classes,
           const PanopticTrainingConfig& config, std::uint64_t seed, const at::Device& device);

  [[nodiscard]] std::int64_t size() const { return feature_.value().size(0); }

  /// The parameters of one step, as leaves that collect derivatives.
  struct Leaves {
    Tensor position_m, log_sigma, rotation, feature, class_feature;
    Tensor embed_weight, embed_bias, norm_weight, norm_bias;
    Tensor class_weight1, class_bias1, class_weight2, class_bias2;
  };
  [[nodiscard]] Leaves leaves() const;
  /// @param rate_factor  Of all rates.
  void step(const Leaves& leaves, const HeadRateConfig& rate, double rate_factor);

  /// Linear layer's output; repulsion acts here.
  [[nodiscard]] static Tensor projected(const Leaves& leaves);
  [[nodiscard]] static Tensor embedding(const Leaves& leaves, const Tensor& projected);
  /// [queries, T + 1].
  [[nodiscard]] static Tensor class_logits(const Leaves& leaves);

  // What matching remembers.
  void count_match(std::int64_t query, std::int64_t frame);
  [[nodiscard]] std::int64_t matches(std::int64_t query) const {
    return matches_.at(static_cast<std::size_t>(query));
  }
  [[nodiscard]] std::int64_t recent_matches(std::int64_t query) const {
    return recent_.at(static_cast<std::size_t>(query));
  }
  [[nodiscard]] std::size_t frames(std::int64_t query) const {
    return frames_.at(static_cast<std::size_t>(query)).size();
  }
  void forget_recent() { recent_.assign(recent_.size(), 0); }
  void keep(const std::vector<std::int64_t>& queries);

  void save(StateWriter& out) const;
  void load(const StateReader& in);

 private:
  [[nodiscard]] std::vector<std::pair<std::string, AdamTensor*>> parameters();

  QueryConfig config_;
  AdamTensor position_m_, log_sigma_, rotation_, feature_, class_feature_;
  AdamTensor embed_weight_, embed_bias_, norm_weight_, norm_bias_;
  AdamTensor class_weight1_, class_bias1_, class_weight2_, class_bias2_;
  std::vector<std::int64_t> matches_, recent_;
  std::vector<std::set<std::int64_t>> frames_;
};

/// Uniform in [-1/sqrt(in), 1/sqrt(in)], torch's default for linear layers, from our streams.
[[nodiscard]] Tensor linear_weight(std::int64_t out, std::int64_t in, std::uint64_t seed,
                                   const std::string& name, const at::Device& device);

}  // namespace segsim::reconstruction::internal
