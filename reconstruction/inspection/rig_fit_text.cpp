// What a fit amounts to.
#include <cmath>

#include <glm/geometric.hpp>

#include "core/formatted.h"
#include "reconstruction/inspection/internal/pose_steps.h"
#include "reconstruction/inspection/rig_fit.h"

namespace segsim::reconstruction {
namespace {

constexpr double kSmallestGain = 0.25;  ///< Of the contrast at the start, of a real offset.
constexpr double kSmallestOffset_px = 0.5, kSmallestOffset_errors = 3.0;

std::string direction_text(double value_m, const char* positive, const char* negative) {
  return core::print("%.1f cm ", 100.0 * std::abs(value_m)) +
         (value_m < 0.0 ? negative : positive);
}

}  // namespace

bool RigFit::is_off() const {
  return doubt.empty() && displacement_px > kSmallestOffset_px &&
         displacement_px > kSmallestOffset_errors * error_px &&
         best - given > kSmallestGain * (given - chance);
}

std::string RigFit::text(const RigFitOptions& options) const {
  using core::print;
  std::string text;
  if (options.fit_place) {
    const glm::dvec3 t_m = offset.T_color_depth.translation_m();
    const glm::dquat& q = offset.T_color_depth.rotation();
    const double turn_deg = internal::degrees(
        2.0 * std::atan2(glm::length(glm::dvec3(q.x, q.y, q.z)), std::abs(q.w)));
    text = "depth camera " + direction_text(t_m.x, "right", "left") + ", " +
           direction_text(t_m.y, "below", "above") + " and " +
           direction_text(t_m.z, "before", "behind") +
           print(" the colour camera (+- %.1f cm), ", 100.0 * translation_error_m) +
           print("turned by %.2f deg ", turn_deg) + print("(+- %.2f deg)", rotation_error_deg);
  }
  if (options.fit_time) {
    text += (text.empty() ? "" : "; ") +
            print("depth images measured %.1f ms ", 1e3 * offset.depth_time_s) +
            print("after their stamps (+- %.1f ms)", 1e3 * time_error_s);
  }
  return text + print("; that moves depth by %.1f ", displacement_px) +
         print("+- %.1f px, ", error_px) + print("agreement of edges %.2f ", best) +
         print("instead of %.2f ", given) + print("(by chance %.2f)", chance);
}

}  // namespace segsim::reconstruction
