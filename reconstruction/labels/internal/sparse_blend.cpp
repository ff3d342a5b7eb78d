#include "reconstruction/labels/internal/sparse_blend.h"

#include <algorithm>
#include <string>

#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::Function;
using torch::autograd::variable_list;

constexpr std::int64_t kRowsPerTask = 512;

Tensor integers(std::int64_t size) {
  return torch::empty({size}, torch::TensorOptions().dtype(torch::kInt64));
}
Tensor floats(std::int64_t size) {
  return torch::empty({size}, torch::TensorOptions().dtype(torch::kFloat32));
}
std::int64_t* data(const Tensor& t) { return t.data_ptr<std::int64_t>(); }

/// Sparse rows times a dense matrix: out[r] = sum of weight * in[index].
template <class Real>
void multiply_rows(const Tensor& start, const Tensor& index, const Tensor& weight,
                   const Tensor& in, Tensor& out) {
  const std::int64_t channels = in.size(1);
  const auto *begin = data(start), *column = data(index);
  const auto* w = weight.data_ptr<float>();
  const Real* source = in.data_ptr<Real>();
  Real* target = out.data_ptr<Real>();
  at::parallel_for(0, out.size(0), kRowsPerTask, [&](std::int64_t first, std::int64_t last) {
    for (std::int64_t r = first; r < last; ++r) {
      Real* __restrict sum = target + r * channels;
      std::fill(sum, sum + channels, Real{0});
      for (std::int64_t e = begin[r]; e < begin[r + 1]; ++e) {
        const Real* __restrict row = source + column[e] * channels;
        const Real factor = w[e];
        for (std::int64_t c = 0; c < channels; ++c) sum[c] += factor * row[c];
      }
    }
  });
}

Tensor multiply(const Tensor& start, const Tensor& index, const Tensor& weight,
                const Tensor& in, std::int64_t rows) {
  Tensor out = torch::empty({rows, in.size(1)}, in.options());
  AT_DISPATCH_FLOATING_TYPES(in.scalar_type(), "blend",
                             [&] { multiply_rows<scalar_t>(start, index, weight, in, out); });
  return out;
}

/// The same for devices other than the CPU: gather, scale, scatter-add.
Tensor scatter(const Tensor& to, const Tensor& from, const Tensor& weight, const Tensor& in,
               std::int64_t rows) {
  const Tensor part = in.index_select(0, from) * weight.to(in.scalar_type()).unsqueeze(1);
  return torch::zeros({rows, in.size(1)}, in.options()).index_add(0, to, part);
}

/// Derivatives by the weights of rows: out[e] = gradient[row] . labels[index[e]].
Tensor by_weights(const Tensor& start, const Tensor& index, const Tensor& gradient,
                  const Tensor& labels) {
  Tensor out = floats(index.size(0));
  const std::int64_t channels = labels.size(1);
  AT_DISPATCH_FLOATING_TYPES(labels.scalar_type(), "blend_weights", [&] {
    const auto *begin = data(start), *column = data(index);
    const auto *g = gradient.data_ptr<scalar_t>(), *label = labels.data_ptr<scalar_t>();
    auto* target = out.data_ptr<float>();
    at::parallel_for(0, gradient.size(0), kRowsPerTask,
                     [&](std::int64_t first, std::int64_t last) {
                       for (std::int64_t r = first; r < last; ++r) {
                         const scalar_t* __restrict by = g + r * channels;
                         for (std::int64_t e = begin[r]; e < begin[r + 1]; ++e) {
                           const scalar_t* __restrict row = label + column[e] * channels;
                           scalar_t sum{0};
                           for (std::int64_t c = 0; c < channels; ++c) sum += by[c] * row[c];
                           target[e] = static_cast<float>(sum);
                         }
                       }
                     });
  });
  return out;
}

class Blend : public Function<Blend> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& labels_in,
                        const Tensor& row_weight, const BlendMatrix* matrix) {
    const BlendMatrix& m = *matrix;
    const Tensor labels = labels_in.is_cpu() ? labels_in.contiguous() : labels_in;
    if (labels.is_cpu()) {
      variable_list kept{m.column_start, m.column_pixel, m.column_weight};
      if (row_weight.requires_grad()) {
        kept.insert(kept.end(), {m.row_start, m.row_surfel, labels});
      }
      context->save_for_backward(kept);
      return multiply(m.row_start, m.row_surfel, row_weight, labels, m.pixels);
    }
    context->save_for_backward({m.row_surfel, m.row_pixel, row_weight});
    context->saved_data["surfels"] = m.surfels();
    return scatter(m.row_pixel, m.row_surfel, row_weight, labels, m.pixels);
  }

  static variable_list backward(AutogradContext* context, const variable_list& gradients) {
    const variable_list saved = context->get_saved_variables();
    const Tensor gradient = gradients[0].contiguous();
    if (gradient.is_cpu()) {
      const Tensor by_weight =
          saved.size() > 3 ? by_weights(saved[3], saved[4], gradient, saved[5]) : Tensor();
      return {multiply(saved[0], saved[1], saved[2], gradient, saved[0].size(0) - 1),
              by_weight, Tensor()};
    }
    return {scatter(saved[0], saved[1], saved[2], gradient,
                    context->saved_data["surfels"].toInt()),
            Tensor(), Tensor()};
  }
};

class BlendChannel : public Function<BlendChannel> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& labels, const Tensor& scale,
                        const Tensor& channel, const Tensor& row_weight,
                        const BlendMatrix* matrix) {
    const BlendMatrix& m = *matrix;
    const Tensor in = labels.contiguous(), factor = scale.contiguous();
    variable_list kept{m.column_start, m.column_pixel, m.column_weight, channel, in, factor};
    if (row_weight.requires_grad()) kept.insert(kept.end(), {m.row_start, m.row_surfel});
    context->save_for_backward(kept);
    Tensor out = torch::zeros({m.pixels}, in.options());
    AT_DISPATCH_FLOATING_TYPES(in.scalar_type(), "blend_channel", [&] {
      const auto *begin = data(m.row_start), *row = data(m.row_surfel), *of = data(channel);
      const auto* w = row_weight.data_ptr<float>();
      const scalar_t *label = in.data_ptr<scalar_t>(), *f = factor.data_ptr<scalar_t>();
      scalar_t* sum = out.data_ptr<scalar_t>();
      const std::int64_t channels = in.size(1);
      for (std::int64_t p = 0; p < m.pixels; ++p) {
        if (of[p] < 0) continue;
        for (std::int64_t e = begin[p]; e < begin[p + 1]; ++e) {
          sum[p] += w[e] * f[row[e]] * label[row[e] * channels + of[p]];
        }
      }
    });
    return out;
  }

  static variable_list backward(AutogradContext* context, const variable_list& gradients) {
    const variable_list saved = context->get_saved_variables();
    const Tensor gradient = gradients[0].contiguous(), &labels = saved[4], &factor = saved[5];
    Tensor by_labels = torch::zeros_like(labels), by_scale = torch::zeros_like(factor);
    AT_DISPATCH_FLOATING_TYPES(gradient.scalar_type(), "blend_channel", [&] {
      const auto *begin = data(saved[0]), *pixel = data(saved[1]), *of = data(saved[3]);
      const auto* w = saved[2].data_ptr<float>();
      const scalar_t *g = gradient.data_ptr<scalar_t>(), *label = labels.data_ptr<scalar_t>(),
                     *f = factor.data_ptr<scalar_t>();
      scalar_t *to_label = by_labels.data_ptr<scalar_t>(),
               *to_scale = by_scale.data_ptr<scalar_t>();
      const std::int64_t channels = labels.size(1);
      for (std::int64_t s = 0; s < labels.size(0); ++s) {
        for (std::int64_t e = begin[s]; e < begin[s + 1]; ++e) {
          const std::int64_t c = of[pixel[e]];
          if (c < 0) continue;
          const scalar_t part = w[e] * g[pixel[e]];
          to_label[s * channels + c] += part * f[s];
          to_scale[s] += part * label[s * channels + c];
        }
      }
    });
    const Tensor by_weight = saved.size() > 6 ? by_channel_weights(saved, gradient) : Tensor();
    return {by_labels, by_scale, Tensor(), by_weight, Tensor()};
  }

 private:
  static Tensor by_channel_weights(const variable_list& saved, const Tensor& gradient) {
    const Tensor &of_pixel = saved[3], &labels = saved[4], &factor = saved[5];
    Tensor out = torch::zeros({saved[7].size(0)}, torch::kFloat32);
    AT_DISPATCH_FLOATING_TYPES(gradient.scalar_type(), "blend_channel", [&] {
      const auto *begin = data(saved[6]), *row = data(saved[7]), *of = data(of_pixel);
      const scalar_t *g = gradient.data_ptr<scalar_t>(), *label = labels.data_ptr<scalar_t>(),
                     *f = factor.data_ptr<scalar_t>();
      const std::int64_t channels = labels.size(1);
      for (std::int64_t p = 0; p < gradient.size(0); ++p) {
        if (of[p] < 0) continue;
        for (std::int64_t e = begin[p]; e < begin[p + 1]; ++e) {
          out.data_ptr<float>()[e] =
              static_cast<float>(g[p] * f[row[e]] * label[row[e] * channels + of[p]]);
        }
      }
    });
    return out;
  }
};

/// Compressed columns from compressed rows.
void transpose(BlendMatrix& m) {
  const std::int64_t entries = m.row_surfel.size(0), surfels = m.surfels();
  m.column_start = torch::zeros({surfels + 1}, m.row_start.options());
  m.column_pixel = integers(entries);
  m.column_weight = floats(entries);
  auto* start = data(m.column_start);
  const auto *begin = data(m.row_start), *surfel = data(m.row_surfel);
  for (std::int64_t e = 0; e < entries; ++e) ++start[surfel[e] + 1];
  for (std::int64_t s = 0; s < surfels; ++s) start[s + 1] += start[s];
  std::vector<std::int64_t> next(start, start + surfels);
  for (std::int64_t p = 0; p < m.pixels; ++p) {
    for (std::int64_t e = begin[p]; e < begin[p + 1]; ++e) {
      const std::int64_t at = next[static_cast<std::size_t>(surfel[e])]++;
      data(m.column_pixel)[at] = p;
      m.column_weight.data_ptr<float>()[at] = m.row_weight.data_ptr<float>()[e];
    }
  }
}

}  // namespace

BlendMatrix BlendMatrixMaker::make(const PixelWeights& weights, const PixelWeights* more,
                                   bool differentiable) {
  std::vector<const PixelWeights*> parts{&weights};
  if (more != nullptr) parts.push_back(more);
  SEGSIM_CHECK(device_.is_cpu() || !differentiable, "weights on a GPU");
  BlendMatrix matrix = device_.is_cpu() ? make_on_cpu(parts) : make_on_device(parts);
  if (differentiable) matrix.row_weight.requires_grad_(true);
  return matrix;
}

GeometryGradient geometry_gradient(const BlendMatrix& matrix, const PanopticBatch& batch,
                                   const Tensor& position_rows) {
  const at::NoGradGuard no_grad;
  GeometryGradient gradient;
  gradient.by_weight.assign(static_cast<std::size_t>(batch.weights.entries), 0.0F);
  if (matrix.row_weight.grad().defined()) {
    const auto* begin = data(matrix.row_start);
    const auto *by = matrix.row_weight.grad().data_ptr<float>(),
               *w = matrix.row_weight.data_ptr<float>(),
               *alpha = matrix.alpha.data_ptr<float>();
    // w_e / sum w: each weight also makes all others of its pixel smaller.
    for (std::int64_t p = 0; p < batch.weights.pixels; ++p) {
      double mean = 0.0;
      for (std::int64_t e = begin[p]; e < begin[p + 1]; ++e) {
        mean += static_cast<double>(w[e]) * static_cast<double>(by[e]);
      }
      for (std::int64_t e = begin[p]; e < begin[p + 1]; ++e) {
        gradient.by_weight[static_cast<std::size_t>(e)] = static_cast<float>(
            (static_cast<double>(by[e]) - mean) / static_cast<double>(alpha[p]));
      }
    }
  }
  if (position_rows.grad().defined()) {
    const auto* surfel = data(matrix.surfel);
    gradient.surfel.assign(surfel, surfel + matrix.surfels());
    const Tensor by = position_rows.grad().contiguous();
    const auto* first = by.data_ptr<float>();
    gradient.by_position.assign(first, first + by.numel());
  }
  return gradient;
}

/// Ids of the batch, ascending; local_ then holds their places in that list.
Tensor BlendMatrixMaker::number_surfels(const std::vector<const PixelWeights*>& parts) {
  local_.resize(static_cast<std::size_t>(cloud_size_), -1);
  std::vector<std::int64_t> ids;
  for (const PixelWeights* part : parts) {
    for (std::int64_t e = 0; e < part->entries; ++e) {
      const std::int32_t id = part->surfel[e];
      SEGSIM_CHECK(id >= 0 && id < cloud_size_, std::to_string(id));
      std::int32_t& local = local_[static_cast<std::size_t>(id)];
      if (local == 0) continue;
      local = 0;
      ids.push_back(id);
    }
  }
  std::sort(ids.begin(), ids.end());
  for (std::size_t s = 0; s < ids.size(); ++s) {
    local_[static_cast<std::size_t>(ids[s])] = static_cast<std::int32_t>(s);
  }
  return device_tensor(ids, torch::kInt64, torch::kCPU);
}

BlendMatrix BlendMatrixMaker::make_on_cpu(const std::vector<const PixelWeights*>& parts) {
  BlendMatrix m;
  std::int64_t entries = 0;
  for (const PixelWeights* part : parts) {
    m.pixels += part->pixels;
    entries += part->entries;
  }
  m.surfel = number_surfels(parts);
  m.row_start = integers(m.pixels + 1);
  m.row_surfel = integers(entries);
  m.row_weight = floats(entries);
  m.alpha = floats(m.pixels);
  std::int64_t row = 0, at = 0;
  for (const PixelWeights* part : parts) {
    for (std::int64_t p = 0; p < part->pixels; ++p, ++row) {
      data(m.row_start)[row] = at;
      const std::int32_t begin = part->row_start[p], end = part->row_start[p + 1];
      float alpha = 0.0F;
      for (std::int32_t e = begin; e < end; ++e) alpha += part->weight[e];
      m.alpha.data_ptr<float>()[row] = alpha;
      const float scale = alpha > 0.0F ? 1.0F / alpha : 0.0F;
      for (std::int32_t e = begin; e < end; ++e, ++at) {
        data(m.row_surfel)[at] = local_[static_cast<std::size_t>(part->surfel[e])];
        m.row_weight.data_ptr<float>()[at] = scale * part->weight[e];
      }
    }
  }
  data(m.row_start)[m.pixels] = at;
  for (std::int64_t s = 0; s < m.surfels(); ++s) {
    local_[static_cast<std::size_t>(data(m.surfel)[s])] = -1;
  }
  transpose(m);
  return m;
}

BlendMatrix BlendMatrixMaker::make_on_device(
    const std::vector<const PixelWeights*>& parts) const {
  const auto options = torch::TensorOptions().device(device_);
  // from_blob does not write to its data.
  const auto view = [&](const auto* values, std::int64_t size, at::ScalarType type) {
    return torch::from_blob(const_cast<void*>(static_cast<const void*>(values)), {size},
                            options.dtype(type));
  };
  std::vector<Tensor> counts, ids, weights;
  BlendMatrix m;
  for (const PixelWeights* part : parts) {
    const Tensor start = view(part->row_start, part->pixels + 1, torch::kInt32);
    counts.push_back((start.slice(0, 1) - start.slice(0, 0, part->pixels)).to(torch::kInt64));
    ids.push_back(view(part->surfel, part->entries, torch::kInt32).to(torch::kInt64));
    weights.push_back(view(part->weight, part->entries, torch::kFloat32));
    m.pixels += part->pixels;
  }
  m.row_pixel = torch::repeat_interleave(torch::cat(counts));
  std::tie(m.surfel, m.row_surfel, std::ignore) = at::_unique2(torch::cat(ids), true, true);
  const Tensor weight = torch::cat(weights);
  m.alpha = torch::zeros({m.pixels}, weight.options()).index_add(0, m.row_pixel, weight);
  m.row_weight = weight / m.alpha.index_select(0, m.row_pixel);
  return m;
}

Tensor blend(const BlendMatrix& matrix, const Tensor& labels) {
  SEGSIM_CHECK(labels.dim() == 2 && labels.size(0) == matrix.surfels(), "rows of labels");
  return Blend::apply(labels, matrix.row_weight, &matrix);
}

Tensor blend_channel(const BlendMatrix& matrix, const Tensor& labels, const Tensor& channel,
                     const Tensor& scale) {
  SEGSIM_CHECK(labels.dim() == 2 && labels.size(0) == matrix.surfels(), "rows of labels");
  SEGSIM_CHECK(channel.size(0) == matrix.pixels, "channels");
  SEGSIM_CHECK(scale.size(0) == matrix.surfels(), "scales");
  if (labels.is_cpu())
    return BlendChannel::apply(labels, scale, channel, matrix.row_weight, &matrix);
  const Tensor known = channel.ge(0);
  const Tensor flat = matrix.row_surfel * labels.size(1) +
                      channel.clamp_min(0).index_select(0, matrix.row_pixel);
  const Tensor part = labels.reshape(-1).index_select(0, flat) *
                      scale.index_select(0, matrix.row_surfel) *
                      matrix.row_weight.to(labels.scalar_type());
  return torch::zeros({matrix.pixels}, labels.options()).index_add(0, matrix.row_pixel, part) *
         known.to(labels.scalar_type());
}

Tensor blend_channel(const BlendMatrix& matrix, const Tensor& labels, const Tensor& channel) {
  return blend_channel(matrix, labels, channel,
                       torch::ones({matrix.surfels()}, labels.options()));
}

}  // namespace segsim::reconstruction::internal
