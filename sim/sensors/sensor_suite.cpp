#include "sim/sensors/sensor_suite.h"

#include <bit>
#include <string_view>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

template <class Model>
core::TimeNs due_ns(const Timed<Model>& sensor, std::uint64_t index) {
  return sensor.phase_ns + static_cast<core::TimeNs>(index) * sensor.period_ns;
}

template <class Model>
void check(const std::optional<Timed<Model>>& sensor, const char* name) {
  SEGSIM_CHECK(
      !sensor || (sensor->period_ns > 0 && sensor->phase_ns >= 0 && sensor->latency_ns >= 0),
      name);
}

/// A chain over bits, the same on every machine.
class BitHash {
 public:
  void add(std::uint64_t word) {
    char bytes[8];
    for (int k = 0; k < 8; ++k) bytes[k] = static_cast<char>((word >> (8 * k)) & 0xffU);
    hash_ = core::hash64(std::string_view(bytes, sizeof bytes), hash_);
  }
  void add(double value) { add(std::bit_cast<std::uint64_t>(value)); }
  void add(const std::vector<float>& values) {
    for (const float value : values) {
      add(std::uint64_t{std::bit_cast<std::uint32_t>(value)});
    }
  }
  void add(const ImuReading& value) {
    for (int axis = 0; axis < 3; ++axis) {
      add(value.accel_mps2[axis]);
      add(value.gyro_radps[axis]);
    }
  }
  void add(const core::Pose2& value) {
    add(value.x_m);
    add(value.y_m);
    add(value.yaw_rad);
  }
  void add(const GeodeticPoint& value) {
    add(value.latitude_deg);
    add(value.longitude_deg);
    add(value.height_m);
  }
  [[nodiscard]] std::uint64_t hash() const { return hash_; }

 private:
  std::uint64_t hash_ = 0;
};

template <class Value>
void append_digest(const char* name, const std::vector<Reading<Value>>& readings,
                   std::vector<SensorLog::Digest>& digests) {
  if (readings.empty()) return;
  BitHash hash;
  for (const Reading<Value>& reading : readings) {
    hash.add(static_cast<std::uint64_t>(reading.time_ns));
    hash.add(static_cast<std::uint64_t>(reading.available_ns));
    hash.add(reading.value);
  }
  digests.push_back({name, readings.size(), hash.hash()});
}

}  // namespace

std::vector<SensorLog::Digest> SensorLog::digests() const {
  std::vector<Digest> made;
  append_digest("lidar", lidar, made);
  append_digest("imu", imu, made);
  append_digest("odometry", odometry, made);
  append_digest("gps", gps, made);
  append_digest("compass", compass_rad, made);
  return made;
}

SensorSuite::SensorSuite(const SensorSettings& settings, const TriangleMesh& mesh,
                         const LocalFrame& local_frame, const core::Pose2& start,
                         std::uint64_t seed)
    : settings_(settings), seed_(seed), rays_(settings.rays), history_(0, start) {
  check(settings.lidar, "lidar");
  check(settings.imu, "imu");
  check(settings.odometry, "odometry");
  check(settings.gps, "gps");
  check(settings.compass, "compass");
  if (settings.lidar && rays_ == nullptr) rays_ = make_ray_scene(mesh);
  if (settings.odometry) odometer_.emplace(settings.odometry->model, start, seed);
  if (settings.imu) imu_.emplace(settings.imu->model, start, seed);
  if (settings.gps) gps_.emplace(settings.gps->model, local_frame, seed);
  if (settings.compass) compass_.emplace(settings.compass->model, local_frame, seed);
  take_due();
}

void SensorSuite::move_to(core::TimeNs time_ns, const core::Pose2& pose) {
  history_.add(time_ns, pose);
  take_due();
  if (imu_) imu_->move_to(time_ns, pose);
  if (odometer_) odometer_->move_to(time_ns, pose);
  const core::TimeNs sweep_ns = settings_.lidar ? settings_.lidar->model.sweep_ns() : 0;
  history_.forget_before(time_ns - sweep_ns);
}

void SensorSuite::take_due() {
  const core::TimeNs now_ns = history_.last_ns();
  if (settings_.lidar) take_scans();
  if (imu_) take_imu();
  if (odometer_) take_odometry();
  if (gps_) {
    const auto& sensor = *settings_.gps;
    for (core::TimeNs t = due_ns(sensor, fixes_); t <= now_ns; t = due_ns(sensor, ++fixes_)) {
      log_.gps.push_back({t, t + sensor.latency_ns, gps_->read(t, history_.at(t))});
    }
  }
  if (compass_) {
    const auto& sensor = *settings_.compass;
    for (core::TimeNs t = due_ns(sensor, headings_); t <= now_ns;
         t = due_ns(sensor, ++headings_)) {
      log_.compass_rad.push_back(
          {t, t + sensor.latency_ns, compass_->read_rad(t, history_.at(t))});
    }
  }
}

/// A scan is taken when its last beam is due.
void SensorSuite::take_scans() {
  const auto& sensor = *settings_.lidar;
  for (;; ++scans_) {
    const core::TimeNs start_ns = due_ns(sensor, scans_);
    const core::TimeNs end_ns = start_ns + sensor.model.sweep_ns();
    if (end_ns > history_.last_ns()) return;
    log_.lidar.push_back(
        {start_ns, end_ns + sensor.latency_ns,
         scan(
             sensor.model, *rays_, [this](core::TimeNs t) { return history_.at(t); }, start_ns,
             seed_, scans_)});
  }
}

/// Brings the IMU to each due time within the last step; the end of the step comes after.
void SensorSuite::take_imu() {
  const auto& sensor = *settings_.imu;
  for (;; ++imu_due_) {
    const core::TimeNs t = due_ns(sensor, imu_due_);
    if (t > history_.last_ns()) return;
    if (t == 0) continue;  // No time has passed that it could tell of.
    imu_->move_to(t, history_.at(t));
    log_.imu.push_back({t, t + sensor.latency_ns, imu_->read()});
  }
}

void SensorSuite::take_odometry() {
  const auto& sensor = *settings_.odometry;
  for (;; ++odometry_due_) {
    const core::TimeNs t = due_ns(sensor, odometry_due_);
    if (t > history_.last_ns()) return;
    // A copy, so that the times of reading do not change the steps of the odometer itself.
    Odometer until = *odometer_;
    until.move_to(t, history_.at(t));
    log_.odometry.push_back({t, t + sensor.latency_ns, until.estimate()});
  }
}

}  // namespace segsim::sim
