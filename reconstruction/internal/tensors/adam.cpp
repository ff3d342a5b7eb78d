#include "reconstruction/internal/tensors/adam.h"

#include <algorithm>
#include <cmath>

#include <ATen/Parallel.h>

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr double kBeta1 = 0.9, kBeta2 = 0.999, kEpsilon = 1e-8;

/// [rows, 1, ...], to multiply values of as many dimensions.
Tensor per_row(const Tensor& rows, const Tensor& like) {
  std::vector<std::int64_t> shape(static_cast<std::size_t>(like.dim()), 1);
  shape[0] = like.size(0);
  return rows.view(shape);
}

}  // namespace

AdamTensor::AdamTensor(const Tensor& value)
    : value_(value.contiguous()),
      first_(torch::zeros_like(value_)),
      second_(torch::zeros_like(value_)),
      steps_(torch::zeros({value.size(0)}, value.options().dtype(torch::kInt32))) {}

void AdamTensor::step(const Tensor& gradient, double rate) {
  step_rows(torch::arange(value_.size(0), value_.options().dtype(torch::kInt64)), gradient,
            rate);
}

void AdamTensor::step_rows(const Tensor& rows, const Tensor& gradient, double rate) {
  const at::NoGradGuard no_grad;
  if (rows.size(0) == 0) return;
  if (value_.is_cpu() && value_.scalar_type() == torch::kFloat32) {
    step_rows_on_cpu(rows, gradient.contiguous(), rate);
    return;
  }
  const Tensor steps = steps_.index_select(0, rows) + 1;
  const Tensor first = first_.index_select(0, rows).mul_(kBeta1).add_(gradient, 1.0 - kBeta1);
  const Tensor second =
      second_.index_select(0, rows).mul_(kBeta2).addcmul_(gradient, gradient, 1.0 - kBeta2);
  const Tensor count = per_row(steps, value_.index_select(0, rows)).to(torch::kFloat64);
  const Tensor bias1 = (1.0 - torch::pow(kBeta1, count)).to(value_.scalar_type());
  const Tensor bias2 = (1.0 - torch::pow(kBeta2, count)).to(value_.scalar_type());
  const Tensor change = (first / bias1) / ((second / bias2).sqrt_().add_(kEpsilon));
  value_.index_copy_(0, rows, value_.index_select(0, rows).sub_(change, rate));
  first_.index_copy_(0, rows, first);
  second_.index_copy_(0, rows, second);
  steps_.index_copy_(0, rows, steps);
}

void AdamTensor::know_bias(std::int32_t most) {
  for (auto count = static_cast<int>(bias_.size()); count <= most; ++count) {
    bias_.push_back({1.0 - std::pow(kBeta1, count),
                     static_cast<float>(1.0 / std::sqrt(1.0 - std::pow(kBeta2, count)))});
  }
}

void AdamTensor::step_rows_on_cpu(const Tensor& rows, const Tensor& gradient, double rate) {
  const std::int64_t width = value_.size(0) == 0 ? 0 : value_.numel() / value_.size(0);
  const auto* row = rows.data_ptr<std::int64_t>();
  const auto* g = gradient.data_ptr<float>();
  auto* value = value_.data_ptr<float>();
  auto* first = first_.data_ptr<float>();
  auto* second = second_.data_ptr<float>();
  auto* steps = steps_.data_ptr<std::int32_t>();
  constexpr auto kB1 = static_cast<float>(kBeta1), kB2 = static_cast<float>(kBeta2);
  // 1 - kB2 would be 0.001 to four digits only.
  constexpr auto kRest1 = static_cast<float>(1.0 - kBeta1);
  constexpr auto kRest2 = static_cast<float>(1.0 - kBeta2);
  std::int32_t most = 0;
  for (std::int64_t i = 0; i < rows.size(0); ++i) most = std::max(most, steps[row[i]] + 1);
  know_bias(most);
  at::parallel_for(0, rows.size(0), 1024, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      const BiasCorrection& bias = bias_[static_cast<std::size_t>(++steps[row[i]])];
      const auto scale = static_cast<float>(rate / bias.first);
      const float bias2 = bias.inverse_root_second;
      const std::int64_t at = row[i] * width;
      for (std::int64_t k = 0; k < width; ++k) {
        const float gradient_k = g[i * width + k];
        float& m = first[at + k];
        float& v = second[at + k];
        m = kB1 * m + kRest1 * gradient_k;
        v = kB2 * v + kRest2 * gradient_k * gradient_k;
        value[at + k] -= scale * m / (std::sqrt(v) * bias2 + static_cast<float>(kEpsilon));
      }
    }
  });
}

void AdamTensor::select(const Tensor& rows) {
  value_ = value_.index_select(0, rows);
  first_ = first_.index_select(0, rows);
  second_ = second_.index_select(0, rows);
  steps_ = steps_.index_select(0, rows);
}

void AdamTensor::append(const Tensor& values) {
  const AdamTensor added(values);
  value_ = torch::cat({value_, added.value_});
  first_ = torch::cat({first_, added.first_});
  second_ = torch::cat({second_, added.second_});
  steps_ = torch::cat({steps_, added.steps_});
}

void AdamTensor::save(StateWriter& out, const std::string& name) const {
  out.put(name, value_);
  out.put(name + ".first", first_);
  out.put(name + ".second", second_);
  out.put(name + ".steps", steps_);
}

void AdamTensor::load(const StateReader& in, const std::string& name) {
  value_ = in.take(name, value_);
  first_ = in.take(name + ".first", value_);
  second_ = in.take(name + ".second", value_);
  steps_ = in.take(name + ".steps", steps_);
}

}  // namespace segsim::reconstruction::internal
