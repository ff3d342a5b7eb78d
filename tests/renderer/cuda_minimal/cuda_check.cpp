/// @file
/// Compares frames of the GPU with the double-precision reference renderer, in scenes that
/// meet every rule of the picture. A test program of its own, because the machine that it runs
/// on has no test framework. Exit code 1 if a case fails.

#include <cstdio>
#include <cstring>
#include <exception>
#include <functional>
#include <future>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "core/frames.h"
#include "renderer/cuda/cuda_renderer.h"
#include "renderer/internal/reference_resolve.h"
#include "renderer/internal/reference_surfels.h"
#include "renderer/reference_renderer.h"
#include "renderer/scene/room_scene.h"
#include "tests/renderer/cuda_minimal/frame_difference.h"
#include "tests/renderer/cuda_minimal/gpu_needed.h"
#include "tests/renderer/panoptic_scenes.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using core::Frame;
using core::look_at;
using testing::add;
using testing::Surfel;

/// Not a multiple of the tile, principal point off the centre, pixels not square.
const CameraIntrinsics kOddCamera{77, 61, 70.0, 64.0, 36.3, 31.8};

struct Case {
  std::string name;
  std::shared_ptr<const SurfelCloud> scene;
  CameraPose pose;
  CameraIntrinsics camera = kOddCamera;
  RenderOptions options{};
  Channels channels = Channels::kAll;
  std::shared_ptr<const PanopticField> field{};
};

std::shared_ptr<const SurfelCloud> shared(SurfelCloud cloud) {
  return std::make_shared<const SurfelCloud>(std::move(cloud));
}

/// Faint discs one behind the other before one tile: lists longer than any buffer.
SurfelCloud stack(int count, float opacity) {
  core::RandomStream random(5, "stack");
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    const auto u = [&] { return static_cast<float>(random.uniform()); };
    Surfel s;
    s.position_m = {u() - 0.5F, u() - 0.5F, 2.0F + 6.0F * u()};
    s.scale_m = {0.05F + 0.2F * u(), 0.05F + 0.2F * u()};
    s.R_world_surfel = testing::random_rotation(random);
    s.opacity = opacity * (0.5F + u());
    s.colour = {u(), u(), u()};
    s.semantic = static_cast<std::uint16_t>(random.index(5));
    s.instance = static_cast<std::uint16_t>(random.index(9));
    add(cloud, s);
  }
  return cloud;
}

/// Discs at exactly one depth: their index decides.
SurfelCloud ties(int count) {
  core::RandomStream random(6, "ties");
  SurfelCloud cloud;
  for (int i = 0; i < count; ++i) {
    const auto u = [&] { return static_cast<float>(random.uniform()); };
    add(cloud, {.position_m = {u() - 0.5F, u() - 0.5F, 2.0F},
                .scale_m = glm::vec2(0.05F + 0.1F * u()),
                .opacity = 0.05F + 0.5F * u(),
                .colour = {u(), u(), u()},
                .semantic = static_cast<std::uint16_t>(i % 7),
                .instance = static_cast<std::uint16_t>(i % 3)});
  }
  return cloud;
}

/// Opacities about the threshold of 1/255, and discs that fill the view or cross the camera.
SurfelCloud extremes() {
  SurfelCloud cloud = testing::random_scene(21, 600);
  core::RandomStream random(21, "extremes");
  for (int i = 0; i < 300; ++i) {
    const auto u = [&] { return static_cast<float>(random.uniform()); };
    Surfel s;
    s.position_m = {4.0F * u() - 2.0F, 4.0F * u() - 2.0F, 4.0F * u() - 2.0F};
    s.R_world_surfel = testing::random_rotation(random);
    const int kind = i % 3;
    s.scale_m = kind == 0 ? glm::vec2(3.0F * u() + 0.5F) : glm::vec2(0.2F * u() + 0.001F);
    if (kind == 1) s.scale_m.y = 1e-4F;  // A thread.
    s.opacity = kind == 2 ? (0.9F + 0.2F * u()) / 255.0F : 0.3F * u() + 0.01F;
    s.colour = {u(), u(), u()};
    add(cloud, s);
  }
  return cloud;
}

SurfelCloud with_sh(SurfelCloud cloud, int degree) {
  core::RandomStream random(1, "sh");
  cloud.sh_degree = degree;
  const std::size_t n = cloud.sh_count();
  std::vector<glm::vec3> sh(cloud.size() * n);
  for (std::size_t i = 0; i < sh.size(); ++i) {
    const auto normal = [&] { return 0.3F * static_cast<float>(random.normal()); };
    const float r = normal(), g = normal(), b = normal();
    sh[i] = i % n == 0 ? cloud.sh[i / n] : glm::vec3(r, g, b);
  }
  cloud.sh = sh;
  return cloud;
}

/// Dense sums of a field's rows in double precision, pixel by pixel.
void write_field_labels(const Case& c, Frame& frame) {
  const internal::ReferenceSurfels surfels(*c.scene, c.options, c.pose, c.camera);
  for (int y = 0; y < c.camera.height_px; ++y) {
    for (int x = 0; x < c.camera.width_px; ++x) {
      frame.semantic(x, y) = frame.instance(x, y) = 0;
      frame.confidence(x, y) = frame.instance_confidence(x, y) = 0.0F;
      std::vector<internal::ReferenceWeight> met;
      double left = 1.0;
      for (const internal::ReferenceSurfel& s : surfels.sorted()) {
        const double alpha = surfels.meet(s, {x + 0.5, y + 0.5}).alpha;
        if (alpha == 0.0) continue;
        if (left * (1.0 - alpha) < static_cast<double>(kStopTransmittance)) break;
        met.push_back({left * alpha, s.index});
        left *= 1.0 - alpha;
      }
      if (1.0 - left < 0.5) continue;
      const auto selected = internal::select_top_k(met, c.options);
      double total = 0.0, base = 0.0;
      std::vector<double> classes(c.field->class_id.size() + 1);
      std::vector<double> queries(c.field->instance_id.size() + 1);
      for (const auto& [weight, i] : selected) {
        total += weight;
        base += weight * static_cast<double>(c.field->instances.base(i));
        for (const auto& e : c.field->classes.row(i)) {
          classes[e.index] += weight * static_cast<double>(e.excess);
        }
        for (const auto& e : c.field->instances.row(i)) {
          queries[e.index] += weight * static_cast<double>(e.excess);
        }
      }
      const auto best = [](const std::vector<double>& v) {
        return static_cast<std::size_t>(std::max_element(v.begin(), v.end()) - v.begin());
      };
      const std::size_t at = best(classes), query = best(queries);
      if (classes[at] > 0.0) {
        frame.semantic(x, y) = c.field->class_id[at];
        frame.confidence(x, y) = static_cast<float>(classes[at] / total);
        if (c.field->class_is_thing[at] == 0) {
          frame.instance_confidence(x, y) = frame.confidence(x, y);
          continue;
        }
      }
      if (!(queries[query] > 0.0)) continue;
      frame.instance(x, y) = c.field->instance_id[query];
      frame.instance_confidence(x, y) = static_cast<float>((base + queries[query]) / total);
    }
  }
}

Frame reference_of(const Case& c) {
  Frame frame =
      make_reference_renderer(c.scene, c.options)->render(c.pose, c.camera, c.channels);
  if (c.field) write_field_labels(c, frame);
  return frame;
}

std::vector<Case> make_cases() {
  std::vector<Case> cases;
  const CameraPose outside = look_at({-4.5, 0.4, 1.0}, {0.0, 0.0, 0.0});
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    cases.push_back({"outside " + std::to_string(seed),
                     shared(testing::random_scene(seed, 1500)), outside});
    cases.push_back({"inside " + std::to_string(seed),
                     shared(testing::random_scene(10 + seed, 1500)),
                     look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2})});
  }
  const auto room = shared(testing::room_scene(0.12F));
  const CameraIntrinsics wide = CameraIntrinsics::from_fov(96, 72, 1.3);
  const CameraPose in_room = look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6});
  cases.push_back({"room", room, in_room, wide});
  cases.push_back({"along a wall", room, look_at({2.0, 0.3, 1.5}, {5.0, 0.1, 1.2}), wide});
  cases.push_back({"expected depth", room, in_room, wide, {.depth = DepthMode::kExpected}});
  cases.push_back({"distant room", shared(testing::room_scene(0.15F, 3)),
                   look_at({-30.0, -20.0, 12.0}, {3.0, 2.5, 1.0}),
                   CameraIntrinsics::from_fov(80, 60, 0.4)});
  RoomSceneOptions dense;
  dense.surfel_count = 20'000;
  dense.spread = 1.6;
  cases.push_back({"bench room", shared(make_room_scene(dense)), room_camera_ring(8)[3],
                   room_camera(96, 72)});
  const auto any = shared(testing::random_scene(3, 1200));
  for (const int k : {1, 2, 3, 5, 8, 24}) {
    cases.push_back({"top " + std::to_string(k), any, outside, kOddCamera, {.top_k = k}});
  }
  for (const int k : {1, 4, 8}) {
    cases.push_back({"first " + std::to_string(k),
                     any,
                     outside,
                     kOddCamera,
                     {.top_k = k, .top_k_rule = TopKRule::kFirst}});
  }
  cases.push_back({"snug boxes", any, outside, kOddCamera, {.bounds = TileBounds::kSnugBox}});
  cases.push_back(
      {"3-sigma squares", any, outside, kOddCamera, {.bounds = TileBounds::kAabb}});
  cases.push_back(
      {"paper's bounds", any, outside, kOddCamera, {.bounds = TileBounds::kPaper}});
  cases.push_back({"no surfels", shared(SurfelCloud{}), CameraPose()});
  cases.push_back({"extremes", shared(extremes()), look_at({0.1, 0.2, 0.0}, {1.0, 0.5, 0.1})});
  for (const int degree : {1, 3}) {
    cases.push_back({"harmonics " + std::to_string(degree),
                     shared(with_sh(testing::random_scene(4, 600, 0.5F), degree)), outside});
  }
  const CameraIntrinsics narrow{40, 36, 60.0, 60.0, 20.0, 18.0};
  cases.push_back({"stack of 3000", shared(stack(3000, 0.05F)), CameraPose(), narrow});
  cases.push_back({"stack of 12000", shared(stack(12000, 0.02F)), CameraPose(), narrow});
  cases.push_back({"ties", shared(ties(5000)), CameraPose(), narrow});
  // Keys in shared memory that outlive a part of a list, and more labels in a pixel than its
  // table holds.
  const auto long_stack = shared(stack(12000, 0.02F));
  cases.push_back({"stack, top 24", long_stack, CameraPose(), narrow, {.top_k = 24}});
  cases.push_back({"stack, first 24",
                   long_stack,
                   CameraPose(),
                   narrow,
                   {.top_k = 24, .top_k_rule = TopKRule::kFirst}});
  cases.push_back({"ties, top 24", shared(ties(5000)), CameraPose(), narrow, {.top_k = 24}});
  SurfelCloud motley = stack(3000, 0.1F);
  for (std::size_t i = 0; i < motley.size(); ++i) {
    motley.semantic_id[i] = static_cast<std::uint16_t>(1 + i % 500);
  }
  cases.push_back({"500 labels, top 24", shared(motley), CameraPose(), narrow, {.top_k = 24}});
  SurfelCloud featured = testing::random_scene(8, 1200, 0.3F);
  testing::add_random_features(featured, 8);
  const auto features = shared(std::move(featured));
  for (const int k : {4, 24}) {
    cases.push_back({"features, top " + std::to_string(k),
                     features,
                     outside,
                     kOddCamera,
                     {.top_k = k},
                     Channels::kAll | Channels::kFeatures});
  }
  for (const int k : {3, 4, 8, 24}) {
    cases.push_back({"64 queries, top " + std::to_string(k),
                     features,
                     outside,
                     kOddCamera,
                     {.top_k = k},
                     Channels::kAll,
                     std::make_shared<const PanopticField>(
                         fold_panoptic_model(*features, testing::random_model(9, 12, 64)))});
  }
  cases.push_back({"colour only", any, outside, kOddCamera, {}, Channels::kRgb});
  cases.push_back({"depth only", any, outside, kOddCamera, {}, Channels::kDepth});
  SurfelCloud one;
  add(one, {.position_m = {0.0F, 0.0F, 2.0F}});
  cases.push_back(
      {"one surfel", shared(one), CameraPose(), CameraIntrinsics{1, 1, 5, 5, 0.5, 0.5}});
  return cases;
}

/// @param few  Every fourth case, and the longest lists: for the slow tools.
int check_cases(bool few) {
  std::vector<Case> cases;
  for (const Case& c : make_cases()) {
    const bool kept =
        !few || c.name == "stack of 12000" || std::hash<std::string>{}(c.name) % 4 == 0;
    if (kept) cases.push_back(c);
  }
  std::vector<std::future<Frame>> references;
  for (const Case& c : cases) {
    references.push_back(std::async(std::launch::async, [&c] { return reference_of(c); }));
  }
  int failed = 0;
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const Case& c = cases[i];
    const auto gpu = make_cuda_renderer(c.scene, c.options, c.field);
    gpu->count_contributions(true);
    Frame frame, again;
    gpu->render(c.pose, c.camera, c.channels, frame);
    gpu->poison_images();
    gpu->render(c.pose, c.camera, c.channels, frame);
    gpu->render(c.pose, c.camera, c.channels, again);
    const Frame reference = references[i].get();
    const testing::FrameDifference d = testing::difference(frame, reference);
    const double counted = static_cast<double>(frame.stats.contributions);
    const double expected = static_cast<double>(reference.stats.contributions);
    const bool counts = std::abs(counted - expected) <= 1e-3 * expected + 2.0;
    const bool same = frame.rgb.pixels() == again.rgb.pixels() &&
                      frame.alpha.pixels() == again.alpha.pixels() &&
                      frame.semantic.pixels() == again.semantic.pixels() &&
                      frame.instance.pixels() == again.instance.pixels();
    const bool passes = d.passes() && counts && same;
    failed += passes ? 0 : 1;
    std::printf("%s %-20s %s  contributions %.0f of %.0f%s\n", passes ? "ok  " : "FAIL",
                c.name.c_str(), d.text().c_str(), counted, expected,
                same ? "" : "  NOT REPEATABLE");
  }
  return failed;
}

template <class Image>
bool same_bytes(const Image& a, const Image& b) {
  return a.size() == b.size() &&
         (a.size() == 0 || std::memcmp(a.data(), b.data(), a.size() * sizeof(*a.data())) == 0);
}

bool same_frames(const Frame& a, const Frame& b, bool alpha = true) {
  return same_bytes(a.rgb, b.rgb) && (!alpha || same_bytes(a.alpha, b.alpha)) &&
         same_bytes(a.depth_m, b.depth_m) && same_bytes(a.normal, b.normal) &&
         same_bytes(a.semantic, b.semantic) && same_bytes(a.instance, b.instance) &&
         same_bytes(a.confidence, b.confidence) &&
         same_bytes(a.instance_confidence, b.instance_confidence);
}

/// A walk with smooth stretches and sudden jumps, and surfaces of every distance.
CameraPose random_walk_pose(core::RandomStream& random, int step, double& heading_rad,
                            glm::dvec3& eye_m) {
  if (step % 97 == 0) {
    eye_m = {random.uniform(1.0, 7.0), random.uniform(1.0, 5.0), random.uniform(0.5, 2.3)};
    heading_rad = random.uniform(0.0, 2.0 * std::numbers::pi);
  }
  heading_rad += 0.06 * random.normal();
  const glm::dvec3 ahead{std::cos(heading_rad), std::sin(heading_rad), 0.1 * random.normal()};
  eye_m += 0.03 * ahead + 0.01 * glm::dvec3(random.normal(), random.normal(), random.normal());
  eye_m = glm::clamp(eye_m, glm::dvec3(0.4), kRoomSize_m - 0.4);
  return look_at(eye_m, eye_m + ahead);
}

/// Frames with termination-depth culling equal frames without, bit by bit.
int check_culling(int frames) {
  RoomSceneOptions options;
  options.surfel_count = 200'000;
  options.spread = 1.6;
  const auto scene = shared(make_room_scene(options));
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(237, 171, 1.2);
  const auto culled = make_cuda_renderer(scene);
  const auto whole = make_cuda_renderer(scene, {.skip_hidden = false});
  culled->always_skip_hidden(true);
  core::RandomStream random(3, "culling");
  double heading_rad = 0.0;
  glm::dvec3 eye_m(0.0);
  Frame a, b;
  int different = 0;
  double fixed = 0.0, pairs = 0.0, all_pairs = 0.0;
  for (int i = 0; i < frames; ++i) {
    const CameraPose pose = random_walk_pose(random, i, heading_rad, eye_m);
    const Channels channels = i / 500 % 2 == 0 ? Channels::kAll : Channels::kLabels;
    culled->render(pose, camera, channels, a);
    whole->render(pose, camera, channels, b);
    // A frame of labels alone ends once its labels are final: when exactly it notices, and so
    // its alpha, is not promised.
    different += same_frames(a, b, channels != Channels::kLabels) ? 0 : 1;
    fixed += culled->fixed_tiles();
    pairs += static_cast<double>(a.stats.pairs_binned);
    all_pairs += static_cast<double>(b.stats.pairs_binned);
  }
  std::printf(
      "%s culling: %d of %d frames differ; %.1f tiles a frame drawn again; %.0f of "
      "%.0f pairs\n",
      different == 0 ? "ok  " : "FAIL", different, frames, fixed / frames, pairs / frames,
      all_pairs / frames);
  return different == 0 ? 0 : 1;
}

/// A batch equals its views one by one.
int check_batch() {
  RoomSceneOptions options;
  options.surfel_count = 100'000;
  const auto scene = shared(make_room_scene(options));
  const CameraIntrinsics camera = room_camera(160, 120);
  const std::vector<CameraPose> poses = room_camera_ring(40);
  const auto batch = make_cuda_renderer(scene), single = make_cuda_renderer(scene);
  batch->always_skip_hidden(true);
  int different = 0;
  for (int round = 0; round < 2; ++round) {
    batch->render_batch(poses, camera, Channels::kAll);
    Frame a, b;
    for (int i = 0; i < 40; ++i) {
      batch->read_back(i, Channels::kAll, a);
      single->render(poses[static_cast<std::size_t>(i)], camera, Channels::kAll, b);
      different += same_frames(a, b) ? 0 : 1;
    }
  }
  std::printf("%s batch: %d of 80 images differ\n", different == 0 ? "ok  " : "FAIL",
              different);
  return different == 0 ? 0 : 1;
}

/// Images that do not fit are refused by name, and the renderer stays good for others.
int check_full_memory() {
  const auto scene = shared(testing::random_scene(1, 500));
  const auto gpu = make_cuda_renderer(scene);
  const CameraPose pose = look_at({-4.5, 0.4, 1.0}, {0.0, 0.0, 0.0});
  std::string message;
  try {
    const CameraIntrinsics huge = CameraIntrinsics::from_fov(65535, 65535, 1.0);
    const std::vector<CameraPose> poses(16, pose);
    gpu->render_batch(poses, huge, Channels::kAll);
    gpu->wait();
  } catch (const GpuError& error) {
    message = error.what();
  }
  Frame frame, expected;
  gpu->render(pose, kOddCamera, Channels::kAll, frame);
  make_cuda_renderer(scene)->render(pose, kOddCamera, Channels::kAll, expected);
  const bool passes =
      message.find("MiB free") != std::string::npos && same_frames(frame, expected);
  std::printf("%s full memory: %s\n", passes ? "ok  " : "FAIL", message.c_str());
  return passes ? 0 : 1;
}

}  // namespace
}  // namespace segsim::renderer

/// @param argv  Frames of the culling test (300 without), and "few" for a part of the cases.
/// @return  0 if all is well, 1 if not; exit_code_without_gpu() if there is no GPU to ask.
int main(int argc, char** argv) {
  using namespace segsim::renderer;
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  try {
    (void)make_cuda_renderer(shared(stack(1, 0.5F)));
  } catch (const GpuError& error) {
    return exit_code_without_gpu("cuda_check", error.what());
  }
  try {
    const int frames = argc > 1 ? std::atoi(argv[1]) : 300;
    int failed = check_cases(argc > 2 && std::string(argv[2]) == "few");
    failed += check_batch();
    failed += check_full_memory();
    failed += check_culling(frames);
    std::printf("%d failed\n", failed);
    return failed == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "cuda_check: %s\n", error.what());
    return 1;
  }
}
