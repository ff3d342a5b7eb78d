#pragma once

/// @file
/// Area attention and the residual block built of it (Tian et al. 2025, "YOLOv12:
/// attention-centric real-time object detectors").
///
///     AreaAttention   tokens row by row, cut into `area` bands of equal length; inside each
///                     band and head softmax(Q K^T / sqrt(32)) V; proj(that + pe(V))
///     AttentionBlock  x + AreaAttention(x), then y + MLP(y)
///     A2C2f           y0 = cv1 x; n pairs of AttentionBlocks; cv2(cat of all), for large
///                     scales as residual x + gamma * cv2(...)

#include "perception/internal/network/onednn_attention.h"
#include "perception/internal/yolov13/blocks.h"

namespace segsim::perception::yolov13 {

inline constexpr int kHeadChannels = 32;  ///< Of one attention head.

class AreaAttention final : public Block {
 public:
  /// @param channels  A multiple of kHeadChannels.
  AreaAttention(int channels, int area);
  /// @param x  h * w must be a multiple of `area`.
  torch::Tensor forward(const torch::Tensor& x) override;

 private:
  /// What the tokens of `v` make of each other, [batch, channels, h, w].
  torch::Tensor attend(const torch::Tensor& qk, const torch::Tensor& v);

  int heads_, area_;
  BandAttention attention_;
  std::shared_ptr<Conv> qk_, v_, proj_, pe_;
};

class AttentionBlock final : public Block {
 public:
  AttentionBlock(int channels, double mlp_ratio, int area);
  torch::Tensor forward(const torch::Tensor& x) override;

 private:
  std::shared_ptr<AreaAttention> attention_;
  std::shared_ptr<Conv> widen_, narrow_;  ///< The MLP.
};

class A2C2f final : public Block {
 public:
  /// @param out  Half of it is a multiple of kHeadChannels.
  /// @param residual  With gamma per channel, from 0.01; then `in` equals `out`.
  A2C2f(int in, int out, int repeats, int area, double mlp_ratio, bool residual);
  torch::Tensor forward(const torch::Tensor& x) override;

 private:
  std::shared_ptr<Conv> cv1_, cv2_;
  std::vector<std::shared_ptr<Chain>> pairs_;
  torch::Tensor gamma_;  ///< Undefined without residual.
};

}  // namespace segsim::perception::yolov13
