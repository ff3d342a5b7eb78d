#include "renderer/scene/parallel_limit.h"

#include <oneapi/tbb/global_control.h>

#include <string>

#include "core/check.h"

namespace segsim::renderer {

struct ParallelLimit::Impl {
  explicit Impl(int threads)
      : control(tbb::global_control::max_allowed_parallelism,
                static_cast<std::size_t>(threads)) {}
  tbb::global_control control;
};

ParallelLimit::ParallelLimit(int threads) {
  SEGSIM_CHECK(threads >= 1, std::to_string(threads) + " threads");
  impl_ = std::make_unique<Impl>(threads);
}

ParallelLimit::~ParallelLimit() = default;

}  // namespace segsim::renderer
