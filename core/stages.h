#pragma once

/// @file
/// The seams of one control tick. Each stage implements one interface, includes nothing of the
/// other stages, and is chosen by name in experiments/. None of these types carries ground
/// truth.

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "core/camera.h"
#include "core/frames.h"
#include "core/image.h"
#include "core/stop_reason.h"

namespace segsim::core {

/// Simulated time since the episode began [ns].
using TimeNs = std::int64_t;
inline constexpr TimeNs kNsPerSecond = 1'000'000'000;
[[nodiscard]] constexpr double seconds(TimeNs time_ns) {
  return static_cast<double>(time_ns) * 1e-9;
}

/// What the robot's camera delivers. Images are borrowed for the tick.
struct Observation {
  TimeNs capture_time_ns = 0;
  std::uint64_t capture_index = 0;  ///< Counts the captures of the episode.
  CameraIntrinsics intrinsics;
  Transform<frame::Odom, frame::Robot> T_odom_robot;  ///< Estimate at capture time.
  Transform<frame::Robot, frame::Camera> T_robot_camera;
  const Image<Rgb8>* rgb = nullptr;
  const Image<float>* depth_m = nullptr;  ///< Along +z; NaN where there is no measurement.

  [[nodiscard]] Transform<frame::Odom, frame::Camera> T_odom_camera() const {
    return T_odom_robot * T_robot_camera;
  }
};

/// Axis-aligned image box, half-open: a pixel (i, j) lies in it if x0 <= i < x1 and y0 <= j <
/// y1 for integer corners.
struct BoxPx {
  float x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  [[nodiscard]] float width_px() const { return x1 - x0; }
  [[nodiscard]] float height_px() const { return y1 - y0; }
  [[nodiscard]] float area_px2() const {
    return x1 > x0 && y1 > y0 ? (x1 - x0) * (y1 - y0) : 0.0F;
  }
};

/// Intersection over union; 0 for empty boxes.
[[nodiscard]] inline float iou(const BoxPx& a, const BoxPx& b) {
  const BoxPx both{std::max(a.x0, b.x0), std::max(a.y0, b.y0), std::min(a.x1, b.x1),
                   std::min(a.y1, b.y1)};
  const float shared = both.area_px2();
  const float total = a.area_px2() + b.area_px2() - shared;
  return total > 0.0F ? shared / total : 0.0F;
}

struct Detection {
  int class_index = 0;  ///< Into Detector::class_names().
  float score = 0.0F;   ///< [0, 1].
  BoxPx box;            ///< In pixels of the observation's image.
};

/// Which detection it was: the image's Observation::capture_index and the box in it.
struct DetectionRef {
  std::uint64_t capture_index = 0;
  BoxPx box;
};

/// Image -> boxes. Implemented in perception/ (learned) and sim/ (oracle arms).
class Detector {
 public:
  virtual ~Detector() = default;
  [[nodiscard]] virtual const std::vector<std::string>& class_names() const = 0;
  /// Detections in descending order of score.
  [[nodiscard]] virtual std::vector<Detection> detect(const Observation& observation) = 0;
};

/// Command to the base, in the robot frame.
struct VelocityCommand {
  double forward_mps = 0.0;
  double turn_radps = 0.0;  ///< Positive turns left.
};

/// Why the policy does what it does; one word per state for logs and pictures.
enum class PolicyMode : std::uint8_t { kInitialize, kExplore, kNavigate, kRecover, kStop };
[[nodiscard]] const char* to_string(PolicyMode mode);

/// The answer of one decision.
struct Decision {
  VelocityCommand command;
  PolicyMode mode = PolicyMode::kExplore;
  std::optional<StopReason> stop{};  ///< Set: the policy declares the episode finished.
};

/// What a policy is asked to find.
struct ObjectGoal {
  std::string class_name;
  int class_index = -1;  ///< Into Detector::class_names(); -1 if the detector cannot name it.
  /// "a red chair": which objects of the class are meant; empty: any.
  std::string phrase{};
  /// What a model of images and texts is asked for.
  [[nodiscard]] const std::string& text() const {
    return phrase.empty() ? class_name : phrase;
  }
};

/// A policy's own picture of the world, for debugging views and trial pictures (frame Odom).
struct PolicyView {
  double resolution_m = 0.0;
  glm::dvec2 origin_m{
      0.0};  ///< Corner (min x, min y) of cell (0, 0); cell (i, j): i along x, j along y.
  Image<std::uint8_t>
      cells;  ///< 0 unknown, 1 free, 2 occupied, 3 inflated (free but too close).
  std::vector<glm::dvec2> frontiers_m;
  std::vector<glm::dvec2> path_m;
  std::optional<glm::dvec2> target_m;  ///< Where it drives to.
  struct Object {
    glm::dvec2 position_m;
    int class_index;
    float score;
    /// The detections whose points it is made of; empty: the policy does not say.
    std::vector<DetectionRef> made_of{};
  };
  std::vector<Object> objects;
};

/// Observations + detections -> commands. Implemented in nav/.
class Policy {
 public:
  virtual ~Policy() = default;
  /// Starts an episode. @param seed  All randomness of the policy derives from it.
  virtual void reset(const ObjectGoal& goal, std::uint64_t seed) = 0;
  /// One decision. `detections` belong to `observation`.
  [[nodiscard]] virtual Decision decide(const Observation& observation,
                                        std::span<const Detection> detections) = 0;
  [[nodiscard]] virtual PolicyView view() const = 0;
};

}  // namespace segsim::core
