#pragma once

/// @file
/// The convolutional blocks of YOLOv13. Registered names are those of the official state dict,
/// so that weights load by name. Convolutions have no bias and padding k / 2; batch norms have
/// epsilon 1e-3 and momentum 0.03; the activation is SiLU.
///
///     Conv          conv -> norm -> SiLU
///     DsConv        depthwise k x k -> pointwise 1 x 1 -> norm -> SiLU
///     DsBottleneck  DsConv 3 x 3 -> DsConv k x k, + input
///     DsC3k         cv3(cat(bottlenecks(cv1 x), cv2 x))
///     DsC3k2        halves of cv1 x; each inner block takes the output before it; cv2(cat of
///                   all)
///
/// Before fold() a block computes as in training or evaluation mode; after it, only inference.

#include <torch/torch.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "perception/internal/network/onednn.h"

namespace segsim::perception::yolov13 {

/// Counts multiply-accumulate operations of convolutions and linear layers of this thread
/// while it lives. At most one per thread.
class MacCounter {
 public:
  MacCounter();
  ~MacCounter();
  MacCounter(const MacCounter&) = delete;
  MacCounter& operator=(const MacCounter&) = delete;
  [[nodiscard]] std::int64_t macs() const { return macs_; }
  /// Called by the layers: nothing happens where no counter lives.
  static void add(std::int64_t macs);

 private:
  std::int64_t macs_ = 0;
};

/// A module from one map [batch, channels, h, w] to another.
class Block : public torch::nn::Module {
 public:
  virtual torch::Tensor forward(const torch::Tensor& x) = 0;
};

/// A block that inference can prepare: its batch norm is merged into the convolution before
/// it.
class FoldingBlock : public Block {
 public:
  virtual void fold() = 0;
};

/// Blocks one after the other, registered as "0", "1", ...
class Chain final : public Block {
 public:
  explicit Chain(std::vector<std::shared_ptr<Block>> blocks);
  torch::Tensor forward(const torch::Tensor& x) override;

 private:
  std::vector<std::shared_ptr<Block>> blocks_;
};

class Conv final : public FoldingBlock {
 public:
  Conv(int in, int out, int kernel, int stride = 1, int groups = 1, bool activate = true);
  torch::Tensor forward(const torch::Tensor& x) override;
  /// base + forward(x); once folded in the memory of `base`, which nobody else may need then.
  torch::Tensor forward_onto(const torch::Tensor& base, const torch::Tensor& x);
  void fold() override;

 private:
  torch::nn::Conv2d conv_{nullptr};
  torch::nn::BatchNorm2d norm_{nullptr};
  bool activate_;
  FoldedConvolution folded_;
};

class DsConv final : public FoldingBlock {
 public:
  DsConv(int in, int out, int kernel, int stride = 1);
  torch::Tensor forward(const torch::Tensor& x) override;
  /// As Conv::forward_onto().
  torch::Tensor forward_onto(const torch::Tensor& base, const torch::Tensor& x);
  void fold() override;

 private:
  torch::nn::Conv2d depthwise_{nullptr}, pointwise_{nullptr};
  torch::nn::BatchNorm2d norm_{nullptr};
  FoldedConvolution folded_depthwise_, folded_;
};

/// 1 x 1 convolution with bias, nothing after it: the last layer of the head.
class OutputConv final : public FoldingBlock {
 public:
  OutputConv(int in, int out);
  torch::Tensor forward(const torch::Tensor& x) override;
  void fold() override;

 private:
  torch::Tensor weight_, bias_;
  FoldedConvolution folded_;
};

class DsBottleneck final : public Block {
 public:
  /// Input and output have `channels` each; the second kernel is `kernel`.
  DsBottleneck(int channels, int kernel);
  torch::Tensor forward(const torch::Tensor& x) override;
  /// The same; may use the memory of `x`, which nobody else may need.
  torch::Tensor forward_over(const torch::Tensor& x);

 private:
  std::shared_ptr<DsConv> first_, second_;
};

class DsC3k final : public Block {
 public:
  /// @param hidden  Channels between; two bottlenecks of kernels 3 and 7.
  DsC3k(int channels, int hidden);
  torch::Tensor forward(const torch::Tensor& x) override;

 private:
  std::shared_ptr<Conv> cv1_, cv2_, cv3_;
  std::vector<std::shared_ptr<DsBottleneck>> inner_;
};

class DsC3k2 final : public Block {
 public:
  /// @param deep  DsC3k as inner blocks instead of bottlenecks.
  /// @param expansion  Channels of an inner block over `out`.
  DsC3k2(int in, int out, int repeats, bool deep, double expansion = 0.5);
  torch::Tensor forward(const torch::Tensor& x) override;

 private:
  std::shared_ptr<Conv> cv1_, cv2_;
  std::vector<std::shared_ptr<Block>> inner_;
};

/// Registers blocks as "0", "1", ... of a list named `name` in `owner`.
template <class T>
void register_list(torch::nn::Module& owner, const std::string& name,
                   const std::vector<std::shared_ptr<T>>& blocks) {
  torch::nn::ModuleList list;
  for (const auto& block : blocks) list->push_back(block);
  owner.register_module(name, list);
}

}  // namespace segsim::perception::yolov13
