#pragma once

/// @file
/// What was decided about up and floor of a recording, and why: for the log and for a picture.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <glm/vec3.hpp>

#include "reconstruction/upright/floor_evidence.h"
#include "reconstruction/upright/gravity_evidence.h"
#include "reconstruction/upright/surface_elements.h"

namespace segsim::reconstruction {

enum class UpSource : std::uint8_t {
  kGiven,     ///< By hand, or by the labels of a capture.
  kLayout,    ///< An axis of the recording; no evidence against it.
  kEvidence,  ///< Fitted to surfaces and cameras.
};

enum class FloorSource : std::uint8_t {
  kGiven,    ///< By hand, or by the labels of a capture.
  kFitted,   ///< A level surface that was seen.
  kGuessed,  ///< The height at which walls end.
  kUnknown,  ///< The recording's heights are kept.
};

struct WorldPlacement {
  glm::dvec3 up{0.0, 0.0, 1.0};  ///< Unit, in the recording's frame.
  UpSource up_source = UpSource::kLayout;
  std::optional<GravityEvidence> gravity;  ///< In the recording's frame.
  double floor_height_m = 0.0;             ///< Along up, in the recording's frame.
  FloorSource floor_source = FloorSource::kUnknown;
  std::optional<FloorEvidence> floor;
  /// In the world frame, floor at z = 0. Empty where nothing had to be found out.
  std::vector<SurfaceElement> elements;
};

/// One line: both decisions, with the evidence behind them.
[[nodiscard]] std::string describe(const WorldPlacement& placement);

}  // namespace segsim::reconstruction
