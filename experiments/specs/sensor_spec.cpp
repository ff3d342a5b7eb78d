#include "experiments/specs/sensor_spec.h"

#include <cmath>
#include <numbers>
#include <string>

#include "core/bundle_parts.h"
#include "core/camera_path.h"
#include "experiments/support/numbers_in_range.h"

namespace segsim::experiments::specs {
namespace {

using core::ConfigNode;

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

core::TimeNs ns_within(const ConfigNode& node, const std::string& key, double fallback_ms) {
  return sim::ns_from_ms(support::number_within(node, key, fallback_ms, 0.0, 60000.0));
}

/// `rate_hz`, `phase_ms` and `latency_ms`.
template <class Model>
void read_times(const ConfigNode& node, double default_hz, sim::Timed<Model>& sensor) {
  sensor.period_ns =
      std::llround(1e9 / support::number_within(node, "rate_hz", default_hz, 0.01, 1000.0));
  sensor.phase_ns = ns_within(node, "phase_ms", 0.0);
  sensor.latency_ns = ns_within(node, "latency_ms", 0.0);
}

/// {sigma, drift, drift_time_s} in a unit of which the model's is `factor`.
sim::ErrorModel read_error(const ConfigNode& parent, const std::string& key,
                           sim::ErrorModel error, double factor = 1.0) {
  const std::optional<ConfigNode> node = parent.optional_child(key);
  if (!node) return error;
  constexpr double kMost = 1e6;
  error.sigma =
      factor * support::number_within(*node, "sigma", error.sigma / factor, 0.0, kMost);
  error.drift =
      factor * support::number_within(*node, "drift", error.drift / factor, 0.0, kMost);
  error.drift_time_s =
      support::number_within(*node, "drift_time_s", error.drift_time_s, 1e-3, 1e9);
  node->finish();
  return error;
}

/// A word, or a map with the word under `noise`.
sim::DepthModel read_depth(const ConfigNode& camera) {
  const std::vector<std::string> kNoises = {"ideal", "kinect-axial", "redwood"};
  sim::DepthModel depth;
  const std::optional<ConfigNode> node = camera.optional_child("depth");
  if (!node) return depth;
  if (node->is_scalar()) {
    depth.noise = static_cast<sim::DepthNoise>(core::choice(camera, "depth", kNoises));
    return depth;
  }
  if (node->has("noise")) {
    depth.noise = static_cast<sim::DepthNoise>(core::choice(*node, "noise", kNoises));
  }
  depth.min_range_m =
      support::number_within(*node, "min_range_m", depth.min_range_m, 0.0, 100.0);
  depth.flying_pixels =
      support::number_within(*node, "flying_pixels", depth.flying_pixels, 0.0, 1.0);
  if (node->has("grazing_limit_deg")) {
    depth.grazing_limit_rad =
        kRadPerDeg * support::number_within(*node, "grazing_limit_deg", 90.0, 1.0, 90.0);
  }
  node->finish();
  return depth;
}

sim::CameraModel read_camera(const ConfigNode& sensors) {
  sim::CameraModel camera;
  const std::optional<ConfigNode> node = sensors.optional_child("camera");
  if (!node) return camera;
  sim::RgbModel& rgb = camera.rgb;
  rgb.exposure_s = 1e-3 * support::number_within(*node, "exposure_ms", 0.0, 0.0, 1000.0);
  rgb.sub_poses =
      support::count_within(*node, "sub_poses", rgb.exposure_s > 0.0 ? 5 : 1, 1, 101);
  if (rgb.sub_poses > 1 && rgb.exposure_s == 0.0) {
    node->child("sub_poses").fail("1 (exposure_ms is 0)", node->text("sub_poses"));
  }
  rgb.full_well_e = support::number_within(*node, "full_well", 0.0, 0.0, 1e7);
  rgb.read_noise_e = support::number_within(*node, "read_noise", 0.0, 0.0, 1e6);
  if (rgb.read_noise_e > 0.0 && rgb.full_well_e == 0.0) {
    node->child("read_noise").fail("full_well (electrons at white) with it", "none");
  }
  if (node->has("jpeg_quality")) {
    rgb.jpeg_quality = support::count_within(*node, "jpeg_quality", 90, 1, 100);
  }
  camera.hole_limit = support::number_within(*node, "hole_limit", camera.hole_limit, 0.0, 1.0);
  camera.depth = read_depth(*node);
  node->finish();
  return camera;
}

std::optional<sim::Timed<sim::LidarModel>> read_lidar(const ConfigNode& sensors) {
  const std::optional<ConfigNode> node = sensors.optional_child("lidar");
  if (!node) return std::nullopt;
  sim::Timed<sim::LidarModel> lidar;
  read_times(*node, 50.0, lidar);
  sim::LidarModel& model = lidar.model;
  model.beams = support::count_within(*node, "beams", model.beams, 2, 100000);
  model.first_rad =
      kRadPerDeg *
      support::number_within(*node, "first_deg", model.first_rad / kRadPerDeg, -360.0, 360.0);
  model.last_rad =
      kRadPerDeg *
      support::number_within(*node, "last_deg", model.last_rad / kRadPerDeg, -360.0, 360.0);
  if (model.last_rad <= model.first_rad) node->fail("first_deg < last_deg", "none between");
  model.min_range_m =
      support::number_within(*node, "min_range_m", model.min_range_m, 0.0, 1000.0);
  model.max_range_m = support::number_within(*node, "max_range_m", model.max_range_m,
                                             model.min_range_m, 1000.0);
  model.sigma_m = support::number_within(*node, "sigma_m", model.sigma_m, 0.0, 100.0);
  model.height_m = support::number_within(*node, "height_m", model.height_m, 0.0, 3.0);
  model.forward_m = support::number_within(*node, "forward_m", model.forward_m, -2.0, 2.0);
  model.sweep_s = 1e-3 * support::number_within(*node, "sweep_ms", 0.0, 0.0,
                                                1e-6 * static_cast<double>(lidar.period_ns));
  node->finish();
  return lidar;
}

std::optional<sim::Timed<sim::ImuModel>> read_imu(const ConfigNode& sensors) {
  const std::optional<ConfigNode> node = sensors.optional_child("imu");
  if (!node) return std::nullopt;
  sim::Timed<sim::ImuModel> imu;
  read_times(*node, 50.0, imu);
  imu.model.accel_mps2 = read_error(*node, "accel_mps2", imu.model.accel_mps2);
  imu.model.gyro_radps = read_error(*node, "gyro_radps", imu.model.gyro_radps);
  node->finish();
  return imu;
}

std::optional<sim::Timed<sim::OdometryNoise>> read_odometry(const ConfigNode& sensors) {
  const std::optional<ConfigNode> node = sensors.optional_child("odometry");
  if (!node) return std::nullopt;
  // The same as `localisation: odom`, and with it the same numbers.
  sim::Timed<sim::OdometryNoise> odometry{sim::OdometryNoise::skid_steered_indoors()};
  read_times(*node, 50.0, odometry);
  node->finish();
  return odometry;
}

std::optional<sim::Timed<sim::GpsModel>> read_gps(const ConfigNode& sensors) {
  const std::optional<ConfigNode> node = sensors.optional_child("gps");
  if (!node) return std::nullopt;
  sim::Timed<sim::GpsModel> gps;
  read_times(*node, 40.0, gps);
  gps.model.horizontal_m = read_error(*node, "error_m", gps.model.horizontal_m);
  gps.model.up_factor =
      support::number_within(*node, "up_factor", gps.model.up_factor, 0.0, 100.0);
  gps.model.antenna_m =
      support::number_within(*node, "antenna_m", gps.model.antenna_m, 0.0, 10.0);
  node->finish();
  return gps;
}

std::optional<sim::Timed<sim::CompassModel>> read_compass(const ConfigNode& sensors) {
  const std::optional<ConfigNode> node = sensors.optional_child("compass");
  if (!node) return std::nullopt;
  sim::Timed<sim::CompassModel> compass;
  read_times(*node, 50.0, compass);
  compass.model.heading_rad =
      read_error(*node, "error_deg", compass.model.heading_rad, kRadPerDeg);
  compass.model.declination_rad =
      kRadPerDeg * support::number_within(*node, "declination_deg", 0.0, -180.0, 180.0);
  node->finish();
  return compass;
}

}  // namespace

std::optional<sim::SensorSettings> read_sensors(const ConfigNode& root) {
  const std::optional<ConfigNode> node = root.optional_child("sensors");
  if (!node) return std::nullopt;
  sim::SensorSettings sensors;
  sensors.camera = read_camera(*node);
  sensors.lidar = read_lidar(*node);
  sensors.imu = read_imu(*node);
  sensors.odometry = read_odometry(*node);
  sensors.gps = read_gps(*node);
  sensors.compass = read_compass(*node);
  node->finish();
  return sensors;
}

LocalisationSpec read_localisation(const ConfigNode& root) {
  const std::vector<std::string> kTypes = {"perfect", "odom", "noisy"};
  LocalisationSpec spec;
  const std::optional<ConfigNode> node = root.optional_child("localisation");
  if (!node) return spec;
  const bool word = node->is_scalar();
  const std::size_t type =
      word ? core::choice(root, "localisation", kTypes) : core::choice(*node, "type", kTypes);
  spec.odometry = type == 1;
  if (type == 2) {
    sim::LocaliserModel& model = spec.localiser.emplace();
    if (!word) {
      model.position_m = read_error(*node, "position_m", model.position_m);
      model.heading_rad = read_error(*node, "heading_deg", model.heading_rad, kRadPerDeg);
      model.period_ns =
          std::llround(1e9 / support::number_within(*node, "rate_hz", 10.0, 0.01, 1000.0));
    }
  }
  if (!word) node->finish();
  return spec;
}

std::shared_ptr<const sim::SensorSettings> bind_sensors(sim::SensorSettings settings,
                                                        const core::SceneBundle& bundle,
                                                        const sim::World& world) {
  if (settings.lidar) settings.rays = sim::make_ray_scene(world.mesh());
  // A world of meshes has no folder, and was not reconstructed from any views.
  const core::BundleParts parts =
      bundle.folder.empty() ? core::BundleParts{} : core::load_bundle_parts(bundle.folder);
  if (!parts.cameras.name.empty()) {
    settings.training_views = std::make_shared<const std::vector<core::CameraPose>>(
        core::read_camera_path(bundle.folder / parts.cameras.name).poses());
  }
  return std::make_shared<const sim::SensorSettings>(std::move(settings));
}

}  // namespace segsim::experiments::specs
