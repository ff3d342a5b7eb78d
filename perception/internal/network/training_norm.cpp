#include "perception/internal/network/training_norm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <ATen/Parallel.h>
#include <torch/autograd.h>

#include "core/process/kernel_choice.h"

#ifdef __x86_64__
#include <immintrin.h>
#endif

namespace segsim::perception {
namespace {

/// A contiguous image stack: `pixels` values for each channel of each of `images`.
struct Planes {
  std::int64_t images = 0, channels = 0, pixels = 0;
  [[nodiscard]] std::int64_t plane(std::int64_t image, std::int64_t channel) const {
    return (image * channels + channel) * pixels;
  }
  [[nodiscard]] std::int64_t count() const { return images * pixels; }
};

struct ChannelStatistics {
  float mean = 0.0F;
  float squares = 0.0F;  ///< Sum of squared differences from it.
};

/// Of `kSide` neighbouring channels. The order of each channel's sum, and where it is rounded
/// to float, are libtorch's: other orders have other last bits.
template <int kSide>
void add_up(const float* x, const Planes& planes, std::int64_t channel,
            ChannelStatistics* statistics) {
  std::array<double, kSide> sums{}, squares{};
  std::array<float, kSide> means{};
  for (std::int64_t image = 0; image < planes.images; ++image) {
    const float* from = x + planes.plane(image, channel);
    for (std::int64_t i = 0; i < planes.pixels; ++i) {
      for (int k = 0; k < kSide; ++k) sums[k] += double{from[k * planes.pixels + i]};
    }
  }
  for (int k = 0; k < kSide; ++k) {
    means[k] = static_cast<float>(sums[k] / static_cast<double>(planes.count()));
  }
  for (std::int64_t image = 0; image < planes.images; ++image) {
    const float* from = x + planes.plane(image, channel);
    for (std::int64_t i = 0; i < planes.pixels; ++i) {
      for (int k = 0; k < kSide; ++k) {
        const float off = from[k * planes.pixels + i] - means[k];
        squares[k] += double{off * off};
      }
    }
  }
  for (int k = 0; k < kSide; ++k) {
    statistics[k] = {means[k], static_cast<float>(squares[k])};
  }
}

std::vector<ChannelStatistics> statistics_of(const float* x, const Planes& planes) {
  constexpr int kSide = 8;
  std::vector<ChannelStatistics> statistics(static_cast<std::size_t>(planes.channels));
  const std::int64_t groups = (planes.channels + kSide - 1) / kSide;
  at::parallel_for(0, groups, 1, [&](std::int64_t first, std::int64_t last) {
    std::int64_t c = first * kSide;
    const std::int64_t end = std::min(last * kSide, planes.channels);
    for (; c + kSide <= end; c += kSide) add_up<kSide>(x, planes, c, statistics.data() + c);
    for (; c < end; ++c) add_up<1>(x, planes, c, statistics.data() + c);
  });
  return statistics;
}

#ifdef __x86_64__
/// to = scale * from + shift, rounded once, as libtorch's AVX2 kernels do.
[[gnu::target("avx2,fma")]] void scale_and_shift(const float* from, std::int64_t count,
                                                 float scale, float shift, float* to) {
  const __m256 scales = _mm256_set1_ps(scale), shifts = _mm256_set1_ps(shift);
  std::int64_t i = 0;
  for (; i + 8 <= count; i += 8) {
    _mm256_storeu_ps(to + i, _mm256_fmadd_ps(_mm256_loadu_ps(from + i), scales, shifts));
  }
  for (; i < count; ++i) to[i] = std::fma(from[i], scale, shift);
}
#else
void scale_and_shift(const float* from, std::int64_t count, float scale, float shift,
                     float* to) {
  for (std::int64_t i = 0; i < count; ++i) to[i] = std::fma(from[i], scale, shift);
}
#endif

/// The running means and variances move by `momentum` towards this batch's.
void move_running(const std::vector<ChannelStatistics>& statistics, const Planes& planes,
                  double momentum, torch::Tensor running_mean, torch::Tensor running_var) {
  const auto part = static_cast<float>(momentum);
  auto mean = running_mean.accessor<float, 1>();
  auto var = running_var.accessor<float, 1>();
  for (std::int64_t c = 0; c < planes.channels; ++c) {
    const ChannelStatistics& of = statistics[static_cast<std::size_t>(c)];
    const double unbiased = of.squares / static_cast<float>(planes.count() - 1);
    mean[c] = part * of.mean + (1 - part) * mean[c];
    var[c] = static_cast<float>(double{part} * unbiased + double{(1 - part) * var[c]});
  }
}

struct Normalise : torch::autograd::Function<Normalise> {
  static torch::Tensor forward(torch::autograd::AutogradContext* context,
                               const torch::Tensor& x, const torch::Tensor& weight,
                               const torch::Tensor& bias, const torch::Tensor& running_mean,
                               const torch::Tensor& running_var, double momentum, double eps) {
    const Planes planes{x.size(0), x.size(1), x.size(2) * x.size(3)};
    const std::vector<ChannelStatistics> statistics =
        statistics_of(x.data_ptr<float>(), planes);
    torch::Tensor mean = torch::empty({planes.channels}), inverse = torch::empty_like(mean);
    torch::Tensor out = torch::empty_like(x);
    const float *weights = weight.data_ptr<float>(), *biases = bias.data_ptr<float>();
    const float* from = x.data_ptr<float>();
    float *means = mean.data_ptr<float>(), *inverses = inverse.data_ptr<float>();
    float* to = out.data_ptr<float>();
    const auto normalise = [&](std::int64_t c) {
      const ChannelStatistics& of = statistics[static_cast<std::size_t>(c)];
      const float variance = of.squares / static_cast<float>(planes.count());
      means[c] = of.mean;
      inverses[c] = static_cast<float>(1.0 / std::sqrt(double{variance} + eps));
      const float scale = inverses[c] * weights[c];
      const float shift = std::fma(-of.mean, scale, biases[c]);
      for (std::int64_t image = 0; image < planes.images; ++image) {
        const std::int64_t at = planes.plane(image, c);
        scale_and_shift(from + at, planes.pixels, scale, shift, to + at);
      }
    };
    at::parallel_for(0, planes.channels, 1, [&](std::int64_t first, std::int64_t end) {
      for (std::int64_t c = first; c < end; ++c) normalise(c);
    });
    move_running(statistics, planes, momentum, running_mean, running_var);
    context->save_for_backward({x, weight, running_mean, running_var, mean, inverse});
    context->saved_data["eps"] = eps;
    return out;
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    const auto saved = context->get_saved_variables();
    auto [x, weight, bias] = at::native_batch_norm_backward(
        gradients[0], saved[0], saved[1], saved[2], saved[3], saved[4], saved[5], true,
        context->saved_data["eps"].toDouble(),
        {context->needs_input_grad(0), context->needs_input_grad(1),
         context->needs_input_grad(2)});
    return {x, weight, bias, {}, {}, {}, {}};
  }
};

bool is_ours(const torch::nn::BatchNorm2d& norm, const torch::Tensor& x) {
  const auto& options = norm->options;
  return norm->is_training() && options.affine() && options.track_running_stats() &&
         options.momentum().has_value() && x.dim() == 4 && x.size(0) > 0 &&
         x.size(1) == options.num_features() && x.size(2) * x.size(3) > 1 &&
         x.device().is_cpu() && x.scalar_type() == torch::kFloat && x.is_contiguous() &&
         core::can_be_reproducible();
}

}  // namespace

torch::Tensor apply_norm(torch::nn::BatchNorm2d& norm, const torch::Tensor& x) {
  if (!is_ours(norm, x)) return norm(x);
  norm->num_batches_tracked += 1;
  return Normalise::apply(x, norm->weight, norm->bias, norm->running_mean, norm->running_var,
                          *norm->options.momentum(), norm->options.eps());
}

}  // namespace segsim::perception
