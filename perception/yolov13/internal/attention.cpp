#include "perception/yolov13/internal/attention.h"

#include <cmath>

#include "core/check.h"

namespace segsim::perception::yolov13 {
namespace {

constexpr double kGammaStart = 0.01;

/// softmax(Q^T K / sqrt(32)) V of every band and head as grouped 1 x 1 convolutions of oneDNN,
/// one group for each: convolve() (onednn.h) says why not by the BLAS library.
/// @param q, k, v  [batch, band, head, 32, token]. @returns the same shape.
torch::Tensor attend_by_convolution(const torch::Tensor& q, const torch::Tensor& k,
                                    const torch::Tensor& v, double factor) {
  const int64_t tokens = q.size(4), groups = q.size(0) * q.size(1) * q.size(2);
  const auto multiply = [groups](const torch::Tensor& input, const torch::Tensor& weight) {
    return at::mkldnn_convolution(input, weight, {}, {0, 0}, {1, 1}, {1, 1}, groups);
  };
  // Keys are the filters, so that the result is transposed: [group, token of k, token of q].
  const auto keys = k.transpose(3, 4).reshape({groups * tokens, kHeadChannels, 1, 1});
  auto weights = multiply(q.reshape({1, groups * kHeadChannels, 1, tokens}), keys)
                     .view({groups, tokens, tokens});
  weights = weights.mul_(factor).softmax(1);
  return multiply(weights.view({1, groups * tokens, 1, tokens}),
                  v.reshape({groups * kHeadChannels, tokens, 1, 1}))
      .view(q.sizes());
}

}  // namespace

AreaAttention::AreaAttention(int channels, int area)
    : heads_(channels / kHeadChannels), area_(area) {
  SEGSIM_CHECK(channels % kHeadChannels == 0 && area >= 1, std::to_string(channels));
  const auto linear = [channels](int out, int kernel, int groups) {
    return std::make_shared<Conv>(channels, out, kernel, 1, groups, false);
  };
  qk_ = register_module("qk", linear(2 * channels, 1, 1));
  v_ = register_module("v", linear(channels, 1, 1));
  proj_ = register_module("proj", linear(channels, 1, 1));
  pe_ = register_module("pe", linear(channels, 5, channels));
}

torch::Tensor AreaAttention::forward(const torch::Tensor& x) {
  const int64_t batch = x.size(0), tokens = x.size(2) * x.size(3);
  SEGSIM_CHECK(tokens % area_ == 0, std::to_string(tokens) + " tokens");
  const int64_t band = tokens / area_;
  constexpr auto kChannelsLast = torch::MemoryFormat::ChannelsLast;
  const auto v_map = v_->forward(x);
  // [q or k, batch, band, head, channel of the head, token of the band]
  const auto qk = qk_->forward(x)
                      .contiguous()
                      .view({batch, 2, heads_, kHeadChannels, area_, band})
                      .permute({1, 0, 4, 2, 3, 5});
  const auto v = v_map.contiguous()
                     .view({batch, heads_, kHeadChannels, area_, band})
                     .permute({0, 3, 1, 2, 4});
  const double factor = 1.0 / std::sqrt(double{kHeadChannels});
  torch::Tensor mixed;
  if (runs_on_onednn(x)) {
    mixed = attend_by_convolution(qk[0], qk[1], v, factor);
  } else {
    const auto similarity = torch::matmul(qk[0].transpose(-2, -1), qk[1]) * factor;
    mixed = torch::matmul(v, similarity.softmax(-1).transpose(-2, -1));
  }
  const auto position = pe_->forward(v_map);
  auto map = mixed.permute({0, 2, 3, 1, 4}).reshape(x.sizes());
  if (position.is_contiguous(kChannelsLast)) map = map.contiguous(kChannelsLast);
  return proj_->forward(map + position);
}

AttentionBlock::AttentionBlock(int channels, double mlp_ratio, int area) {
  attention_ = register_module("attn", std::make_shared<AreaAttention>(channels, area));
  const int hidden = static_cast<int>(channels * mlp_ratio);
  mlp_ =
      register_module("mlp", std::make_shared<Chain>(std::vector<std::shared_ptr<Block>>{
                                 std::make_shared<Conv>(channels, hidden, 1),
                                 std::make_shared<Conv>(hidden, channels, 1, 1, 1, false)}));
}

torch::Tensor AttentionBlock::forward(const torch::Tensor& x) {
  const auto y = x + attention_->forward(x);
  return y + mlp_->forward(y);
}

A2C2f::A2C2f(int in, int out, int repeats, int area, double mlp_ratio, bool residual) {
  SEGSIM_CHECK(!residual || in == out, std::to_string(in));
  const int hidden = out / 2;
  cv1_ = register_module("cv1", std::make_shared<Conv>(in, hidden, 1));
  cv2_ = register_module("cv2", std::make_shared<Conv>((1 + repeats) * hidden, out, 1));
  for (int i = 0; i < repeats; ++i) {
    const auto block = [&] {
      return std::make_shared<AttentionBlock>(hidden, mlp_ratio, area);
    };
    pairs_.push_back(
        std::make_shared<Chain>(std::vector<std::shared_ptr<Block>>{block(), block()}));
  }
  register_list(*this, "m", pairs_);
  if (residual) gamma_ = register_parameter("gamma", torch::full({out}, kGammaStart));
}

torch::Tensor A2C2f::forward(const torch::Tensor& x) {
  std::vector<torch::Tensor> parts{cv1_->forward(x)};
  for (const auto& pair : pairs_) parts.push_back(pair->forward(parts.back()));
  const auto y = cv2_->forward(torch::cat(parts, 1));
  return gamma_.defined() ? x + gamma_.view({1, -1, 1, 1}) * y : y;
}

}  // namespace segsim::perception::yolov13
