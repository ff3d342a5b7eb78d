#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>

namespace segsim::perception {

/// Attention of heads inside bands of tokens, softmax(Q^T K / sqrt(channels of a head)) V, by
/// oneDNN on maps with their channels innermost.
///
/// Bands and heads are taken one after the other: the matrix of their tokens' similarities
/// (640 KB for 400 tokens) stays in the cache between the two products. Queries, keys, values
/// and the result are read and written where they lie in their maps, by strides.
class BandAttention {
 public:
  BandAttention(int heads, int head_channels, int bands);
  ~BandAttention();
  BandAttention(const BandAttention&) = delete;
  BandAttention& operator=(const BandAttention&) = delete;

  /// Whether run() may be called: oneDNN was there when this was built, and runs_on_onednn().
  [[nodiscard]] static bool available(const torch::Tensor& x);

  /// One thread at a time.
  /// @param qk  [batch, 2 * heads * channels of a head, h, w], queries first, head after head.
  /// @param v  [batch, heads * channels of a head, h, w]; h * w is a multiple of the bands.
  /// @returns a map like `v`, channels innermost.
  [[nodiscard]] torch::Tensor run(const torch::Tensor& qk, const torch::Tensor& v);

 private:
  struct Prepared;
  std::int64_t heads_, head_channels_, bands_;
  std::unique_ptr<Prepared> prepared_;
};

}  // namespace segsim::perception
