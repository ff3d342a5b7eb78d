#include "perception/internal/network/onednn_attention.h"

#include "perception/internal/network/onednn.h"

#include <torch/torch.h>

#ifdef SEGSIM_ONEDNN
#include <oneapi/dnnl/dnnl.hpp>
#endif

#include <cmath>
#include <map>

#include "core/check.h"

namespace segsim::perception {

#ifdef SEGSIM_ONEDNN

namespace {

using dnnl::memory;

/// Rows of numbers side by side, `stride` apart; transposed: columns.
memory::desc rows(std::int64_t count, std::int64_t length, std::int64_t stride) {
  return {{count, length}, memory::data_type::f32, {stride, 1}};
}
memory::desc columns(std::int64_t length, std::int64_t count, std::int64_t stride) {
  return {{length, count}, memory::data_type::f32, {1, stride}};
}

}  // namespace

struct BandAttention::Prepared {
  /// For one number of tokens of a band.
  struct Steps {
    memory::desc query, key, value, similarity, result;
    dnnl::matmul compare, mix;
    dnnl::softmax_forward softmax;
  };

  const Steps& for_tokens(std::int64_t tokens, std::int64_t head_channels,
                          std::int64_t channels) {
    const auto found = steps.find(tokens);
    if (found != steps.end()) return found->second;
    Steps s;
    s.query = rows(tokens, head_channels, channels);
    s.key = columns(head_channels, tokens, 2 * channels);
    s.value = s.result = rows(tokens, head_channels, channels);
    s.similarity = rows(tokens, tokens, tokens);
    s.compare =
        dnnl::matmul(dnnl::matmul::primitive_desc({s.query, s.key, s.similarity}, engine));
    s.mix =
        dnnl::matmul(dnnl::matmul::primitive_desc({s.similarity, s.value, s.result}, engine));
    s.softmax = dnnl::softmax_forward(dnnl::softmax_forward::primitive_desc(
        {dnnl::prop_kind::forward_inference, s.similarity, /*axis=*/1}, engine));
    return steps.emplace(tokens, std::move(s)).first->second;
  }

  /// One band and head.
  void run(const Steps& s, float* query, float* key, float* value, float* similarity,
           float* result) {
    const memory q(s.query, engine, query), k(s.key, engine, key), v(s.value, engine, value);
    const memory table(s.similarity, engine, similarity), out(s.result, engine, result);
    s.compare.execute(stream,
                      {{DNNL_ARG_SRC, q}, {DNNL_ARG_WEIGHTS, k}, {DNNL_ARG_DST, table}});
    s.softmax.execute(stream, {{DNNL_ARG_SRC, table}, {DNNL_ARG_DST, table}});
    s.mix.execute(stream, {{DNNL_ARG_SRC, table}, {DNNL_ARG_WEIGHTS, v}, {DNNL_ARG_DST, out}});
    stream.wait();
  }

  dnnl::engine engine{dnnl::engine::kind::cpu, 0};
  dnnl::stream stream{engine};
  std::map<std::int64_t, Steps> steps;
};

bool BandAttention::available(const torch::Tensor& x) { return runs_on_onednn(x); }

torch::Tensor BandAttention::run(const torch::Tensor& qk, const torch::Tensor& v) {
  constexpr auto kChannelsLast = torch::MemoryFormat::ChannelsLast;
  const std::int64_t channels = heads_ * head_channels_;
  const std::int64_t all_tokens = v.size(2) * v.size(3), tokens = all_tokens / bands_;
  SEGSIM_CHECK(
      v.size(1) == channels && qk.size(1) == 2 * channels && tokens * bands_ == all_tokens,
      "maps of other heads or bands");
  if (prepared_ == nullptr) prepared_ = std::make_unique<Prepared>();
  const Prepared::Steps& steps = prepared_->for_tokens(tokens, head_channels_, channels);
  // The factor goes to the queries: there are few of them.
  const auto queries = qk.narrow(1, 0, channels)
                           .mul(1.0 / std::sqrt(static_cast<double>(head_channels_)))
                           .contiguous(kChannelsLast);
  const auto both = qk.contiguous(kChannelsLast), values = v.contiguous(kChannelsLast);
  auto result = torch::empty_like(values);
  auto table = torch::empty({tokens, tokens}, torch::kFloat32);
  for (std::int64_t b = 0; b < v.size(0) * bands_;
       ++b) {  // Bands follow each other in memory.
    const std::int64_t first = b * tokens * channels;
    for (std::int64_t h = 0; h < heads_; ++h) {
      const std::int64_t at = first + h * head_channels_;
      prepared_->run(steps, queries.data_ptr<float>() + at,
                     both.data_ptr<float>() + 2 * first + channels + h * head_channels_,
                     values.data_ptr<float>() + at, table.data_ptr<float>(),
                     result.data_ptr<float>() + at);
    }
  }
  return result;
}

#else

struct BandAttention::Prepared {};

bool BandAttention::available(const torch::Tensor&) { return false; }

torch::Tensor BandAttention::run(const torch::Tensor&, const torch::Tensor&) {
  SEGSIM_CHECK(false, "built without oneDNN");
}

#endif

BandAttention::BandAttention(int heads, int head_channels, int bands)
    : heads_(heads), head_channels_(head_channels), bands_(bands) {}
BandAttention::~BandAttention() = default;

}  // namespace segsim::perception
