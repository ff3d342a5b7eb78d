#include "reconstruction/datasets/depth_sensor.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "core/check.h"
#include "core/name_table.h"

namespace segsim::reconstruction {
namespace {

constexpr core::NameTable<DepthSensor, DepthSensor::kHololens> kWords(
    "a kind of depth camera", {"none", "generic", "kinect-v1", "tof", "stereo", "hololens"});

constexpr float kNearest_m = 0.3F;
constexpr float kNoise = 3.0F;               ///< Standard deviations.
constexpr double kGrazing_rad = 1.39626340;  ///< 80 degrees.

}  // namespace

DepthSensor parse_depth_sensor(const std::string& word, const std::string& place) {
  return kWords.read(word, place);
}

std::string words_of(DepthSensor sensor) { return kWords.name(sensor); }

float depth_sigma_m(DepthSensor sensor, float depth_m) {
  const float z = std::max(depth_m, kNearest_m);
  switch (sensor) {
    case DepthSensor::kUnstated:
      break;
    case DepthSensor::kGeneric:
      return 0.01F * z;
    case DepthSensor::kKinectV1:
      return 0.0012F + 0.0019F * (z - 0.4F) * (z - 0.4F);
    case DepthSensor::kTof:
      return 0.0015F - 0.0005F * z + 0.0003F * z * z;
    case DepthSensor::kStereo:
      return 0.0038F * z * z;
    case DepthSensor::kHololens:
      return 0.005F + 0.004F * z;
  }
  SEGSIM_CHECK(false, "no sensor was stated");
}

float depth_weight(DepthSensor sensor, float depth_m) {
  return depth_sigma_m(sensor, 1.0F) / depth_sigma_m(sensor, depth_m);
}

bool has_flying_pixels(DepthSensor sensor) {
  return sensor == DepthSensor::kTof || sensor == DepthSensor::kHololens;
}

std::size_t remove_flying_pixels(DepthSensor sensor, const core::CameraIntrinsics& camera,
                                 core::Image<float>& depth_m) {
  constexpr std::array<std::pair<int, int>, 4> kAcross{{{1, 0}, {0, 1}, {1, 1}, {1, -1}}};
  const auto slope = static_cast<float>(std::tan(kGrazing_rad) / camera.fx_px);
  std::vector<std::size_t> flying;
  for (int y = 1; y + 1 < depth_m.height_px(); ++y) {
    for (int x = 1; x + 1 < depth_m.width_px(); ++x) {
      const float z = depth_m(x, y);
      if (!(z > 0.0F)) continue;
      const float least = std::max(kNoise * depth_sigma_m(sensor, z), slope * z);
      const bool is_between =
          std::any_of(kAcross.begin(), kAcross.end(), [&](const std::pair<int, int>& step) {
            const float a = depth_m(x - step.first, y - step.second) - z;
            const float b = depth_m(x + step.first, y + step.second) - z;
            return (a < -least && b > least) || (b < -least && a > least);
          });
      if (is_between) {
        flying.push_back(static_cast<std::size_t>(y) * depth_m.width_px() + x);
      }
    }
  }
  for (const std::size_t pixel : flying) depth_m.pixels()[pixel] = std::nanf("");
  return flying.size();
}

}  // namespace segsim::reconstruction
