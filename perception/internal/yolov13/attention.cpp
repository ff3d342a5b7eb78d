#include "perception/internal/yolov13/attention.h"

#include <cmath>

#include "core/check.h"

namespace segsim::perception::yolov13 {
namespace {

constexpr double kGammaStart = 0.01;

}  // namespace

AreaAttention::AreaAttention(int channels, int area)
    : heads_(channels / kHeadChannels), area_(area), attention_(heads_, kHeadChannels, area) {
  SEGSIM_CHECK(channels % kHeadChannels == 0 && area >= 1, std::to_string(channels));
  const auto linear = [channels](int out, int kernel, int groups) {
    return std::make_shared<Conv>(channels, out, kernel, 1, groups, false);
  };
  qk_ = register_module("qk", linear(2 * channels, 1, 1));
  v_ = register_module("v", linear(channels, 1, 1));
  proj_ = register_module("proj", linear(channels, 1, 1));
  pe_ = register_module("pe", linear(channels, 5, channels));
}

torch::Tensor AreaAttention::attend(const torch::Tensor& qk_map, const torch::Tensor& v_map) {
  if (BandAttention::available(v_map)) return attention_.run(qk_map, v_map);
  const int64_t batch = v_map.size(0), band = v_map.size(2) * v_map.size(3) / area_;
  // [q or k, batch, band, head, channel of the head, token of the band]
  const auto qk = qk_map.contiguous()
                      .view({batch, 2, heads_, kHeadChannels, area_, band})
                      .permute({1, 0, 4, 2, 3, 5});
  const auto v = v_map.contiguous()
                     .view({batch, heads_, kHeadChannels, area_, band})
                     .permute({0, 3, 1, 2, 4});
  const double factor = 1.0 / std::sqrt(double{kHeadChannels});
  const auto similarity = torch::matmul(qk[0].transpose(-2, -1), qk[1]) * factor;
  const auto mixed = torch::matmul(v, similarity.softmax(-1).transpose(-2, -1));
  return mixed.permute({0, 2, 3, 1, 4}).reshape(v_map.sizes());
}

torch::Tensor AreaAttention::forward(const torch::Tensor& x) {
  const int64_t tokens = x.size(2) * x.size(3);
  SEGSIM_CHECK(tokens % area_ == 0, std::to_string(tokens) + " tokens");
  const auto v = v_->forward(x);
  return proj_->forward(pe_->forward_onto(attend(qk_->forward(x), v), v));
}

AttentionBlock::AttentionBlock(int channels, double mlp_ratio, int area) {
  attention_ = register_module("attn", std::make_shared<AreaAttention>(channels, area));
  const int hidden = static_cast<int>(channels * mlp_ratio);
  widen_ = std::make_shared<Conv>(channels, hidden, 1);
  narrow_ = std::make_shared<Conv>(hidden, channels, 1, 1, 1, false);
  register_module(
      "mlp", std::make_shared<Chain>(std::vector<std::shared_ptr<Block>>{widen_, narrow_}));
}

torch::Tensor AttentionBlock::forward(const torch::Tensor& x) {
  const auto y = x + attention_->forward(x);
  return narrow_->forward_onto(y, widen_->forward(y));
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
