// What the sensor models cost per image of 640x480 and per reading.
#include <benchmark/benchmark.h>
#include <glm/common.hpp>

#include "core/random.h"
#include "sim/ground/robot.h"
#include "sim/sensors/depth_sensor.h"
#include "sim/sensors/lidar.h"
#include "sim/sensors/rgb_sensor.h"
#include "sim/sensors/sensor_suite.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::sim {
namespace {

const core::CameraIntrinsics kCamera = core::CameraIntrinsics::from_fov(640, 480, 1.2);

/// Boxes before a wall.
core::Image<float> bench_depth() {
  core::Image<float> depth(640, 480);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      depth(x, y) = (x / 40 + y / 60) % 3 == 0 ? 1.5F : 3.0F + 0.002F * static_cast<float>(x);
    }
  }
  return depth;
}

core::Image<core::Rgb8> bench_rgb() {
  core::Image<core::Rgb8> rgb(640, 480);
  core::RandomStream random(1, "bench");
  for (core::Rgb8& c : rgb.pixels()) {
    const auto base = static_cast<std::uint8_t>(64 + random.index(128));
    c = {base, static_cast<std::uint8_t>(base / 2), 90};
  }
  return rgb;
}

/// Of noise, flying pixels and grazing drop-out: what the argument's bits say.
void BM_Depth(benchmark::State& state) {
  DepthModel model;
  model.noise = static_cast<DepthNoise>(state.range(0));
  if (state.range(1) != 0) {
    model.flying_pixels = 0.3;
    model.grazing_limit_rad = 1.4;
  }
  const core::Image<float> truth = bench_depth();
  core::Image<float> measured;
  std::uint64_t capture = 0;
  for (auto _ : state) {
    measure_depth(model, kCamera, PixelNoise(1, "camera/depth", capture++), truth, measured);
    benchmark::DoNotOptimize(measured.data());
  }
  state.SetLabel(to_string(model.noise));
  if (measured(0, 0) < 1.0F) state.SkipWithError("ERROR OCCURRED: depth");
}
BENCHMARK(BM_Depth)->ArgsProduct({{0, 1, 2}, {0, 1}})->Unit(benchmark::kMillisecond);

void BM_RgbNoise(benchmark::State& state) {
  RgbModel model;
  model.full_well_e = 5000.0;
  model.read_noise_e = 8.0;
  const core::Image<core::Rgb8> rgb = bench_rgb();
  core::Image<core::Rgb8> noisy = rgb;
  std::uint64_t capture = 0;
  for (auto _ : state) {
    noisy = rgb;
    add_rgb_noise(model, PixelNoise(1, "camera/rgb", capture++), noisy);
    benchmark::DoNotOptimize(noisy.data());
  }
  if (noisy.pixels() == rgb.pixels()) state.SkipWithError("ERROR OCCURRED: no noise");
}
BENCHMARK(BM_RgbNoise)->Unit(benchmark::kMillisecond);

void BM_Jpeg(benchmark::State& state) {
  RgbModel model;
  model.jpeg_quality = 90;
  const core::Image<core::Rgb8> rgb = bench_rgb();
  core::Image<core::Rgb8> coded = rgb;
  for (auto _ : state) {
    coded = rgb;
    compress_jpeg(model, coded);
    benchmark::DoNotOptimize(coded.data());
  }
  if (coded.size() != rgb.size()) state.SkipWithError("ERROR OCCURRED: size");
}
BENCHMARK(BM_Jpeg)->Unit(benchmark::kMillisecond);

/// The mean of five images; rendering them is not in it.
void BM_ExposureMean(benchmark::State& state) {
  const core::Image<core::Rgb8> rgb = bench_rgb();
  core::Image<core::Rgb8> made;
  ExposureMean mean;
  for (auto _ : state) {
    for (int k = 0; k < 5; ++k) mean.add(rgb);
    mean.finish(made);
    benchmark::DoNotOptimize(made.data());
  }
  if (made.pixels() != rgb.pixels()) state.SkipWithError("ERROR OCCURRED: the mean");
}
BENCHMARK(BM_ExposureMean)->Unit(benchmark::kMillisecond);

/// One scan of 720 beams in flat 3.
void BM_Scan(benchmark::State& state) {
  worlds::FlatOptions options;
  options.seed = 3;
  const MeshScene flat = worlds::make_flat(options);
  const RayScene scene(flat);
  // In the middle of the flat.
  glm::vec2 low(1e9F), high(-1e9F);
  for (const SubMesh& mesh : flat.meshes) {
    for (const glm::vec3& p : mesh.positions_m) {
      low = glm::min(low, glm::vec2(p));
      high = glm::max(high, glm::vec2(p));
    }
  }
  const glm::dvec2 middle_m = 0.5F * (low + high);
  LidarModel model;
  model.sweep_s = state.range(0) != 0 ? 0.015 : 0.0;
  std::uint64_t index = 0;
  double nearest_m = 1e9;
  for (auto _ : state) {
    const std::vector<float> ranges_m = scan(
        model, scene,
        [&](core::TimeNs) {
          return core::Pose2{middle_m.x, middle_m.y, 0.3};
        },
        0, 1, index++);
    for (const float range_m : ranges_m) {
      if (range_m < nearest_m) nearest_m = range_m;
    }
  }
  if (nearest_m > 30.0) state.SkipWithError("ERROR OCCURRED: nothing was hit");
}
BENCHMARK(BM_Scan)->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);

/// One step of 5 ms with IMU, odometry, compass (50 Hz) and GPS (40 Hz).
void BM_SuiteStep(benchmark::State& state) {
  SensorSettings settings;
  settings.imu = {{}, 20'000'000, 0, 0};
  settings.odometry = {OdometryNoise::skid_steered_indoors(), 20'000'000, 0, 0};
  settings.compass = {{}, 20'000'000, 0, 0};
  settings.gps = {{}, 25'000'000, 0, 0};
  const TriangleMesh no_mesh;
  core::Pose2 pose;
  SensorSuite suite(settings, no_mesh, LocalFrame({49.9, 8.9, 0.0, 0.0}), pose, 1);
  core::TimeNs now_ns = 0;
  for (auto _ : state) {
    now_ns += 5'000'000;
    pose = drive_arc(pose, {0.5, 0.3}, 0.005);
    suite.move_to(now_ns, pose);
  }
  const SensorLog log = suite.take_log();
  if (now_ns > 100'000'000 &&
      log.imu.size() + 5 < static_cast<std::size_t>(now_ns / 20'000'000)) {
    state.SkipWithError("ERROR OCCURRED: readings are missing");
  }
}
BENCHMARK(BM_SuiteStep)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace segsim::sim
