#include "perception/internal/centernet/layers.h"

#include <algorithm>

namespace segsim::perception::centernet {
namespace {

/// relu(concat(skip, double_sides(small))) in one pass, for maps with their channels
/// innermost.
torch::Tensor join_directly(const torch::Tensor& skip, const torch::Tensor& small) {
  constexpr auto kInnermost = torch::MemoryFormat::ChannelsLast;
  const auto dense_skip = skip.contiguous(kInnermost), dense = small.contiguous(kInnermost);
  const std::int64_t images = small.size(0), c = small.size(1), h = small.size(2),
                     w = small.size(3);
  auto joined = torch::empty({images, 2 * c, 2 * h, 2 * w},
                             torch::TensorOptions(torch::kFloat32).memory_format(kInnermost));
  const float* left = dense_skip.data_ptr<float>();
  const float* map = dense.data_ptr<float>();
  float* out = joined.data_ptr<float>();
  for (std::int64_t image = 0; image < images; ++image, map += h * w * c) {
    for (std::int64_t y = 0; y < 2 * h; ++y) {
      const float* upper = map + y / 2 * w * c;
      const float* lower = map + std::min(y / 2 + y % 2, h - 1) * w * c;
      for (std::int64_t x = 0; x < 2 * w; ++x, left += c, out += 2 * c) {
        const std::int64_t a = x / 2 * c, b = std::min(x / 2 + x % 2, w - 1) * c;
        for (std::int64_t k = 0; k < c; ++k) out[k] = std::max(0.0F, left[k]);
        for (std::int64_t k = 0; k < c; ++k) {
          const float above = (upper[a + k] + upper[b + k]) * 0.5F;
          const float below = (lower[a + k] + lower[b + k]) * 0.5F;
          out[c + k] = std::max(0.0F, (above + below) * 0.5F);
        }
      }
    }
  }
  return joined;
}

}  // namespace

ConvImpl::ConvImpl(int in, int out, int kernel, Activation activation, int stride, int groups,
                   bool biased)
    : form_{stride, groups, activation, stride - 1} {
  weight_ = register_parameter("weight", torch::zeros({out, in / groups, kernel, kernel}));
  if (biased) bias_ = register_parameter("bias", torch::zeros({out}));
}

torch::Tensor ConvImpl::forward(const torch::Tensor& x) {
  return folded_.empty() ? convolve(x, weight_, bias_, form_) : folded_.run(x);
}

torch::Tensor ConvImpl::forward_onto(const torch::Tensor& base, const torch::Tensor& x) {
  return folded_.empty() ? base + forward(x) : folded_.run_onto(base, x);
}

void ConvImpl::fold() { folded_ = FoldedConvolution(weight_, bias_, form_); }

SeparableImpl::SeparableImpl(int in, int out, int kernel, const char* last) {
  depthwise_ = register_module(
      "depthwise", Conv(in, in, kernel, Activation::kNone, 1, in, /*biased=*/false));
  pointwise_ = register_module(last, Conv(in, out, 1));
}

torch::Tensor SeparableImpl::forward(const torch::Tensor& x) {
  return pointwise_(depthwise_(x));
}

torch::Tensor SeparableImpl::forward_onto(const torch::Tensor& base, const torch::Tensor& x) {
  return pointwise_->forward_onto(base, depthwise_(x));
}

SqueezeImpl::SqueezeImpl(int channels, int hidden, Gate gate) : gate_(gate) {
  reduce_ = register_module("reduce", Conv(channels, hidden, 1, Activation::kRelu));
  expand_ = register_module("expand", Conv(hidden, channels, 1, Activation::kNone, 1, 1,
                                           /*biased=*/gate == Gate::kHardSigmoid));
}

torch::Tensor SqueezeImpl::forward(const torch::Tensor& x) {
  const auto y = expand_(reduce_(x.mean({2, 3}, /*keepdim=*/true)));
  return x * (gate_ == Gate::kSigmoid ? y.sigmoid() : hard_sigmoid(y));
}

BlockImpl::BlockImpl(int in, const BlockForm& form)
    : residual_(form.stride == 1 && form.out == in) {
  const int width = form.expanded > 0 ? form.expanded : in;
  if (form.expanded > 0) {
    expand_ = register_module("expand", Conv(in, width, 1, form.activation));
  }
  depthwise_ = register_module(
      "depthwise", Conv(width, width, form.kernel, form.activation, form.stride, width));
  if (form.squeezed > 0) {
    squeeze_ = register_module("squeeze",
                               Squeeze(width, form.squeezed, SqueezeImpl::Gate::kHardSigmoid));
  }
  project_ = register_module("project", Conv(width, form.out, 1));
}

torch::Tensor BlockImpl::expand(const torch::Tensor& x) {
  return expand_.is_empty() ? x : expand_(x);
}

torch::Tensor BlockImpl::finish(const torch::Tensor& x, const torch::Tensor& expanded) {
  auto y = depthwise_(expanded);
  if (!squeeze_.is_empty()) y = squeeze_(y);
  return residual_ ? project_->forward_onto(x, y) : project_(y);
}

MergeImpl::MergeImpl(int level, int lateral, int top, int out) {
  lateral_ = register_module("lateral", Conv(level, lateral, 1, Activation::kRelu));
  skip_ = register_module("skip", Separable(lateral, out, 5));
  up3_ = register_module("up3", Separable(top, out, 3));
  up5_ = register_module("up5", Separable(top, out, 5));
}

torch::Tensor MergeImpl::forward(const torch::Tensor& level, const torch::Tensor& top) {
  const auto small = up5_->forward_onto(up3_(top), top), skip = skip_(lateral_(level));
  if (runs_on_onednn(small)) return join_directly(skip, small);
  return torch::relu(torch::cat({skip, double_sides(small)}, 1));
}

torch::Tensor double_sides(const torch::Tensor& x) {
  const auto along = [](const torch::Tensor& map, std::int64_t axis) {
    const std::int64_t side = map.size(axis);
    const auto next =
        torch::cat({map.narrow(axis, 1, side - 1), map.narrow(axis, side - 1, 1)}, axis);
    return torch::stack({map, (map + next) / 2}, axis + 1).flatten(axis, axis + 1);
  };
  return along(along(x, 3), 2);
}

}  // namespace segsim::perception::centernet
