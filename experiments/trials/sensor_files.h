#pragma once

/// @file
/// What the sensors of a trial recorded, as text:
///
///     camera.csv     per image: alpha, holes, nearest training view, render_invalid
///     imu.csv, odometry.csv, gps.csv, compass.csv
///     lidar.csv.gz   a row of ranges per scan; empty: no return
///     summary.json   readings and hash of each sensor, the lidar's angles, means of
///     camera.csv
///
/// Every row begins with time_s (of the reading) and available_s (when the robot has it).

#include <filesystem>
#include <string>

#include "sim/sensors/sensor_suite.h"

namespace segsim::experiments::trials {

/// Replaces what an earlier trial left in `folder`.
/// @throws core::InputError if a file cannot be written.
void write_sensor_files(const std::filesystem::path& folder,
                        const sim::SensorSettings& settings, const sim::SensorLog& log);

// The files' contents; a header line, then a line per reading.
[[nodiscard]] std::string camera_csv(const sim::SensorLog& log);
[[nodiscard]] std::string imu_csv(const sim::SensorLog& log);
[[nodiscard]] std::string odometry_csv(const sim::SensorLog& log);
[[nodiscard]] std::string gps_csv(const sim::SensorLog& log);
[[nodiscard]] std::string compass_csv(const sim::SensorLog& log);
[[nodiscard]] std::string lidar_csv(const sim::SensorLog& log);

}  // namespace segsim::experiments::trials
