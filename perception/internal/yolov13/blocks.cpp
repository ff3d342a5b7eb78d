#include "perception/internal/yolov13/blocks.h"

#include <string>

#include "core/check.h"
#include "perception/internal/network/network.h"

namespace segsim::perception::yolov13 {
namespace {

thread_local std::int64_t* counted_macs = nullptr;

constexpr double kNormEps = 1e-3;
/// Of the second convolution of a bottleneck wherever YOLOv13 uses one.
constexpr int kWideKernel = 7;

torch::nn::Conv2d make_conv(int in, int out, int kernel, int stride, int groups) {
  return torch::nn::Conv2d(torch::nn::Conv2dOptions(in, out, kernel)
                               .stride(stride)
                               .padding(kernel / 2)
                               .groups(groups)
                               .bias(false));
}

torch::nn::BatchNorm2d make_norm(int channels) {
  return torch::nn::BatchNorm2d(
      torch::nn::BatchNorm2dOptions(channels).eps(kNormEps).momentum(kNormMomentum));
}

/// Convolution with the layer's geometry but given weight and bias.
torch::Tensor convolve_like(const torch::nn::Conv2d& layer, const torch::Tensor& x,
                            const torch::Tensor& weight, const torch::Tensor& bias) {
  auto y =
      convolve(x, weight, bias, {layer->options.stride()->at(0), layer->options.groups()});
  MacCounter::add(y.numel() * weight[0].numel());
  return y;
}

torch::Tensor run_folded(FoldedConvolution& folded, const torch::Tensor& x) {
  auto y = folded.run(x);
  MacCounter::add(y.numel() * folded.macs_per_value());
  return y;
}

torch::Tensor run_folded_onto(FoldedConvolution& folded, const torch::Tensor& base,
                              const torch::Tensor& x) {
  auto sum = folded.run_onto(base, x);
  MacCounter::add(sum.numel() * folded.macs_per_value());
  return sum;
}

FoldedConvolution fold_layers(const torch::nn::Conv2d& conv,
                              const torch::nn::BatchNorm2d& norm, bool activate) {
  const auto [weight, bias] = fold_norm(conv->weight, norm);
  return {weight,
          bias,
          {conv->options.stride()->at(0), conv->options.groups(),
           activate ? Activation::kSilu : Activation::kNone}};
}

}  // namespace

MacCounter::MacCounter() {
  SEGSIM_CHECK(counted_macs == nullptr, "another counter lives in this thread");
  counted_macs = &macs_;
}

MacCounter::~MacCounter() { counted_macs = nullptr; }

void MacCounter::add(std::int64_t macs) {
  if (counted_macs != nullptr) *counted_macs += macs;
}

Chain::Chain(std::vector<std::shared_ptr<Block>> blocks) : blocks_(std::move(blocks)) {
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    register_module(std::to_string(i), blocks_[i]);
  }
}

torch::Tensor Chain::forward(const torch::Tensor& x) {
  torch::Tensor y = x;
  for (const auto& block : blocks_) y = block->forward(y);
  return y;
}

Conv::Conv(int in, int out, int kernel, int stride, int groups, bool activate)
    : activate_(activate) {
  conv_ = register_module("conv", make_conv(in, out, kernel, stride, groups));
  norm_ = register_module("bn", make_norm(out));
}

torch::Tensor Conv::forward(const torch::Tensor& x) {
  if (!folded_.empty()) return run_folded(folded_, x);
  const auto y = norm_(convolve_like(conv_, x, conv_->weight, {}));
  return activate_ ? torch::silu(y) : y;
}

torch::Tensor Conv::forward_onto(const torch::Tensor& base, const torch::Tensor& x) {
  return folded_.empty() ? base + forward(x) : run_folded_onto(folded_, base, x);
}

void Conv::fold() { folded_ = fold_layers(conv_, norm_, activate_); }

DsConv::DsConv(int in, int out, int kernel, int stride) {
  depthwise_ = register_module("dw", make_conv(in, in, kernel, stride, in));
  pointwise_ = register_module("pw", make_conv(in, out, 1, 1, 1));
  norm_ = register_module("bn", make_norm(out));
}

torch::Tensor DsConv::forward(const torch::Tensor& x) {
  if (!folded_.empty()) return run_folded(folded_, run_folded(folded_depthwise_, x));
  const auto between = convolve_like(depthwise_, x, depthwise_->weight, {});
  return torch::silu(norm_(convolve_like(pointwise_, between, pointwise_->weight, {})));
}

torch::Tensor DsConv::forward_onto(const torch::Tensor& base, const torch::Tensor& x) {
  if (folded_.empty()) return base + forward(x);
  return run_folded_onto(folded_, base, run_folded(folded_depthwise_, x));
}

void DsConv::fold() {
  folded_depthwise_ =
      FoldedConvolution(depthwise_->weight, {},
                        {depthwise_->options.stride()->at(0), depthwise_->options.groups()});
  folded_ = fold_layers(pointwise_, norm_, true);
}

OutputConv::OutputConv(int in, int out) {
  weight_ = register_parameter("weight", torch::zeros({out, in, 1, 1}));
  bias_ = register_parameter("bias", torch::zeros({out}));
}

torch::Tensor OutputConv::forward(const torch::Tensor& x) {
  if (!folded_.empty()) return run_folded(folded_, x);
  auto y = convolve(x, weight_, bias_);
  MacCounter::add(y.numel() * weight_.size(1));
  return y;
}

void OutputConv::fold() { folded_ = FoldedConvolution(weight_, bias_, {}); }

DsBottleneck::DsBottleneck(int channels, int kernel) {
  first_ = register_module("cv1", std::make_shared<DsConv>(channels, channels, 3));
  second_ = register_module("cv2", std::make_shared<DsConv>(channels, channels, kernel));
}

torch::Tensor DsBottleneck::forward(const torch::Tensor& x) {
  return x + second_->forward(first_->forward(x));
}

torch::Tensor DsBottleneck::forward_over(const torch::Tensor& x) {
  return second_->forward_onto(x, first_->forward(x));
}

DsC3k::DsC3k(int channels, int hidden) {
  cv1_ = register_module("cv1", std::make_shared<Conv>(channels, hidden, 1));
  cv2_ = register_module("cv2", std::make_shared<Conv>(channels, hidden, 1));
  cv3_ = register_module("cv3", std::make_shared<Conv>(2 * hidden, channels, 1));
  for (int i = 0; i < 2; ++i) {
    inner_.push_back(std::make_shared<DsBottleneck>(hidden, kWideKernel));
  }
  register_list(*this, "m", inner_);
}

torch::Tensor DsC3k::forward(const torch::Tensor& x) {
  auto deep = cv1_->forward(x);
  for (const auto& bottleneck : inner_) deep = bottleneck->forward_over(deep);
  return cv3_->forward(torch::cat({deep, cv2_->forward(x)}, 1));
}

DsC3k2::DsC3k2(int in, int out, int repeats, bool deep, double expansion) {
  const int channels = static_cast<int>(out * expansion);
  cv1_ = register_module("cv1", std::make_shared<Conv>(in, 2 * channels, 1));
  cv2_ = register_module("cv2", std::make_shared<Conv>((2 + repeats) * channels, out, 1));
  for (int i = 0; i < repeats; ++i) {
    if (deep) {
      inner_.push_back(std::make_shared<DsC3k>(channels, channels));
    } else {
      inner_.push_back(std::make_shared<DsBottleneck>(channels, kWideKernel));
    }
  }
  register_list(*this, "m", inner_);
}

torch::Tensor DsC3k2::forward(const torch::Tensor& x) {
  // Both halves stay one part: joining what lies densely is several times quicker.
  std::vector<torch::Tensor> parts{cv1_->forward(x)};
  torch::Tensor deep = parts[0].chunk(2, 1)[1];
  for (const auto& block : inner_) parts.push_back(deep = block->forward(deep));
  return cv2_->forward(torch::cat(parts, 1));
}

}  // namespace segsim::perception::yolov13
