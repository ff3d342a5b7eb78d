#include "perception/internal/network/onednn.h"

#include <ATen/Context.h>
#include <torch/torch.h>

#ifdef SEGSIM_ONEDNN
#include <oneapi/dnnl/dnnl.hpp>
#endif

#include <array>
#include <map>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "core/check.h"

namespace segsim::perception {

bool runs_on_onednn(const torch::Tensor& x) {
  return x.is_cpu() && x.scalar_type() == torch::kFloat32 && !torch::GradMode::is_enabled() &&
         at::globalContext().hasMKLDNN();
}

torch::Tensor hard_sigmoid(const torch::Tensor& x) {
  return torch::hardsigmoid(x) * kHardSwishGain;
}

torch::Tensor activate(const torch::Tensor& x, Activation activation) {
  switch (activation) {
    case Activation::kNone:
      return x;
    case Activation::kSilu:
      return torch::silu(x);
    case Activation::kRelu:
      return torch::relu(x);
    case Activation::kHardSwish:
      break;
  }
  return torch::hardswish(x) * kHardSwishGain;
}

torch::Tensor convolve(const torch::Tensor& x, const torch::Tensor& weight,
                       const torch::Tensor& bias, const ConvolutionForm& form) {
  SEGSIM_CHECK(form.less_before == 0 || form.less_before == 1,
               std::to_string(form.less_before));
  // libtorch pads all sides alike.
  const auto input = form.less_before == 0 ? x : torch::constant_pad_nd(x, {0, 1, 0, 1});
  const std::int64_t padding = weight.size(2) / 2 - form.less_before;
  const auto y =
      runs_on_onednn(x)
          ? at::mkldnn_convolution(input.contiguous(), weight, bias, {padding, padding},
                                   {form.stride, form.stride}, {1, 1}, form.groups)
          : torch::conv2d(input, weight, bias, form.stride, padding, 1, form.groups);
  return activate(y, form.activation);
}

#ifdef SEGSIM_ONEDNN

struct FoldedConvolution::Prepared {
  using Key = std::array<std::int64_t, 4>;
  struct Primitive {
    dnnl::convolution_forward convolution;
    dnnl::memory::desc source, target;
    dnnl::memory weight;
    bool quick = true;  ///< Not oneDNN's reference code, which is a hundred times slower.
  };

  /// @param adds  Whether the result is added to what the target holds.
  const Primitive& for_input(const FoldedConvolution& layer, const torch::Tensor& x,
                             bool adds) {
    const Key key{x.size(0), x.size(2), x.size(3), adds ? 1 : 0};
    const auto found = primitives.find(key);
    if (found != primitives.end()) return found->second;
    return primitives.emplace(key, make(layer, x, adds)).first->second;
  }

  Primitive make(const FoldedConvolution& layer, const torch::Tensor& x, bool adds) {
    using dnnl::memory;
    using tag = memory::format_tag;
    constexpr auto kFloat = memory::data_type::f32;
    const std::int64_t out = layer.weight_.size(0), in = x.size(1), g = layer.form_.groups;
    const std::int64_t k = layer.weight_.size(2), stride = layer.form_.stride;
    const std::int64_t after = k / 2, before = after - layer.form_.less_before;
    const auto side = [&](std::int64_t n) { return (n + before + after - k) / stride + 1; };
    const memory::desc source({x.size(0), in, x.size(2), x.size(3)}, kFloat, tag::nhwc);
    const memory::desc target({x.size(0), out, side(x.size(2)), side(x.size(3))}, kFloat,
                              tag::nhwc);
    const memory::dims shape =
        g == 1 ? memory::dims{out, in, k, k} : memory::dims{g, out / g, in / g, k, k};
    const memory::desc any_weight(shape, kFloat, tag::any);
    const memory::dims strides{stride, stride}, begin{before, before}, end{after, after};
    constexpr auto kKind = dnnl::prop_kind::forward_inference;
    constexpr auto kDirect = dnnl::algorithm::convolution_direct;
    const auto description =
        layer.bias_.defined()
            ? dnnl::convolution_forward::desc(kKind, kDirect, source, any_weight,
                                              memory::desc({out}, kFloat, tag::x), target,
                                              strides, begin, end)
            : dnnl::convolution_forward::desc(kKind, kDirect, source, any_weight, target,
                                              strides, begin, end);
    dnnl::post_ops operations;
    append_activation(operations, layer.form_.activation);
    if (adds) operations.append_sum(1.0F);
    dnnl::primitive_attr attributes;
    attributes.set_post_ops(operations);
    const dnnl::convolution_forward::primitive_desc chosen(description, attributes, engine);
    memory plain({shape, kFloat, g == 1 ? tag::oihw : tag::goihw}, engine,
                 layer.weight_.data_ptr());
    memory weight(chosen.weights_desc(), engine);
    dnnl::reorder(plain, weight).execute(stream, plain, weight);
    stream.wait();
    const bool quick = std::string_view(chosen.impl_info_str()).rfind("ref", 0) != 0;
    return {dnnl::convolution_forward(chosen), source, target, std::move(weight), quick};
  }

  static void append_activation(dnnl::post_ops& operations, Activation activation) {
    using dnnl::algorithm;
    switch (activation) {
      case Activation::kNone:
        return;
      case Activation::kSilu:
        return operations.append_eltwise(1.0F, algorithm::eltwise_swish, 1.0F, 0.0F);
      case Activation::kRelu:
        return operations.append_eltwise(1.0F, algorithm::eltwise_relu, 0.0F, 0.0F);
      case Activation::kHardSwish:
        return operations.append_eltwise(static_cast<float>(kHardSwishGain),
                                         algorithm::eltwise_hardswish, 0.0F, 0.0F);
    }
  }

  dnnl::engine engine{dnnl::engine::kind::cpu, 0};
  dnnl::stream stream{engine};
  std::map<Key, Primitive> primitives;
};

namespace {

void run_primitive(const torch::Tensor& x, const torch::Tensor& bias, const torch::Tensor& y,
                   const dnnl::memory::desc& source, const dnnl::memory::desc& target,
                   const dnnl::memory& weight, const dnnl::convolution_forward& convolution,
                   const dnnl::engine& engine, dnnl::stream& stream) {
  std::unordered_map<int, dnnl::memory> arguments{
      {DNNL_ARG_SRC, dnnl::memory(source, engine, x.data_ptr())},
      {DNNL_ARG_WEIGHTS, weight},
      {DNNL_ARG_DST, dnnl::memory(target, engine, y.data_ptr())}};
  if (bias.defined()) {
    const dnnl::memory::desc line({bias.numel()}, dnnl::memory::data_type::f32,
                                  dnnl::memory::format_tag::x);
    arguments.emplace(DNNL_ARG_BIAS, dnnl::memory(line, engine, bias.data_ptr()));
  }
  convolution.execute(stream, arguments);
  stream.wait();
}

}  // namespace

/// @param base  Undefined, or what the result is added to, in place.
torch::Tensor FoldedConvolution::run_directly(const torch::Tensor& x,
                                              const torch::Tensor& base) {
  constexpr auto kChannelsLast = torch::MemoryFormat::ChannelsLast;
  if (prepared_ == nullptr) prepared_ = std::make_unique<Prepared>();
  const auto input = x.contiguous(kChannelsLast);
  const Prepared::Primitive& p = prepared_->for_input(*this, input, base.defined());
  auto y =
      base.defined()
          ? base
          : torch::empty(p.target.dims(),
                         torch::TensorOptions(torch::kFloat32).memory_format(kChannelsLast));
  run_primitive(input, bias_, y, p.source, p.target, p.weight, p.convolution,
                prepared_->engine, prepared_->stream);
  return y;
}

#else

struct FoldedConvolution::Prepared {};

#endif

FoldedConvolution::FoldedConvolution() = default;
FoldedConvolution::~FoldedConvolution() = default;
FoldedConvolution::FoldedConvolution(FoldedConvolution&&) noexcept = default;
FoldedConvolution& FoldedConvolution::operator=(FoldedConvolution&&) noexcept = default;

FoldedConvolution::FoldedConvolution(const torch::Tensor& weight, const torch::Tensor& bias,
                                     const ConvolutionForm& form)
    : weight_(weight.detach().contiguous()),
      bias_(bias.defined() ? bias.detach().contiguous() : bias),
      form_(form) {}

torch::Tensor FoldedConvolution::run(const torch::Tensor& x) {
#ifdef SEGSIM_ONEDNN
  if (runs_on_onednn(x)) return run_directly(x, {});
#endif
  return convolve(x, weight_, bias_, form_);
}

torch::Tensor FoldedConvolution::run_onto(const torch::Tensor& base, const torch::Tensor& x) {
#ifdef SEGSIM_ONEDNN
  constexpr auto kChannelsLast = torch::MemoryFormat::ChannelsLast;
  if (runs_on_onednn(x) && base.is_contiguous(kChannelsLast)) {
    const auto input = x.contiguous(kChannelsLast);
    if (prepared_ == nullptr) prepared_ = std::make_unique<Prepared>();
    // Without AVX-512 a sum behind an activation is nothing that oneDNN has code for.
    if (prepared_->for_input(*this, input, true).quick) return run_directly(input, base);
  }
#endif
  return base + run(x);
}

}  // namespace segsim::perception
