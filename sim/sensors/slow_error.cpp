#include "sim/sensors/slow_error.h"

#include <cmath>
#include <utility>

#include "core/check.h"

namespace segsim::sim {

SlowError::SlowError(const ErrorModel& model, std::uint64_t seed, std::string name)
    : model_(model), seed_(seed), name_(std::move(name)) {
  SEGSIM_CHECK(model.sigma >= 0.0 && model.drift >= 0.0 && model.drift_time_s > 0.0, name_);
}

double SlowError::next(core::TimeNs time_ns) {
  const std::uint64_t reading = readings_++;
  if (model_.none()) return 0.0;
  core::RandomStream random(seed_, name_, reading);
  const double white = model_.sigma * random.normal();
  const double step = model_.drift * random.normal();
  if (reading == 0) {
    bias_ = step;
  } else {
    SEGSIM_CHECK(time_ns >= last_ns_, "times ascend");
    const double kept = std::exp(-core::seconds(time_ns - last_ns_) / model_.drift_time_s);
    bias_ = kept * bias_ + std::sqrt(1.0 - kept * kept) * step;
  }
  last_ns_ = time_ns;
  return white + bias_;
}

}  // namespace segsim::sim
