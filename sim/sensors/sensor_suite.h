#pragma once

/// @file
/// The sensors of a robot, each with its own rate, phase and latency, and what they recorded.
///
/// Reading i of a sensor is taken at phase + i * period, at the true pose of that moment (on
/// the arc between two steps of the simulation: sensors never change the steps), and is there
/// `latency` later. The camera has its times elsewhere: `TrialClock::camera` and the stage
/// "capture" of a budget (sim/time/clock.h). Random numbers are keyed by the episode's seed,
/// the sensor's name and the number of the reading, never by the arm.
///
/// No policy of this program reads anything but the camera: the other sensors are recorded,
/// and stacks of others hear them (TrialParts::readings).

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/stages.h"
#include "sim/sensors/depth_sensor.h"
#include "sim/sensors/gps_compass.h"
#include "sim/sensors/imu.h"
#include "sim/sensors/lidar.h"
#include "sim/sensors/odometer.h"
#include "sim/sensors/pose_history.h"
#include "sim/sensors/render_validity.h"
#include "sim/sensors/rgb_sensor.h"
#include "sim/time/clock.h"

namespace segsim::sim {

/// A sensor with its times.
template <class Model>
struct Timed {
  Model model;
  core::TimeNs period_ns = 0;  ///< > 0
  core::TimeNs phase_ns = 0, latency_ns = 0;
};

struct CameraModel {
  RgbModel rgb;
  DepthModel depth;         ///< `max_range_m` is the trial's (TrialOptions::depth_range_m).
  double hole_limit = 0.2;  ///< See RenderValidity::render_invalid.
};

struct SensorSettings {
  CameraModel camera;
  std::optional<Timed<LidarModel>> lidar;
  std::optional<Timed<ImuModel>> imu;
  std::optional<Timed<OdometryNoise>> odometry;
  std::optional<Timed<GpsModel>> gps;
  std::optional<Timed<CompassModel>> compass;

  // Of the scene; shared by all trials in it.
  std::shared_ptr<const RayScene> rays;  ///< For the lidar; nullptr: made of the world's mesh.
  std::shared_ptr<const std::vector<core::CameraPose>> training_views;  ///< nullptr: unknown.
};

template <class Value>
struct Reading {
  core::TimeNs time_ns = 0, available_ns = 0;
  Value value;
};

/// All readings of a trial, each list in order of time.
struct SensorLog {
  std::vector<Reading<std::vector<float>>> lidar;  ///< Ranges [m], NaN: none.
  std::vector<Reading<ImuReading>> imu;
  std::vector<Reading<core::Pose2>> odometry;  ///< In Odom, which starts at the true pose.
  std::vector<Reading<GeodeticPoint>> gps;
  std::vector<Reading<double>> compass_rad;
  std::vector<Reading<RenderValidity>> camera;  ///< One per image.

  /// Name, number of readings and a hash of all their bits, of each sensor that has readings.
  struct Digest {
    std::string sensor;
    std::size_t readings = 0;
    std::uint64_t hash = 0;
    bool operator==(const Digest&) const = default;
  };
  [[nodiscard]] std::vector<Digest> digests() const;
};

/// All sensors but the camera.
class SensorSuite {
 public:
  /// @param settings  Must outlive the suite. @param mesh  For the lidar.
  SensorSuite(const SensorSettings& settings, const TriangleMesh& mesh,
              const LocalFrame& local_frame, const core::Pose2& start, std::uint64_t seed);

  /// The base has come to that pose at that time (true). Times ascend. Takes what was due.
  void move_to(core::TimeNs time_ns, const core::Pose2& pose);

  /// What was taken so far; readings that are not available yet are in it, too.
  [[nodiscard]] const SensorLog& log() const { return log_; }
  [[nodiscard]] SensorLog take_log() { return std::exchange(log_, {}); }

 private:
  void take_due();
  void take_scans();
  void take_imu();
  void take_odometry();

  const SensorSettings& settings_;
  std::uint64_t seed_;
  std::shared_ptr<const RayScene> rays_;
  PoseHistory history_;
  std::optional<Odometer> odometer_;
  std::optional<Imu> imu_;
  std::optional<Gps> gps_;
  std::optional<Compass> compass_;
  std::uint64_t scans_ = 0, imu_due_ = 0, odometry_due_ = 0, fixes_ = 0, headings_ = 0;
  SensorLog log_;
};

}  // namespace segsim::sim
