/// @file
/// Frame times of the GPU renderer on the standard room: the table of docs/performance.md.
/// The table goes to the error stream, JSON to the output.
///
///     cuda_bench [frames [part]]      240 frames a row without; part: quick (no 5 M surfels,
///                                     no rooms, no K = 24), one (the first row),
///                                     batch (of 64), rooms (nine, eight of them behind walls)

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <future>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/random.h"
#include "renderer/cuda/cuda_renderer.h"
#include "renderer/scene/room_scene.h"

namespace segsim::renderer {
namespace {

using core::CameraPose;
using core::Channels;

struct BenchScene {
  std::string name;
  std::shared_ptr<const SurfelCloud> surfels;
  std::shared_ptr<const PanopticField> field;  ///< Null: the surfels' own labels.
};

struct Row {
  std::string name;
  const BenchScene* scene;
  int width_px, height_px;
  Channels channels = Channels::kAll;
  int cameras = 1;
  RenderOptions options{};
  double must_ms = 0.0;  ///< For the whole batch; 0: no target.
  bool always_culls = false;
};

/// What training would find: the classes' mean features tell them apart, and every box has a
/// query about its middle that looks for its mean feature; further queries lie anywhere.
PanopticModel room_model(const SurfelCloud& cloud, int queries) {
  PanopticModel model;
  std::map<std::uint16_t, PanopticClass> classes;
  std::map<std::uint16_t, double> class_count;
  std::map<std::uint16_t, InstanceQuery> boxes;
  std::map<std::uint16_t, float> box_count;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    PanopticClass& c = classes[cloud.semantic_id[i]];
    c.id = cloud.semantic_id[i];
    c.thing = c.thing || cloud.instance_id[i] != 0;
    class_count[c.id] += 1.0;
    for (std::size_t k = 0; k < 16; ++k) c.weight[k] += cloud.semantic_feature[i][k];
    if (cloud.instance_id[i] == 0) continue;
    InstanceQuery& q = boxes[cloud.instance_id[i]];
    q.id = cloud.instance_id[i];
    box_count[q.id] += 1.0F;
    q.position_m += cloud.position_m[i];
    for (std::size_t k = 0; k < 32; ++k) q.feature[k] += cloud.instance_feature[i][k];
  }
  constexpr float kSharpness = 4.0F;
  for (auto& [id, c] : classes) {
    for (float& w : c.weight) {
      w /= static_cast<float>(class_count[id]);
      c.bias -= 0.5F * kSharpness * w * w;
      w *= kSharpness;
    }
    model.classes.push_back(c);
  }
  for (auto& [id, q] : boxes) {
    q.position_m /= box_count[id];
    for (float& f : q.feature) f /= box_count[id];
    q.sigma_m = glm::vec3(0.5F);
    model.queries.push_back(q);
  }
  core::RandomStream random(7, "cuda_bench.model");
  while (static_cast<int>(model.queries.size()) < queries) {
    const std::size_t i = random.index(static_cast<std::uint32_t>(cloud.size()));
    InstanceQuery q;
    q.id = static_cast<std::uint16_t>(1000 + model.queries.size());
    q.position_m = cloud.position_m[i];
    q.feature = cloud.instance_feature[i];
    model.queries.push_back(q);
  }
  return model;
}

/// @param surfels  Of one room.
BenchScene make_scene(int surfels, double spread, bool field, int rooms = 1) {
  RoomSceneOptions options;
  options.surfel_count = surfels;
  options.spread = spread;
  options.features = field;
  options.rooms = rooms;
  BenchScene scene;
  char name[64];
  std::snprintf(name, sizeof name, rooms > 1 ? "%g M, spread %.1f x%d" : "%g M, spread %.1f",
                surfels * 1e-6, spread, rooms);
  scene.name = name;
  SurfelCloud cloud = make_room_scene(options);
  if (field) {
    scene.field = std::make_shared<const PanopticField>(
        fold_panoptic_model(cloud, room_model(cloud, 64)));
    cloud.semantic_feature = {};
    cloud.instance_feature = {};
  }
  scene.surfels = std::make_shared<const SurfelCloud>(std::move(cloud));
  return scene;
}

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

void run(const Row& row, int frames, bool first) {
  constexpr int kLap = 240;  // Poses of the ring: 1.5 degrees from frame to frame.
  const std::vector<CameraPose> ring = room_camera_ring(kLap);
  const auto gpu = make_cuda_renderer(row.scene->surfels, row.options, row.scene->field);
  gpu->always_skip_hidden(row.always_culls);
  const core::CameraIntrinsics camera = room_camera(row.width_px, row.height_px);
  std::vector<CameraPose> poses(static_cast<std::size_t>(row.cameras));
  const auto set_poses = [&](int frame) {
    for (int i = 0; i < row.cameras; ++i) {
      poses[static_cast<std::size_t>(i)] =
          ring[static_cast<std::size_t>((frame + i * kLap / row.cameras) % kLap)];
    }
  };
  std::vector<double> wall_ms;
  double pairs = 0.0, touched = 0.0, evaluations = 0.0, fixed = 0.0, projected = 0.0;
  double whole = 0.0;  // Share of frames without a tile drawn again.
  constexpr int kWarmUp = 20;
  for (int frame = 0; frame < kWarmUp + frames; ++frame) {
    set_poses(frame);
    const auto start = std::chrono::steady_clock::now();
    gpu->render_batch(poses, camera, row.channels);
    gpu->wait();
    const std::chrono::duration<double, std::milli> wall =
        std::chrono::steady_clock::now() - start;
    if (frame < kWarmUp) continue;
    wall_ms.push_back(wall.count());
    const core::RenderStats stats = gpu->stats();
    projected += static_cast<double>(stats.surfels_projected) / frames;
    pairs += static_cast<double>(stats.pairs_binned) / frames;
    touched += static_cast<double>(stats.pairs_touched) / frames;
    evaluations += static_cast<double>(stats.evaluations) / frames;
    fixed += static_cast<double>(gpu->fixed_tiles()) / frames;
    whole += gpu->fixed_tiles() == 0 ? 100.0 / frames : 0.0;
  }
  std::vector<double> stage[5];
  for (int frame = 0; frame < 24; ++frame) {
    set_poses(frames + kWarmUp + frame);
    gpu->render_batch(poses, camera, row.channels);
    const CudaStageTimes t = gpu->measure_stages();
    const double ms[5] = {t.begin_ms, t.project_ms, t.order_ms, t.raster_ms, t.redo_ms};
    for (int s = 0; s < 5; ++s) stage[s].push_back(ms[s]);
  }
  const double median = quantile(wall_ms, 0.5), p95 = quantile(wall_ms, 0.95);
  double s[5];
  for (int i = 0; i < 5; ++i) s[i] = quantile(stage[i], 0.5);
  const double per_image = 1e-6 / row.cameras;
  std::fprintf(stderr,
               "%-30s %-18s %4dx%-4d x%-3d %7.3f %7.3f %8.0f %6.3f | %5.3f %5.3f %5.3f %6.3f "
               "%5.3f | %6.3f %6.3f %6.2f %6.1f %5.0f %4.0f\n",
               row.name.c_str(), row.scene->name.c_str(), row.width_px, row.height_px,
               row.cameras, median, p95, 1e3 * row.cameras / median, row.must_ms, s[0], s[1],
               s[2], s[3], s[4], projected * per_image, pairs * per_image, touched * per_image,
               evaluations * per_image, fixed, whole);
  std::printf(
      "%s  {\"case\": \"%s\", \"scene\": \"%s\", \"width_px\": %d, \"height_px\": %d, "
      "\"cameras\": %d, \"frames\": %d, \"median_ms\": %.4f, \"p95_ms\": %.4f, "
      "\"images_per_s\": %.1f, \"must_ms\": %.4f, \"begin_ms\": %.4f, "
      "\"project_ms\": %.4f, \"order_ms\": %.4f, \"raster_ms\": %.4f, "
      "\"redo_ms\": %.4f, \"surfels_projected\": %.0f, \"pairs_binned\": %.0f, "
      "\"pairs_touched\": %.0f, \"evaluations\": %.0f, \"fixed_tiles\": %.1f}",
      first ? "" : ",\n", row.name.c_str(), row.scene->name.c_str(), row.width_px,
      row.height_px, row.cameras, frames, median, p95, 1e3 * row.cameras / median, row.must_ms,
      s[0], s[1], s[2], s[3], s[4], projected, pairs, touched, evaluations, fixed);
}

/// What culling by termination depth is for: surfels behind walls.
void run_rooms(const BenchScene& rooms, int frames, bool first) {
  const Channels all = Channels::kAll;
  run({"rooms, no culling", &rooms, 1296, 968, all, 1, {.skip_hidden = false}}, frames, first);
  run({"rooms, culling if it pays", &rooms, 1296, 968}, frames, false);
  run({"rooms, always culling", &rooms, 1296, 968, all, 1, {}, 0.0, true}, frames, false);
}

void run_all(int frames, const std::string& part) {
  std::fprintf(stderr,
               "%-30s %-18s %9s %4s %7s %7s %8s %6s | %5s %5s %5s %6s %5s | %6s %6s %6s %6s "
               "%5s %4s\n",
               "case", "scene", "size", "", "median", "p95", "image/s", "must", "begin",
               "proj", "order", "raster", "redo", "M surf", "M pair", "M touch", "M eval",
               "fixed", "%0");
  if (part == "rooms") {
    std::printf("[\n");
    run_rooms(make_scene(500'000, 1.6, false, 9), frames, true);
    std::printf("\n]\n");
    return;
  }
  const auto start = std::chrono::steady_clock::now();
  auto dense_later = std::async(std::launch::async, make_scene, 1'000'000, 1.6, true, 1);
  auto plain_later = std::async(std::launch::async, make_scene, 1'000'000, 1.0, true, 1);
  std::future<BenchScene> large_later, rooms_later;
  if (part.empty()) {
    rooms_later = std::async(std::launch::async, make_scene, 500'000, 1.6, false, 9);
    large_later = std::async(std::launch::async, make_scene, 5'000'000, 1.0, false, 1);
  }
  const BenchScene dense = dense_later.get(), plain = plain_later.get();
  std::fprintf(
      stderr, "scenes: %.1f s\n",
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  const Channels labels = Channels::kLabels;
  const Channels robot = Channels::kRgbd | Channels::kLabels;
  std::vector<Row> rows{
      {"all outputs", &dense, 1296, 968, Channels::kAll, 1, {}, 1.3},
      {"all outputs", &dense, 1280, 720, Channels::kAll, 1, {}, 1.0},
      {"all outputs", &plain, 1280, 720, Channels::kAll, 1, {}, 1.0},
      {"labels only", &dense, 1280, 720, labels, 1, {}, 0.5},
      {"labels only", &plain, 1280, 720, labels, 1, {}, 0.5},
      {"RGB, depth, labels", &plain, 256, 256, robot, 64, {}, 8.0},
      {"all outputs", &plain, 640, 480, Channels::kAll, 16, {}, 16.0 / 3.0},
      {"RGB, depth", &dense, 1296, 968, Channels::kRgbd},
      {"culling", &dense, 1296, 968, Channels::kAll, 1, {}, 0.0, true},
      {"snug boxes", &dense, 1296, 968, Channels::kAll, 1, {.bounds = TileBounds::kSnugBox}},
      {"3-sigma squares",
       &dense,
       1296,
       968,
       Channels::kAll,
       1,
       {.bounds = TileBounds::kAabb, .skip_hidden = false}},
      {"no culling", &plain, 256, 256, robot, 64, {.skip_hidden = false}},
      {"no culling", &plain, 640, 480, Channels::kAll, 16, {.skip_hidden = false}},
      {"K = 1", &dense, 1296, 968, Channels::kAll, 1, {.top_k = 1}},
      {"K = 24", &dense, 1296, 968, Channels::kAll, 1, {.top_k = 24}},
      {"all outputs", &dense, 3840, 2160}};
  std::printf("[\n");
  bool first = true;
  for (const Row& row : rows) {
    if (part == "quick" && row.options.top_k > 4) continue;
    if (part == "batch" && row.cameras != 64) continue;
    run(row, frames, first);
    first = false;
    if (part == "one") break;
  }
  if (part.empty()) {
    const BenchScene large = large_later.get();
    run({"all outputs", &large, 1280, 720}, frames, false);
    run({"no culling", &large, 1280, 720, Channels::kAll, 1, {.skip_hidden = false}}, frames,
        false);
    run({"all outputs", &large, 3840, 2160}, frames, false);
    run_rooms(rooms_later.get(), frames, false);
  }
  std::printf("\n]\n");
}

}  // namespace
}  // namespace segsim::renderer

int main(int argc, char** argv) {
  try {
    segsim::renderer::run_all(argc > 1 ? std::max(1, std::atoi(argv[1])) : 240,
                              argc > 2 ? argv[2] : "");
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "cuda_bench: %s\n", error.what());
    return 2;
  }
}
