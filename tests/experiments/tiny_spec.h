#pragma once

#include <sstream>
#include <string>

namespace segsim::experiments {

/// A spec over the two rooms of tiny_scene.h, whose bundle is expected in ${data}/tiny. Its
/// arms see with the oracle detector, so no weights are needed.
struct TinySpec {
  std::string name = "tiny";
  std::string goals = "couch";  ///< With commas in between.
  int episodes = 1;             ///< In all.
  std::string arms =
      "  - {name: before, detector: oracle}\n"
      "  - {name: after, detector: oracle}\n";
  int seed = 3;
  double control_period_s = 0.25;
  double time_limit_s = 30.0;
  int image_width_px = 96;  ///< The height is three quarters of it.
  std::string more;         ///< Further lines of the top level.

  /// As YAML.
  [[nodiscard]] std::string text() const {
    std::ostringstream out;
    out << "schema: segsim.experiment/1\n"
        << "name: " << name << "\n"
        << "seed: " << seed << "\n"
        << "scenes:\n"
        << "  - name: tiny\n"
        << "    title: Two rooms\n"
        << "    bundle: ${data}/tiny\n"
        << "    goals: [" << goals << "]\n"
        << "    episodes: " << episodes << "\n"
        << "    camera_height_m: 1.0\n"
        << "arms:\n"
        << arms << "robot: jackal-gentle\n"
        << "control_period_s: " << control_period_s << "\n"
        << "time_limit_s: " << time_limit_s << "\n"
        << "camera: {width: " << image_width_px << ", height: " << image_width_px * 3 / 4
        << ", hfov_deg: 70, pitch_down_deg: 10, depth_range_m: 6}\n"
        << more;
    return out.str();
  }
};

}  // namespace segsim::experiments
