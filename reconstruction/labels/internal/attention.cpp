#include "reconstruction/labels/internal/attention.h"

#include <cmath>

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>

namespace segsim::reconstruction::internal {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::Function;
using torch::autograd::variable_list;

constexpr std::int64_t kRowsPerTask = 256;

bool is_softmax(renderer::LabelVariant variant) {
  return variant == renderer::LabelVariant::kTemperature ||
         variant == renderer::LabelVariant::kLiteral;
}

double inverse_temperature(const LabelSettings& settings) {
  return settings.variant == renderer::LabelVariant::kLiteral ? 1.0
                                                              : 1.0 / settings.temperature;
}

bool has_reach(renderer::LabelVariant variant) {
  return variant == renderer::LabelVariant::kNormalised ||
         variant == renderer::LabelVariant::kRaw;
}

/// A of one surfel, and 1 - S.
template <class Real>
void attention_row(const Real* logit, const Real* distance2, std::int64_t queries, Real reach2,
                   Real* a, Real* one_minus_s) {
  for (std::int64_t q = 0; q < queries; ++q) {
    if (distance2[q] > reach2) {
      a[q] = one_minus_s[q] = Real{0};
      continue;
    }
    const Real s = Real{1} / (Real{1} + std::exp(-logit[q]));
    a[q] = s * std::exp(Real{-0.5} * distance2[q]);
    one_minus_s[q] = Real{1} - s;
  }
}

/// Labels of one surfel from its A. @return  What sums were divided by.
template <class Real>
Real label_row(const Real* a, std::int64_t queries, const LabelSettings& settings, Real* l) {
  Real sum = Real{0};
  if (settings.variant == renderer::LabelVariant::kRaw) {
    std::copy(a, a + queries, l);
    return Real{1};
  }
  if (is_softmax(settings.variant)) {
    const auto beta = static_cast<Real>(inverse_temperature(settings));
    for (std::int64_t q = 0; q < queries; ++q) {
      l[q] = a[q] == Real{0} ? Real{1} : std::exp(beta * a[q]);
      sum += l[q];
    }
  } else {
    sum = static_cast<Real>(settings.none_score);
    for (std::int64_t q = 0; q < queries; ++q) sum += l[q] = a[q];
  }
  const Real scale = sum > Real{0} ? Real{1} / sum : Real{0};
  for (std::int64_t q = 0; q < queries; ++q) l[q] *= scale;
  return sum;
}

/// dA from dl, into `g`. For softmax variants dA_q = beta l_q (g_q - sum g l), else
/// (g_q - sum g l) / sum.
template <class Real>
void label_gradient_row(const Real* l, const Real* gradient, std::int64_t queries, Real sum,
                        const LabelSettings& settings, Real* g) {
  if (settings.variant == renderer::LabelVariant::kRaw) {
    std::copy(gradient, gradient + queries, g);
    return;
  }
  Real mean = Real{0};
  for (std::int64_t q = 0; q < queries; ++q) mean += gradient[q] * l[q];
  if (is_softmax(settings.variant)) {
    const auto beta = static_cast<Real>(inverse_temperature(settings));
    for (std::int64_t q = 0; q < queries; ++q) g[q] = beta * l[q] * (gradient[q] - mean);
    return;
  }
  const Real scale = sum > Real{0} ? Real{1} / sum : Real{0};
  for (std::int64_t q = 0; q < queries; ++q) g[q] = scale * (gradient[q] - mean);
}

/// All of it in one pass over memory; pairs out of reach cost a comparison.
class QueryLabels : public Function<QueryLabels> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& logit_in,
                        const Tensor& distance2_in, const LabelSettings* settings_in) {
    const LabelSettings settings = *settings_in;
    const Tensor logit = logit_in.contiguous(), distance2 = distance2_in.contiguous();
    Tensor labels = torch::empty_like(logit), a = torch::empty_like(logit);
    Tensor one_minus_s = torch::empty_like(logit);
    Tensor sum = torch::empty({logit.size(0)}, logit.options());
    const std::int64_t queries = logit.size(1);
    AT_DISPATCH_FLOATING_TYPES(logit.scalar_type(), "query_labels", [&] {
      const auto reach2 = static_cast<scalar_t>(
          has_reach(settings.variant) ? renderer::kAttentionReach2 : INFINITY);
      const scalar_t *x = logit.data_ptr<scalar_t>(), *d2 = distance2.data_ptr<scalar_t>();
      scalar_t *l = labels.data_ptr<scalar_t>(), *score = a.data_ptr<scalar_t>(),
               *rest = one_minus_s.data_ptr<scalar_t>(), *z = sum.data_ptr<scalar_t>();
      at::parallel_for(0, logit.size(0), kRowsPerTask, [&](std::int64_t i, std::int64_t end) {
        for (; i < end; ++i) {
          const std::int64_t at = i * queries;
          attention_row(x + at, d2 + at, queries, reach2, score + at, rest + at);
          z[i] = label_row(score + at, queries, settings, l + at);
        }
      });
    });
    context->save_for_backward({labels, a, one_minus_s, sum});
    context->saved_data["variant"] = static_cast<std::int64_t>(settings.variant);
    context->saved_data["none"] = settings.none_score;
    context->saved_data["temperature"] = settings.temperature;
    return labels;
  }

  static variable_list backward(AutogradContext* context, const variable_list& gradients) {
    const variable_list saved = context->get_saved_variables();
    const LabelSettings settings{
        static_cast<renderer::LabelVariant>(context->saved_data["variant"].toInt()),
        context->saved_data["none"].toDouble(), context->saved_data["temperature"].toDouble()};
    const Tensor gradient = gradients[0].contiguous();
    Tensor by_logit = torch::empty_like(gradient), by_distance2 = torch::empty_like(gradient);
    const std::int64_t queries = gradient.size(1);
    AT_DISPATCH_FLOATING_TYPES(gradient.scalar_type(), "query_labels", [&] {
      const scalar_t *l = saved[0].data_ptr<scalar_t>(), *a = saved[1].data_ptr<scalar_t>(),
                     *rest = saved[2].data_ptr<scalar_t>(), *z = saved[3].data_ptr<scalar_t>(),
                     *g = gradient.data_ptr<scalar_t>();
      scalar_t *dx = by_logit.data_ptr<scalar_t>(), *dd = by_distance2.data_ptr<scalar_t>();
      at::parallel_for(
          0, gradient.size(0), kRowsPerTask, [&](std::int64_t i, std::int64_t end) {
            for (; i < end; ++i) {
              const std::int64_t at = i * queries;
              label_gradient_row(l + at, g + at, queries, z[i], settings, dx + at);
              for (std::int64_t q = at; q < at + queries; ++q) {
                const scalar_t by_a = dx[q] * a[q];
                dx[q] = by_a * rest[q];
                dd[q] = scalar_t{-0.5} * by_a;
              }
            }
          });
    });
    return {by_logit, by_distance2, Tensor()};
  }
};

/// [queries, 3, 3] rotation matrices of unit quaternions.
Tensor rotation_matrices(const Tensor& rotation) {
  const Tensor unit = rotation / rotation.norm(2, 1, true).clamp_min(1e-12);
  const Tensor w = unit.select(1, 0), x = unit.select(1, 1), y = unit.select(1, 2),
               z = unit.select(1, 3);
  return torch::stack({1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                       2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                       2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)},
                      1)
      .view({-1, 3, 3});
}

/// [n, 10]: x^2 y^2 z^2 2xy 2xz 2yz -2x -2y -2z 1.
Tensor monomials(const Tensor& p) {
  const Tensor x = p.select(1, 0), y = p.select(1, 1), z = p.select(1, 2);
  return torch::stack({x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, -2 * x, -2 * y,
                       -2 * z, torch::ones_like(x)},
                      1);
}

}  // namespace

Tensor squared_distances(const Tensor& position_m, const Tensor& query_m,
                         const Tensor& log_sigma, const Tensor& rotation) {
  const Tensor origin = position_m.size(0) > 0 ? position_m.mean(0, true).detach()
                                               : torch::zeros({1, 3}, position_m.options());
  const Tensor mu = (query_m - origin).unsqueeze(2);
  const Tensor R = rotation_matrices(rotation);
  const Tensor information =
      R.matmul(torch::exp(-2 * log_sigma).unsqueeze(2) * R.transpose(1, 2));
  const Tensor pull = information.matmul(mu);
  const auto at = [&](int i, int j) { return information.select(1, i).select(1, j); };
  const Tensor form = torch::stack({at(0, 0), at(1, 1), at(2, 2), at(0, 1), at(0, 2), at(1, 2),
                                    pull.select(1, 0).squeeze(1), pull.select(1, 1).squeeze(1),
                                    pull.select(1, 2).squeeze(1), (mu * pull).sum({1, 2})},
                                   0);
  return monomials(position_m - origin).matmul(form).clamp_min(0);
}

Tensor query_labels(const Tensor& logit, const Tensor& distance2,
                    const LabelSettings& settings) {
  if (logit.is_cpu()) return QueryLabels::apply(logit, distance2, &settings);
  return query_labels_unfused(logit, distance2, settings);
}

Tensor query_labels_unfused(const Tensor& logit, const Tensor& distance2,
                            const LabelSettings& settings) {
  Tensor a = torch::sigmoid(logit) * torch::exp(-0.5 * distance2);
  if (has_reach(settings.variant)) {
    a = a * distance2.le(renderer::kAttentionReach2).to(a.scalar_type());
  }
  if (settings.variant == renderer::LabelVariant::kRaw) return a;
  if (is_softmax(settings.variant)) {
    return torch::softmax(a * inverse_temperature(settings), 1);
  }
  return a / (a.sum(1, true) + settings.none_score);
}

}  // namespace segsim::reconstruction::internal
