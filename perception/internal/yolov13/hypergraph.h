#pragma once

/// @file
/// HyperACE and FullPAD (Lei et al. 2025, "YOLOv13"): correlations of many places at once,
/// found on the fused map of three levels and handed back to all of them.
///
///     HyperedgeGenerator   every hyperedge is a prototype, moved by a linear map of [mean,
///                          max] of the tokens; participation A = softmax over tokens of the
///                          token . prototype products of all heads, averaged
///     HypergraphConv       E = GELU(W_e A^T X), X + GELU(W_n A E)
///     C3AH                 cv3(cat(hypergraph(cv1 x), cv2 x))
///     HyperAce             fuse -> cv1 -> y0, y1, y2; low order: DsC3k chain m of y2; high
///                          order: C3AH twice of y1; cv2(cat(y0, C3AH_1, y2, m..., C3AH_2))
///     DownsampleConv       mean of 2 x 2, then 1 x 1 Conv if the channels change
///     Tunnel               a + gate * b, one learned number that starts at 0

#include "perception/internal/yolov13/blocks.h"

namespace segsim::perception::yolov13 {

inline constexpr int kHyperHeadChannels = 16;  ///< Of one head of the participation.

class HyperedgeGenerator final : public torch::nn::Module {
 public:
  HyperedgeGenerator(int channels, int hyperedges);
  /// @param tokens  [batch, tokens, channels]. @returns [batch, tokens, hyperedges], sums to 1
  /// over the tokens.
  torch::Tensor forward(const torch::Tensor& tokens);
  /// What the dropout of the next forward passes in training mode draws from.
  void seed_dropout(std::uint64_t seed);
  /// Prepares for inference; cannot be undone.
  void fold();

 private:
  torch::Tensor drop_out(const torch::Tensor& logits);

  int channels_, hyperedges_;
  at::Generator dropout_;
  torch::Tensor prototypes_;  ///< [hyperedges, channels]
  torch::nn::Linear context_{nullptr}, projection_{nullptr};
  FoldedConvolution folded_projection_;
};

class HypergraphConv final : public torch::nn::Module {
 public:
  HypergraphConv(int channels, int hyperedges);
  /// [batch, tokens, channels] -> the same.
  torch::Tensor forward(const torch::Tensor& tokens);
  /// Prepares for inference; cannot be undone.
  void fold();

 private:
  std::shared_ptr<HyperedgeGenerator> generator_;
  torch::nn::Linear edge_{nullptr}, node_{nullptr};
  FoldedConvolution folded_node_;
};

class C3AH final : public FoldingBlock {
 public:
  /// @param channels  A multiple of kHyperHeadChannels, in, out and between.
  C3AH(int channels, int hyperedges);
  torch::Tensor forward(const torch::Tensor& x) override;
  void fold() override { hypergraph_->fold(); }

 private:
  std::shared_ptr<Conv> cv1_, cv2_, cv3_;
  std::shared_ptr<HypergraphConv> hypergraph_;
};

class HyperAce final : public torch::nn::Module {
 public:
  /// @param c3, c4, c5  Channels of the three inputs.
  HyperAce(int c3, int c4, int c5, int out, int repeats, int hyperedges);
  /// Maps of strides 8, 16, 32 -> one of stride 16.
  torch::Tensor forward(const torch::Tensor& p3, const torch::Tensor& p4,
                        const torch::Tensor& p5);

 private:
  std::shared_ptr<Conv> fuse_, cv1_, cv2_;
  std::vector<std::shared_ptr<DsC3k>> chain_;
  std::shared_ptr<C3AH> branch1_, branch2_;
};

class DownsampleConv final : public Block {
 public:
  DownsampleConv(int in, int out);
  torch::Tensor forward(const torch::Tensor& x) override;

 private:
  std::shared_ptr<Conv> adjust_;  ///< Null if the channels stay.
};

class Tunnel final : public torch::nn::Module {
 public:
  Tunnel();
  torch::Tensor forward(const torch::Tensor& a, const torch::Tensor& b);

 private:
  torch::Tensor gate_;  ///< Scalar.
};

}  // namespace segsim::perception::yolov13
