#pragma once

/// @file
/// The whole graph of YOLOv13, layer numbers and parameter names ("model.<layer>. ...") as in
/// the official state dict. Channels are nominal; scale.h turns them into those of a scale.
///
///      0 Conv 64 s2      1 Conv 128 s2 g2   2 DsC3k2 256      3 Conv 256 s2 g4
///      4 DsC3k2 512      = P3               5 DsConv 512 s2   6 A2C2f 512, 4 bands = P4
///      7 DsConv 1024 s2  8 A2C2f 1024 = P5  9 HyperAce(4, 6, 8) 512
///     10 up(9)          11 down(9)         12 tunnel(6, 9)   13 tunnel(4, 10)
///     14 tunnel(8, 11)  16 cat(up 14, 12)  17 DsC3k2 512     18 tunnel(17, 9)
///     20 cat(up 17, 13) 21 DsC3k2 256      22 Conv(10) 256   23 tunnel(21, 22)
///     24 Conv(23) s2    25 cat(24, 18)     26 DsC3k2 512     27 tunnel(26, 9)
///     28 Conv(26) s2    29 cat(28, 14)     30 DsC3k2 1024    31 tunnel(30, 11)
///     32 head(23, 27, 31)

#include <array>
#include <cstdint>

#include "perception/checkpoint/yolov13_scale.h"
#include "perception/internal/network/network.h"
#include "perception/internal/yolov13/attention.h"
#include "perception/internal/yolov13/blocks.h"
#include "perception/internal/yolov13/hypergraph.h"

namespace segsim::perception::yolov13 {

/// The decoupled head: per level two 3 x 3 Convs and an OutputConv to 4 * 16 logits of the
/// box sides, and two pairs of depthwise 3 x 3 and 1 x 1 Convs and an OutputConv to one logit
/// per class.
class Head final : public torch::nn::Module {
 public:
  Head(const std::array<int, 3>& inputs, int class_count);
  RawOutput forward(const std::array<torch::Tensor, 3>& maps);
  /// Biases for which each anchor starts with five objects per 640 px image in mind.
  void initialize_biases();

 private:
  int class_count_;
  std::vector<std::shared_ptr<Chain>> box_, classes_;
  torch::Tensor bins_;  ///< 0 ... 15 as the official state dict carries it; never trained.
};

class NetworkImpl final : public torch::nn::Module {
 public:
  NetworkImpl(Scale scale, int class_count);
  /// @param x  [batch, 3, h, w], RGB in [0, 1]; sides are multiples of 32.
  RawOutput forward(const torch::Tensor& x);
  /// Eval mode with batch norms folded into the convolutions: cannot be undone.
  void prepare_for_inference();
  /// The start of training, keyed by seed and parameter name: uniform of variance 1 / (3
  /// fan-in), Xavier for the hyperedge prototypes, gates 0, gammas 0.01.
  void initialize(std::uint64_t seed);
  /// What the dropout of the next forward passes in training mode draws from.
  void seed_dropout(std::uint64_t seed);
  /// The maps of layers 0 ... 31 of the last forward pass, undefined where a layer keeps none;
  /// only if asked for before it.
  void keep_maps(bool keep) { keep_maps_ = keep; }
  [[nodiscard]] const std::array<torch::Tensor, 32>& maps() const { return maps_; }

 private:
  template <class T, class... Arguments>
  std::shared_ptr<T> layer(int index, Arguments&&... arguments);
  const torch::Tensor& keep(std::size_t index, const torch::Tensor& map);

  std::shared_ptr<torch::nn::Module> layers_;
  std::shared_ptr<Conv> conv0_, conv1_, conv3_, conv22_, conv24_, conv28_;
  std::shared_ptr<DsConv> down5_, down7_;
  std::shared_ptr<DsC3k2> csp2_, csp4_, csp17_, csp21_, csp26_, csp30_;
  std::shared_ptr<A2C2f> attention6_, attention8_;
  std::shared_ptr<HyperAce> hyper9_;
  std::shared_ptr<DownsampleConv> down11_;
  std::shared_ptr<Tunnel> tunnel12_, tunnel13_, tunnel14_, tunnel18_, tunnel23_, tunnel27_,
      tunnel31_;
  std::shared_ptr<Head> head_;
  bool keep_maps_ = false;
  std::array<torch::Tensor, 32> maps_;
};
TORCH_MODULE(Network);

}  // namespace segsim::perception::yolov13
