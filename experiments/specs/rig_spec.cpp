#include "experiments/specs/rig_spec.h"

#include <cmath>
#include <cstdlib>
#include <sstream>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/specs/internal/spec_readers.h"
#include "experiments/support/numbers_in_range.h"

namespace segsim::experiments::specs {
namespace {

constexpr const char* kEstimate = "estimate";

}  // namespace

std::optional<double> OffsetSpec::seconds() const {
  if (!milliseconds) return std::nullopt;
  return 1e-3 * *milliseconds;
}

OffsetSpec parse_offset(const std::string& word, const std::string& place) {
  if (word == kEstimate) return {true, {}};
  constexpr double kMost_ms = 1e4;
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  if (word.empty() || *end != '\0' || !(std::abs(value) <= kMost_ms)) {
    throw core::InputError::expected(place, "a number of milliseconds, or estimate",
                                     "\"" + word + "\"");
  }
  return {false, value};
}

std::string RigSpec::text() const {
  std::ostringstream text;
  const auto add = [&](const char* name, const OffsetSpec& offset) {
    if (offset.estimate) text << ", " << name << " estimated";
    if (offset.milliseconds) text << ", " << name << ' ' << *offset.milliseconds << " ms";
  };
  if (estimate_color_depth) text << ", place of the depth camera estimated";
  if (!color_depth.empty()) {
    text << ", place of the depth camera " << core::sha256_of_file(color_depth).substr(0, 16);
  }
  add("depth offset", depth_time);
  add("pose offset", pose_time);
  if (read_out_ms) text << ", rolling shutter of " << *read_out_ms << " ms";
  if (frame_rate_hz) text << ", " << *frame_rate_hz << " frames a second";
  if (sensor != reconstruction::DepthSensor::kUnstated) {
    text << ", sensor " << reconstruction::words_of(sensor);
  }
  return text.str();
}

void RigSpec::apply_to(reconstruction::SequenceOptions& options) const {
  if (!color_depth.empty())
    options.color_depth = reconstruction::read_color_depth(color_depth);
  options.times = {frame_rate_hz, depth_time.seconds(), pose_time.seconds(), {}};
  if (read_out_ms) options.times.read_out_s = 1e-3 * *read_out_ms;
  options.sensor = sensor;
}

namespace internal {

RigSpec read_rig(const core::ConfigNode& source, const Variables& variables) {
  RigSpec rig;
  if (source.has("color_depth")) {
    rig.estimate_color_depth = source.text("color_depth") == kEstimate;
    if (!rig.estimate_color_depth) {
      rig.color_depth = variables.expand(source.child("color_depth"));
    }
  }
  const auto offset = [&](const char* key) {
    if (!source.has(key)) return OffsetSpec{};
    return parse_offset(source.text(key), source.child(key).where());
  };
  rig.depth_time = offset("depth_time_offset_ms");
  rig.pose_time = offset("pose_time_offset_ms");
  if (source.has("frame_rate_hz")) {
    rig.frame_rate_hz = support::number_within(source, "frame_rate_hz", 30.0, 0.01, 1000.0);
  }
  if (source.has("rolling_shutter_ms")) {
    rig.read_out_ms = support::number_within(source, "rolling_shutter_ms", 0.0,
                                             -kLongestReadOut_ms, kLongestReadOut_ms);
  }
  if (source.has("sensor")) {
    rig.sensor = reconstruction::parse_depth_sensor(source.text("sensor"),
                                                    source.child("sensor").where());
  }
  return rig;
}

}  // namespace internal

}  // namespace segsim::experiments::specs
