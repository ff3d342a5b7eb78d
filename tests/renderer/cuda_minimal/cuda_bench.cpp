/// @file
/// Frame times of the GPU renderer on the standard room, as docs/results/rendering.md has
/// them. The table goes to the error stream, a record for results/ to the output.
///
///     cuda_bench [frames [part]]      240 frames a row without; part: quick (no 5 M surfels,
///                                     no rooms, no K = 24), one (the first row),
///                                     batch (of 64), rooms (nine, eight of them behind
///                                     walls), top-k (labels and features of K surfels)

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/process/measurement_record.h"
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
  core::MeasurementGoal median_ms_goal{};     ///< Of one camera; a bar of 0: no goal.
  core::MeasurementGoal images_per_s_goal{};  ///< Of several.
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
/// @param features  Of the surfels stay, beside the field that is made of them.
BenchScene make_scene(int surfels, double spread, bool field, int rooms = 1,
                      bool features = false) {
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
  }
  if (!features) {
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

/// Of one row.
struct Figures {
  double median_ms = 0.0, p95_ms = 0.0, images_per_s = 0.0;
  double stage_ms[5] = {};  ///< begin, project, order, raster, again.
  /// Per frame, of all its images.
  double projected = 0.0, pairs = 0.0, touched = 0.0, evaluations = 0.0, fixed_tiles = 0.0;
  double whole_percent = 0.0;  ///< Share of frames without a tile drawn again.
};

Figures measure(const Row& row, int frames) {
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
  Figures figures;
  std::vector<double> wall_ms;
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
    figures.projected += static_cast<double>(stats.surfels_projected) / frames;
    figures.pairs += static_cast<double>(stats.pairs_binned) / frames;
    figures.touched += static_cast<double>(stats.pairs_touched) / frames;
    figures.evaluations += static_cast<double>(stats.evaluations) / frames;
    figures.fixed_tiles += static_cast<double>(gpu->fixed_tiles()) / frames;
    figures.whole_percent += gpu->fixed_tiles() == 0 ? 100.0 / frames : 0.0;
  }
  std::vector<double> stage[5];
  for (int frame = 0; frame < 24; ++frame) {
    set_poses(frames + kWarmUp + frame);
    gpu->render_batch(poses, camera, row.channels);
    const CudaStageTimes t = gpu->measure_stages();
    const double ms[5] = {t.begin_ms, t.project_ms, t.order_ms, t.raster_ms, t.redo_ms};
    for (int s = 0; s < 5; ++s) stage[s].push_back(ms[s]);
  }
  for (int s = 0; s < 5; ++s) figures.stage_ms[s] = quantile(stage[s], 0.5);
  figures.median_ms = quantile(wall_ms, 0.5);
  figures.p95_ms = quantile(wall_ms, 0.95);
  figures.images_per_s = 1e3 * row.cameras / figures.median_ms;
  return figures;
}

void print_row(const Row& row, const Figures& f) {
  const double per_image = 1e-6 / row.cameras;
  const double must_ms = row.images_per_s_goal.bar > 0.0
                             ? 1e3 * row.cameras / row.images_per_s_goal.bar
                             : row.median_ms_goal.bar;
  std::fprintf(stderr,
               "%-30s %-18s %4dx%-4d x%-3d %7.3f %7.3f %8.0f %6.3f | %5.3f %5.3f %5.3f %6.3f "
               "%5.3f | %6.3f %6.3f %6.2f %6.1f %5.0f %4.0f\n",
               row.name.c_str(), row.scene->name.c_str(), row.width_px, row.height_px,
               row.cameras, f.median_ms, f.p95_ms, f.images_per_s, must_ms, f.stage_ms[0],
               f.stage_ms[1], f.stage_ms[2], f.stage_ms[3], f.stage_ms[4],
               f.projected * per_image, f.pairs * per_image, f.touched * per_image,
               f.evaluations * per_image, f.fixed_tiles, f.whole_percent);
}

std::optional<core::MeasurementGoal> if_set(const core::MeasurementGoal& goal) {
  return goal.bar > 0.0 ? std::optional(goal) : std::nullopt;
}

void add_values(const Row& row, const Figures& f, core::MeasurementRecord& record) {
  const std::string name = row.name + ", " + row.scene->name + ", " +
                           (row.cameras > 1 ? std::to_string(row.cameras) + " x " : "") +
                           std::to_string(row.width_px) + "x" + std::to_string(row.height_px);
  const auto add = [&](const char* what, const char* unit, double value,
                       std::optional<core::MeasurementGoal> goal = {}) {
    record.values.push_back({name, what, unit, value, goal});
  };
  add("median", "ms", f.median_ms, if_set(row.median_ms_goal));
  add("p95", "ms", f.p95_ms);
  add("images/s", "", f.images_per_s, if_set(row.images_per_s_goal));
  add("begin", "ms", f.stage_ms[0]);
  add("project and bin", "ms", f.stage_ms[1]);
  add("order", "ms", f.stage_ms[2]);
  add("sort, blend, resolve", "ms", f.stage_ms[3]);
  add("drawn again", "ms", f.stage_ms[4]);
  add("pairs binned", "M", 1e-6 * f.pairs);
  add("pairs touched", "M", 1e-6 * f.touched);
  add("evaluations", "M", 1e-6 * f.evaluations);
}

using RunRow = std::function<void(const Row&)>;

/// What culling by termination depth is for: surfels behind walls.
void run_rooms(const BenchScene& rooms, const RunRow& run) {
  const Channels all = Channels::kAll;
  run({"rooms, no culling", &rooms, 1296, 968, all, 1, {.skip_hidden = false}});
  run({"rooms, culling if it pays", &rooms, 1296, 968});
  run({"rooms, always culling", &rooms, 1296, 968, all, 1, {}, {}, {}, true});
}

/// What K costs: labels of the field, and 48 channels of features.
void run_top_k(const BenchScene& scene, const RunRow& run) {
  const Channels features = Channels::kRgbd | Channels::kNormal | Channels::kFeatures;
  for (const int k : {1, 2, 3, 4, 8, 16, 24}) {
    const std::string name = "K = " + std::to_string(k);
    run({"labels, " + name, &scene, 1296, 968, Channels::kAll, 1, {.top_k = k}});
    run({"features, " + name, &scene, 1296, 968, features, 1, {.top_k = k}});
  }
  const RenderOptions first{.top_k = 24, .top_k_rule = TopKRule::kFirst};
  run({"labels, first 24", &scene, 1296, 968, Channels::kAll, 1, first});
  run({"features, first 24", &scene, 1296, 968, features, 1, first});
  run({"neither", &scene, 1296, 968, Channels::kRgbd | Channels::kNormal});
}

core::MeasurementGoal at_most(double bar, double aim) {
  return {core::MeasurementGoal::Kind::kAtMost, bar, aim};
}

core::MeasurementGoal at_least(double bar, double aim) {
  return {core::MeasurementGoal::Kind::kAtLeast, bar, aim};
}

std::vector<Row> standard_rows(const BenchScene& dense, const BenchScene& plain) {
  const Channels all = Channels::kAll, labels = Channels::kLabels;
  const Channels robot = Channels::kRgbd | Channels::kLabels;
  return {{"all outputs", &dense, 1296, 968, all, 1, {}, at_most(1.3, 0.55)},
          {"all outputs", &dense, 1280, 720, all, 1, {}, at_most(1.0, 0.4)},
          {"all outputs", &plain, 1280, 720, all, 1, {}, at_most(1.0, 0.4)},
          {"labels only", &dense, 1280, 720, labels, 1, {}, at_most(0.5, 0.2)},
          {"labels only", &plain, 1280, 720, labels, 1, {}, at_most(0.5, 0.2)},
          {"RGB, depth, labels", &plain, 256, 256, robot, 64, {}, {}, at_least(8000, 16000)},
          {"all outputs", &plain, 640, 480, all, 16, {}, {}, at_least(3000, 6000)},
          {"RGB, depth", &dense, 1296, 968, Channels::kRgbd},
          {"culling", &dense, 1296, 968, all, 1, {}, {}, {}, true},
          {"snug boxes", &dense, 1296, 968, all, 1, {.bounds = TileBounds::kSnugBox}},
          {"3-sigma squares",
           &dense,
           1296,
           968,
           all,
           1,
           {.bounds = TileBounds::kAabb, .skip_hidden = false}},
          {"no culling", &plain, 256, 256, robot, 64, {.skip_hidden = false}},
          {"no culling", &plain, 640, 480, all, 16, {.skip_hidden = false}},
          {"K = 1", &dense, 1296, 968, all, 1, {.top_k = 1}},
          {"K = 24", &dense, 1296, 968, all, 1, {.top_k = 24}},
          {"all outputs", &dense, 3840, 2160}};
}

void run_all(const std::string& part, const RunRow& run) {
  if (part == "rooms") return run_rooms(make_scene(500'000, 1.6, false, 9), run);
  if (part == "top-k") return run_top_k(make_scene(1'000'000, 1.6, true, 1, true), run);
  auto dense_later =
      std::async(std::launch::async, make_scene, 1'000'000, 1.6, true, 1, false);
  auto plain_later =
      std::async(std::launch::async, make_scene, 1'000'000, 1.0, true, 1, false);
  std::future<BenchScene> large_later, rooms_later;
  if (part.empty()) {
    rooms_later = std::async(std::launch::async, make_scene, 500'000, 1.6, false, 9, false);
    large_later = std::async(std::launch::async, make_scene, 5'000'000, 1.0, false, 1, false);
  }
  const BenchScene dense = dense_later.get(), plain = plain_later.get();
  for (const Row& row : standard_rows(dense, plain)) {
    if (part == "quick" && row.options.top_k > 4) continue;
    if (part == "batch" && row.cameras != 64) continue;
    run(row);
    if (part == "one") break;
  }
  if (!part.empty()) return;
  const BenchScene large = large_later.get();
  run({"all outputs", &large, 1280, 720});
  run({"no culling", &large, 1280, 720, Channels::kAll, 1, {.skip_hidden = false}});
  run({"all outputs", &large, 3840, 2160});
  run_rooms(rooms_later.get(), run);
}

void print_header() {
  std::fprintf(stderr,
               "%-30s %-18s %9s %4s %7s %7s %8s %6s | %5s %5s %5s %6s %5s | %6s %6s %6s %6s "
               "%5s %4s\n",
               "case", "scene", "size", "", "median", "p95", "image/s", "must", "begin",
               "proj", "order", "raster", "redo", "M surf", "M pair", "M touch", "M eval",
               "fixed", "%0");
}

}  // namespace
}  // namespace segsim::renderer

int main(int argc, char** argv) {
  using namespace segsim::renderer;
  try {
    const int frames = argc > 1 ? std::max(1, std::atoi(argv[1])) : 240;
    segsim::core::MeasurementRecord record{"Frames on the GPU", true, {}};
    print_header();
    run_all(argc > 2 ? argv[2] : "", [&](const Row& row) {
      const Figures figures = measure(row, frames);
      print_row(row, figures);
      add_values(row, figures, record);
    });
    std::fputs(segsim::core::record_text(record).c_str(), stdout);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "cuda_bench: %s\n", error.what());
    return 2;
  }
}
