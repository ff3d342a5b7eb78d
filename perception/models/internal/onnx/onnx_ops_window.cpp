// Convolution and pooling.
#include <algorithm>
#include <limits>
#include <numeric>

#include "perception/models/internal/onnx/onnx_node_call.h"

namespace segsim::perception::graph {
namespace {

using at::Tensor;
using Sizes = std::vector<std::int64_t>;

Sizes spatial_of(const NodeCall& call, const Tensor& x) {
  if (x.dim() < 3 || x.dim() > 5) {
    call.fail("[batch, channels, 1 to 3 spatial axes]", shape_text(x.sizes().vec()));
  }
  return {x.sizes().begin() + 2, x.sizes().end()};
}

/// How a window moves over an image.
struct Window {
  Sizes spatial, kernel, strides, dilations, pads;

  [[nodiscard]] std::size_t axes() const { return spatial.size(); }
  [[nodiscard]] bool symmetric() const {
    return std::equal(pads.begin(), pads.begin() + static_cast<std::ptrdiff_t>(axes()),
                      pads.begin() + static_cast<std::ptrdiff_t>(axes()));
  }
  [[nodiscard]] Sizes first_pads() const {
    return {pads.begin(), pads.begin() + static_cast<std::ptrdiff_t>(axes())};
  }
};

Window window_of(const NodeCall& call, const Tensor& x, Sizes kernel) {
  Window window;
  window.spatial = spatial_of(call, x);
  const std::size_t n = window.axes();
  const Sizes stated = call.integers_of("kernel_shape");
  if (kernel.empty()) kernel = stated;
  const bool fits = kernel.size() == n && (stated.empty() || stated == kernel) &&
                    std::all_of(kernel.begin(), kernel.end(), [](std::int64_t side) {
                      return side >= 1 && side <= kMaxElements;
                    });
  if (!fits) {
    call.fail("a kernel of " + std::to_string(n) + " sides",
              shape_text(kernel) + " and " + shape_text(stated));
  }
  window.kernel = std::move(kernel);
  window.strides = per_axis(call, "strides", n, 1, 1);
  window.dilations = per_axis(call, "dilations", n, 1, 1);
  window.pads =
      window_pads(call, window.spatial, window.kernel, window.strides, window.dilations);
  Sizes padded = x.sizes().vec();
  for (std::size_t i = 0; i < n; ++i) padded[2 + i] += window.pads[i] + window.pads[n + i];
  call.check_size(padded);
  return window;
}

Sizes kernel_of(const NodeCall& call, const Tensor& weight) {
  if (weight.dim() < 3)
    call.fail("weights with spatial axes", shape_text(weight.sizes().vec()));
  return {weight.sizes().begin() + 2, weight.sizes().end()};
}

std::int64_t groups_of(const NodeCall& call, const Tensor& x) {
  const std::int64_t groups = call.attribute_or("group", 1);
  if (groups < 1 || x.size(1) % groups != 0) {
    call.fail("groups that divide " + std::to_string(x.size(1)) + " channels",
              std::to_string(groups));
  }
  return groups;
}

/// libtorch hands some 2-D convolutions to the BLAS library, which may be slow
/// (docs/yolov13.md); oneDNN has code for all.
Tensor convolve(const Tensor& x, const Tensor& weight, const Tensor& bias, const Window& w,
                const Sizes& padding, std::int64_t groups) {
  if (x.dim() == 4 && x.scalar_type() == at::kFloat && x.is_cpu() && at::hasMKLDNN() &&
      x.numel() > 0 && weight.numel() > 0) {
    return at::mkldnn_convolution(x.contiguous(), weight.contiguous(), bias, padding,
                                  w.strides, w.dilations, groups);
  }
  return at::convolution(x, weight, bias, w.strides, padding, w.dilations, false,
                         Sizes(w.axes(), 0), groups);
}

Values conv(const NodeCall& call) {
  Tensor x = call.input(0);
  const Tensor& weight = call.input(1);
  const Window window = window_of(call, x, kernel_of(call, weight));
  const std::int64_t groups = groups_of(call, x);
  const bool fits =
      weight.dim() == x.dim() && weight.size(1) == x.size(1) / groups &&
      weight.size(0) % groups == 0 &&
      (!call.has(2) || (call.input(2).dim() == 1 && call.input(2).size(0) == weight.size(0)));
  if (!fits) {
    call.fail("weights and bias for " + std::to_string(x.size(1)) + " channels",
              shape_text(weight.sizes().vec()));
  }
  for (std::size_t i = 0; i < window.axes(); ++i) {
    const std::int64_t reach = (window.kernel[i] - 1) * window.dilations[i] + 1;
    const std::int64_t side =
        window.spatial[i] + window.pads[i] + window.pads[window.axes() + i];
    if (side < reach) {
      call.fail("an image of at least " + std::to_string(reach) + " with its pads",
                std::to_string(side));
    }
  }
  Sizes padding = window.first_pads();
  if (!window.symmetric()) {
    x = at::constant_pad_nd(x, reversed_pads(window.pads), 0);
    padding.assign(window.axes(), 0);
  }
  return {convolve(x, weight, call.optional_input(2), window, padding, groups)};
}

/// Pads of a transposed convolution that is told the size of its result.
Sizes pads_for_output(const NodeCall& call, const Window& window, const Sizes& extra,
                      const Sizes& wanted) {
  const std::size_t n = window.axes();
  if (wanted.size() != n && wanted.size() != n + 2) {
    call.fail("an output_shape of the spatial axes", shape_text(wanted));
  }
  const bool upper = call.text_or("auto_pad", "NOTSET") == "SAME_UPPER";
  Sizes pads(2 * n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    const std::int64_t full = window.strides[i] * (window.spatial[i] - 1) + extra[i] +
                              (window.kernel[i] - 1) * window.dilations[i] + 1;
    const std::int64_t total = full - wanted[wanted.size() - n + i];
    // A larger result than the windows reach grows at its end.
    pads[i] = total < 0 ? 0 : upper ? total / 2 : total - total / 2;
    pads[n + i] = total - pads[i];
  }
  return pads;
}

/// Computed in full and cut to the pads, which may differ from side to side.
Values conv_transpose(const NodeCall& call) {
  const Tensor &x = call.input(0), &weight = call.input(1);
  Window window = window_of(call, x, kernel_of(call, weight));
  const std::size_t n = window.axes();
  const Sizes extra = per_axis(call, "output_padding", n, 0, 0);
  Sizes wanted = call.integers_of("output_shape");
  if (wanted.empty() && call.text_or("auto_pad", "NOTSET").starts_with("SAME")) {
    for (std::size_t i = 0; i < n; ++i)
      wanted.push_back(window.spatial[i] * window.strides[i]);
  }
  if (!wanted.empty()) window.pads = pads_for_output(call, window, extra, wanted);
  const std::int64_t groups = groups_of(call, x);
  if (weight.dim() != x.dim() || weight.size(0) != x.size(1)) {
    call.fail("weights for " + std::to_string(x.size(1)) + " channels",
              shape_text(weight.sizes().vec()));
  }
  const Sizes none(n, 0);
  Tensor full = at::convolution(x, weight, {}, window.strides, none, window.dilations, true,
                                none, groups);
  Sizes cut(2 * n);
  for (std::size_t i = 0; i < n; ++i) {
    cut[i] = -window.pads[i];
    cut[n + i] = extra[i] - window.pads[n + i];
  }
  full = at::constant_pad_nd(full, reversed_pads(cut), 0);
  if (!call.has(2)) return {full};
  Sizes line(static_cast<std::size_t>(x.dim()), 1);
  line[1] = -1;
  return {full + call.input(2).reshape(line)};
}

/// Pools of one spatial axis are done with a second one of side 1.
Tensor as_image(const Tensor& x) { return x.dim() == 3 ? x.unsqueeze(2) : x; }

Window as_image(Window window) {
  if (window.axes() > 1) return window;
  window.spatial.insert(window.spatial.begin(), 1);
  window.kernel.insert(window.kernel.begin(), 1);
  window.strides.insert(window.strides.begin(), 1);
  window.dilations.insert(window.dilations.begin(), 1);
  window.pads = {0, window.pads[0], 0, window.pads[1]};
  return window;
}

Tensor lowest(const Tensor& x) {
  if (at::isFloatingType(x.scalar_type())) {
    return at::scalar_tensor(-std::numeric_limits<double>::infinity(), x.options());
  }
  const bool is_signed = x.scalar_type() == at::kChar;
  return at::scalar_tensor(is_signed ? -128 : 0, x.options());
}

Values max_pool(const NodeCall& call) {
  const Tensor& raw = call.input(0);
  const Window window = as_image(window_of(call, raw, {}));
  const bool widen =
      !at::isFloatingType(raw.scalar_type());  // int8 and uint8: exact as float.
  Tensor x = as_image(widen ? raw.to(at::kFloat) : raw);
  const bool native =
      window.symmetric() &&
      std::equal(window.kernel.begin(), window.kernel.end(), window.pads.begin(),
                 [](std::int64_t k, std::int64_t pad) { return pad <= k / 2; });
  if (!native) {
    if (call.wants(1))
      call.fail("equal pads, at most half the kernel, with indices", "others");
    x = at::constant_pad_nd(x, reversed_pads(window.pads),
                            lowest(widen ? raw : x).to(at::kDouble).item<double>());
  }
  const Sizes padding = native ? window.first_pads() : Sizes(window.axes(), 0);
  const bool ceil = call.attribute_or("ceil_mode", 0) != 0;
  auto [best, where] = window.axes() == 2
                           ? at::max_pool2d_with_indices(x, window.kernel, window.strides,
                                                         padding, window.dilations, ceil)
                           : at::max_pool3d_with_indices(x, window.kernel, window.strides,
                                                         padding, window.dilations, ceil);
  if (raw.dim() == 3) {
    best = best.squeeze(2);
    where = where.squeeze(2);
  }
  if (widen) best = best.to(raw.scalar_type());
  if (!call.wants(1)) return {best};
  if (call.attribute_or("storage_order", 0) != 0) call.fail("storage_order 0", "1");
  // Indices count from the start of the whole tensor.
  const std::int64_t planes = raw.size(0) * raw.size(1);
  const std::int64_t plane = planes == 0 ? 0 : raw.numel() / planes;
  Sizes line(static_cast<std::size_t>(raw.dim()), 1);
  line[0] = raw.size(0);
  line[1] = raw.size(1);
  return {best, where + (at::arange(planes, at::kLong) * plane).reshape(line)};
}

Tensor window_sum(const Tensor& x, const Window& w, bool ceil) {
  const Sizes none(w.axes(), 0);
  if (w.axes() == 2) return at::avg_pool2d(x, w.kernel, w.strides, none, ceil, true, 1);
  return at::avg_pool3d(x, w.kernel, w.strides, none, ceil, true, 1);
}

/// Sum of the window over the number of its places, with or without the pads.
Values average_pool(const NodeCall& call) {
  const Tensor& raw = call.input(0);
  const Window window = as_image(window_of(call, raw, {}));
  if (std::any_of(window.dilations.begin(), window.dilations.end(),
                  [](std::int64_t d) { return d != 1; })) {
    call.fail("dilations of 1", shape_text(window.dilations));
  }
  const bool ceil = call.attribute_or("ceil_mode", 0) != 0;
  const Tensor x = as_image(raw);
  const Sizes pads = reversed_pads(window.pads);
  const double pad_counts = call.attribute_or("count_include_pad", 0) != 0 ? 1.0 : 0.0;
  const Tensor ones =
      at::constant_pad_nd(at::ones_like(x.slice(0, 0, 1).slice(1, 0, 1)), pads, pad_counts);
  const Tensor mean = window_sum(at::constant_pad_nd(x, pads, 0), window, ceil) /
                      window_sum(ones, window, ceil);
  return {raw.dim() == 3 ? mean.squeeze(2) : mean};
}

Sizes spatial_axes(const Tensor& x) {
  Sizes axes(static_cast<std::size_t>(std::max<std::int64_t>(x.dim() - 2, 0)));
  std::iota(axes.begin(), axes.end(), 2);
  return axes;
}

Values global_average_pool(const NodeCall& call) {
  const Tensor& x = call.input(0);
  spatial_of(call, x);
  return {at::mean(x, spatial_axes(x), true)};
}

Values global_max_pool(const NodeCall& call) {
  const Tensor& x = call.input(0);
  spatial_of(call, x);
  return {at::amax(x, spatial_axes(x), true)};
}

constexpr Operator kOperators[] = {
    {"AveragePool", 7, kLastOpset, 1, 1,
     "auto_pad ceil_mode count_include_pad dilations kernel_shape pads strides", average_pool},
    {"Conv", 1, kLastOpset, 2, 3, "auto_pad dilations group kernel_shape pads strides", conv},
    {"ConvTranspose", 1, kLastOpset, 2, 3,
     "auto_pad dilations group kernel_shape output_padding output_shape pads strides",
     conv_transpose},
    {"GlobalAveragePool", 1, kLastOpset, 1, 1, "", global_average_pool},
    {"GlobalMaxPool", 1, kLastOpset, 1, 1, "", global_max_pool},
    {"MaxPool", 1, kLastOpset, 1, 1,
     "auto_pad ceil_mode dilations kernel_shape pads storage_order strides", max_pool},
};

}  // namespace

std::span<const Operator> window_operators() { return kOperators; }

}  // namespace segsim::perception::graph
