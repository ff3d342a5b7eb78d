#include "experiments/trials/sensor_files.h"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <ostream>

#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/support/gzip_file.h"

namespace segsim::experiments::trials {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kDegPerRad = 180.0 / std::numbers::pi;

/// To the nanosecond.
std::string seconds_text(core::TimeNs time_ns) {
  return core::print("%lld.%09lld", static_cast<long long>(time_ns / core::kNsPerSecond),
                     static_cast<long long>(time_ns % core::kNsPerSecond));
}

template <class Value>
std::string times_of(const sim::Reading<Value>& reading) {
  return seconds_text(reading.time_ns) + "," + seconds_text(reading.available_ns);
}

/// Infinity, which stands for "unknown", as an empty field.
std::string number_text(double value) {
  return std::isfinite(value) ? core::print("%.6f", value) : std::string();
}

Json number(double value) { return std::isfinite(value) ? Json(value) : Json(); }

Json camera_summary(const sim::SensorLog& log) {
  std::vector<sim::RenderValidity> images;
  for (const auto& image : log.camera) images.push_back(image.value);
  const sim::RenderValiditySummary sum = sim::summary_of(images);
  return {{"images", sum.images},
          {"render_invalid_images", sum.invalid_images},
          {"mean_alpha", sum.mean_alpha},
          {"hole_share", sum.hole_share},
          {"mean_view_distance_m", number(sum.view_m)},
          {"largest_view_distance_m", number(sum.farthest_view_m)},
          {"mean_view_angle_deg", number(sum.view_rad * kDegPerRad)}};
}

Json summary_of(const sim::SensorSettings& settings, const sim::SensorLog& log) {
  Json sensors = Json::object();
  for (const sim::SensorLog::Digest& digest : log.digests()) {
    sensors[digest.sensor] = {{"readings", digest.readings}, {"hash", core::hex(digest.hash)}};
  }
  if (settings.lidar && sensors.contains("lidar")) {
    const sim::LidarModel& model = settings.lidar->model;
    sensors["lidar"]["first_deg"] = model.first_rad * kDegPerRad;
    sensors["lidar"]["last_deg"] = model.last_rad * kDegPerRad;
    sensors["lidar"]["beams"] = model.beams;
    sensors["lidar"]["sweep_s"] = model.sweep_s;
    sensors["lidar"]["height_m"] = model.height_m;
    sensors["lidar"]["forward_m"] = model.forward_m;
  }
  return {
      {"schema", "segsim.sensors/1"}, {"camera", camera_summary(log)}, {"sensors", sensors}};
}

}  // namespace

std::string camera_csv(const sim::SensorLog& log) {
  std::string text =
      "time_s,available_s,mean_alpha,hole_share,view_distance_m,view_angle_deg,"
      "render_invalid\n";
  for (const auto& image : log.camera) {
    const sim::RenderValidity& v = image.value;
    text += times_of(image) + core::print(",%.6f,%.6f,", v.mean_alpha, v.hole_share) +
            number_text(v.view_m) + "," + number_text(v.view_rad * kDegPerRad) +
            (v.render_invalid ? ",1\n" : ",0\n");
  }
  return text;
}

std::string imu_csv(const sim::SensorLog& log) {
  std::string text =
      "time_s,available_s,accel_x_mps2,accel_y_mps2,accel_z_mps2,gyro_x_radps,gyro_y_radps,"
      "gyro_z_radps\n";
  for (const auto& reading : log.imu) {
    const glm::dvec3 &a = reading.value.accel_mps2, &w = reading.value.gyro_radps;
    text += times_of(reading) +
            core::print(",%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n", a.x, a.y, a.z, w.x, w.y, w.z);
  }
  return text;
}

std::string odometry_csv(const sim::SensorLog& log) {
  std::string text = "time_s,available_s,x_m,y_m,yaw_rad\n";
  for (const auto& reading : log.odometry) {
    const core::Pose2& pose = reading.value;
    text +=
        times_of(reading) + core::print(",%.9g,%.9g,%.9g\n", pose.x_m, pose.y_m, pose.yaw_rad);
  }
  return text;
}

std::string gps_csv(const sim::SensorLog& log) {
  std::string text = "time_s,available_s,latitude_deg,longitude_deg,height_m\n";
  for (const auto& fix : log.gps) {
    text += times_of(fix) + core::print(",%.10f,%.10f,%.4f\n", fix.value.latitude_deg,
                                        fix.value.longitude_deg, fix.value.height_m);
  }
  return text;
}

std::string compass_csv(const sim::SensorLog& log) {
  std::string text = "time_s,available_s,heading_deg\n";
  for (const auto& reading : log.compass_rad) {
    text += times_of(reading) + core::print(",%.6f\n", reading.value * kDegPerRad);
  }
  return text;
}

std::string lidar_csv(const sim::SensorLog& log) {
  std::string text = "time_s,available_s";
  if (!log.lidar.empty()) {
    for (std::size_t k = 0; k < log.lidar.front().value.size(); ++k) {
      text += ",range_" + std::to_string(k) + "_m";
    }
  }
  text += '\n';
  for (const auto& scan : log.lidar) {
    text += times_of(scan);
    for (const float range_m : scan.value) {
      text += ',';
      if (!std::isnan(range_m)) text += core::print("%.4f", double{range_m});
    }
    text += '\n';
  }
  return text;
}

void write_sensor_files(const fs::path& folder, const sim::SensorSettings& settings,
                        const sim::SensorLog& log) {
  const auto write = [&folder](const char* name, bool has_readings, const std::string& text) {
    if (has_readings) {
      core::write_file_atomically(folder / name, [&](std::ostream& out) { out << text; });
    } else {
      std::error_code ignored;  // It need not be there.
      fs::remove(folder / name, ignored);
    }
  };
  write("camera.csv", !log.camera.empty(), camera_csv(log));
  write("imu.csv", !log.imu.empty(), imu_csv(log));
  write("odometry.csv", !log.odometry.empty(), odometry_csv(log));
  write("gps.csv", !log.gps.empty(), gps_csv(log));
  write("compass.csv", !log.compass_rad.empty(), compass_csv(log));
  if (log.lidar.empty()) {
    write("lidar.csv.gz", false, "");
  } else {
    support::write_gzip(folder / "lidar.csv.gz", lidar_csv(log));
  }
  write("summary.json", true, summary_of(settings, log).dump(2) + "\n");
}

}  // namespace segsim::experiments::trials
