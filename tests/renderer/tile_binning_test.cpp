/// @file
/// Tile lists against brute force, the strategies, slabs, and the limits of image size.

#include "renderer/internal/tile_binning.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <utility>

#include "core/frames.h"
#include "renderer/cpu_renderer.h"
#include "renderer/internal/projection_camera.h"
#include "renderer/reference_renderer.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using core::Frame;

std::shared_ptr<const SurfelCloud> shared(SurfelCloud cloud) {
  return std::make_shared<const SurfelCloud>(std::move(cloud));
}

Frame render_with(const std::shared_ptr<const SurfelCloud>& scene, const CameraPose& pose,
                  const CameraIntrinsics& camera, const RenderOptions& options) {
  return make_cpu_renderer(scene, options)->render(pose, camera, Channels::kAll);
}

/// (surfel, tile) pairs of a view.
using Pairs = std::set<std::pair<std::uint32_t, std::size_t>>;

Pairs binned_pairs(const SurfelCloud& cloud, const CameraPose& pose,
                   const CameraIntrinsics& camera, const RenderOptions& options) {
  const internal::PackedSurfels packed(cloud);
  internal::Workers workers(1);
  internal::ProjectedSurfels projected;
  const internal::ProjectionJob job{
      cloud,           packed,           internal::projection_camera<float>(pose, camera),
      camera.width_px, camera.height_px, options.near_m,
      false,           options.bounds};
  internal::find_visible_clusters(job, projected);
  const std::size_t clusters = projected.visible.size();
  internal::project_clusters(job, 0, clusters, workers, projected);
  internal::TileBins bins;
  bins.begin(camera.width_px, camera.height_px);
  bins.add_slab(projected, 0, clusters, std::numeric_limits<float>::infinity(), workers);
  Pairs pairs;
  for (std::size_t tile = 0; tile < bins.tile_count(); ++tile) {
    for (const std::uint32_t slot : bins.list(tile)) {
      pairs.emplace(projected.shade[slot].surfel, tile);
    }
  }
  return pairs;
}

/// rho of a surfel at image positions, in double.
class Exact {
 public:
  Exact(const SurfelCloud& cloud, std::size_t i, const CameraPose& pose,
        const CameraIntrinsics& camera, double near_m)
      : near_m_(near_m), k2(extent_squared(static_cast<double>(cloud.opacity[i]))) {
    const glm::dmat3 R = glm::mat3_cast(glm::dquat(cloud.R_world_surfel[i]));
    const glm::dvec3 p(cloud.position_m[i]);
    const glm::dvec3 u = R[0] * static_cast<double>(cloud.scale_m[i].x);
    const glm::dvec3 v = R[1] * static_cast<double>(cloud.scale_m[i].y);
    s_ = project_surfel<double>(internal::projection_camera<double>(pose, camera),
                                {p.x, p.y, p.z}, {u.x, u.y, u.z}, {v.x, v.y, v.z});
  }
  [[nodiscard]] bool drawn() const { return s_.z0_m > near_m_ && k2 > 0.0; }
  [[nodiscard]] bool crosses_near() const { return crosses_near_plane(s_, k2, near_m_); }
  [[nodiscard]] double rho(double x_px, double y_px) const {
    const double dx = x_px - s_.x0_px, dy = y_px - s_.y0_px;
    const double low_pass = 2.0 * (dx * dx + dy * dy);
    const double e = 1.0 - s_.g0 * dx - s_.g1 * dy;
    if (e <= 0.0 || s_.z0_m / e < near_m_) return low_pass;
    const double q_u = s_.m00 * dx + s_.m01 * dy, q_v = s_.m10 * dx + s_.m11 * dy;
    return std::min(low_pass, (q_u * q_u + q_v * q_v) / (e * e));
  }

 private:
  double near_m_;
  SurfelProjection<double> s_;

 public:
  double k2;
};

/// Least rho over the rectangle of pixel centres of a tile, on a grid of 1 / `per_px` px.
double least_rho(const Exact& surfel, int tile_x, int tile_y, int per_px) {
  double least = std::numeric_limits<double>::infinity();
  const int steps = (internal::kTileSizePx - 1) * per_px;
  for (int y = 0; y <= steps; ++y) {
    for (int x = 0; x <= steps; ++x) {
      const double step_px = 1.0 / per_px;
      least = std::min(least, surfel.rho(tile_x * internal::kTileSizePx + 0.5 + x * step_px,
                                         tile_y * internal::kTileSizePx + 0.5 + y * step_px));
    }
  }
  return least;
}

TEST(TileBins, AccuTileMissesNoPixelAndBinsAlmostNothingElse) {
  std::size_t binned = 0, unreached = 0;
  const CameraIntrinsics camera{160, 128, 150.0, 140.0, 78.3, 66.1};
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    const SurfelCloud cloud = testing::random_scene(seed + 40, 1000);
    const CameraPose pose = seed % 2 == 0 ? core::look_at({-4.5, 0.4, 1.0}, {0.0, 0.0, 0.0})
                                          : core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2});
    const RenderOptions options;
    const Pairs pairs = binned_pairs(cloud, pose, camera, options);
    const int tiles_x = 160 / 16, tiles_y = 128 / 16;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Exact surfel(cloud, i, pose, camera, options.near_m);
      if (!surfel.drawn()) continue;
      for (int tile = 0; tile < tiles_x * tiles_y; ++tile) {
        const bool listed = pairs.contains({static_cast<std::uint32_t>(i), tile});
        const int x = tile % tiles_x, y = tile / tiles_x;
        if (!listed) {
          // Pixel centres only: here no pair may be missing.
          EXPECT_GT(least_rho(surfel, x, y, 1), surfel.k2 * 0.9999) << i << " tile " << tile;
          continue;
        }
        if (surfel.crosses_near()) continue;  // Rare; these have the exact box only.
        ++binned;
        if (least_rho(surfel, x, y, 1) <= surfel.k2) continue;
        // sqrt(rho) grows by at most sqrt(2) a pixel, and the grid's points are at most
        // 0.0442 px from any other.
        const double reach = std::sqrt(surfel.k2) + 1.4143 * 0.0442;
        unreached += least_rho(surfel, x, y, 16) > reach * reach ? 1 : 0;
      }
    }
  }
  EXPECT_GT(binned, 3000U);
  EXPECT_LE(static_cast<double>(unreached), 0.005 * static_cast<double>(binned))
      << unreached << " of " << binned;
}

TEST(TileBins, StrategiesNestAndExactOnesDrawTheSamePicture) {
  const auto room = shared(testing::room_scene(0.12F));
  const CameraPose pose = core::look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(160, 120, 1.3);
  const auto render = [&](TileBounds bounds) {
    return render_with(room, pose, camera, {.bounds = bounds, .threads = 1});
  };
  const Frame rows = render(TileBounds::kAccuTile), box = render(TileBounds::kSnugBox);
  EXPECT_EQ(rows.rgb.pixels(), box.rgb.pixels());
  EXPECT_EQ(rows.semantic.pixels(), box.semantic.pixels());
  EXPECT_EQ(rows.stats.contributions, box.stats.contributions);
  EXPECT_LT(rows.stats.pairs_binned, box.stats.pairs_binned);
  const Pairs exact = binned_pairs(*room, pose, camera, {});
  const Pairs boxes = binned_pairs(*room, pose, camera, {.bounds = TileBounds::kSnugBox});
  EXPECT_TRUE(std::includes(boxes.begin(), boxes.end(), exact.begin(), exact.end()));
  const Frame square = render(TileBounds::kAabb), paper = render(TileBounds::kPaper);
  EXPECT_GT(square.stats.pairs_binned, box.stats.pairs_binned);
  EXPECT_GT(paper.stats.pairs_binned, rows.stats.pairs_binned / 2);
  EXPECT_NE(paper.stats.pairs_binned, rows.stats.pairs_binned);
}

TEST(CpuRendererProperties, HundredThousandRandomSurfels) {
  // So faint that none hides another: every one counts in the comparison.
  const CameraIntrinsics camera{40, 32, 36.0, 34.0, 19.3, 16.8};
  for (std::uint64_t seed = 0; seed < 25; ++seed) {
    SCOPED_TRACE(seed);
    SurfelCloud cloud = testing::random_scene(seed + 100, 4000);
    core::RandomStream random(seed, "faint");
    for (float& opacity : cloud.opacity) {
      // One in five at the threshold of visibility.
      opacity = static_cast<float>(random.chance(0.2) ? random.uniform(0.0039, 0.00395)
                                                      : random.uniform(0.004, 0.03));
    }
    const auto scene = shared(std::move(cloud));
    const CameraPose pose = seed % 2 == 0 ? core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2})
                                          : core::look_at({-2.5, 0.4, 1.0}, {0.0, 0.0, 0.0});
    const Frame expected =
        make_reference_renderer(scene, {})->render(pose, camera, Channels::kAll);
    const Frame frame = render_with(scene, pose, camera, {.threads = 1});
    const auto count = static_cast<double>(expected.stats.contributions);
    EXPECT_NEAR(static_cast<double>(frame.stats.contributions), count, 2e-4 * count + 2.0);
    for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
      // A surfel that passes the threshold differently changes alpha by 1/255.
      EXPECT_NEAR(frame.alpha.pixels()[i], expected.alpha.pixels()[i], 5e-3);
    }
    double off = 0.0;
    for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
      off += std::abs(frame.alpha.pixels()[i] - expected.alpha.pixels()[i]) > 5e-4F ? 1 : 0;
    }
    EXPECT_LE(off, 0.005 * static_cast<double>(frame.alpha.size()));
  }
}

/// Agreement of labels on all but a few pixels.
void expect_labels(const Frame& frame, const Frame& expected) {
  double off = 0.0, confidence_off = 0.0;
  for (std::size_t i = 0; i < frame.semantic.size(); ++i) {
    off += frame.semantic.pixels()[i] != expected.semantic.pixels()[i] ||
                   frame.instance.pixels()[i] != expected.instance.pixels()[i]
               ? 1
               : 0;
    confidence_off +=
        std::abs(frame.confidence.pixels()[i] - expected.confidence.pixels()[i]) > 2e-3F ? 1
                                                                                         : 0;
  }
  EXPECT_LE(off, 2e-3 * static_cast<double>(frame.semantic.size()));
  EXPECT_LE(confidence_off, 5e-3 * static_cast<double>(frame.semantic.size()));
}

TEST(CpuRendererProperties, BothReadingsOfTopKAndAllSurfels) {
  const auto scene = shared(testing::random_scene(3, 1200));
  const CameraPose pose = core::look_at({-4.0, 0.4, 1.0}, {0.0, 0.0, 0.0});
  const CameraIntrinsics camera{77, 61, 70.0, 64.0, 36.3, 31.8};
  for (const TopKRule rule : {TopKRule::kHeaviest, TopKRule::kFirst}) {
    for (const int top_k : {1, 3, 8, 16, kAllSurfels}) {
      SCOPED_TRACE(top_k);
      const RenderOptions options{.top_k = top_k, .top_k_rule = rule, .threads = 1};
      expect_labels(
          render_with(scene, pose, camera, options),
          make_reference_renderer(scene, options)->render(pose, camera, Channels::kAll));
    }
  }
}

TEST(CpuRendererProperties, LabelsAloneAreThoseOfAllChannels) {
  const auto room = shared(testing::room_scene(0.12F));
  const CameraPose pose = core::look_at({3.0, 2.5, 1.2}, {5.0, 4.0, 0.6});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(160, 120, 1.3);
  for (const int top_k : {1, 4, 8}) {
    const auto renderer = make_cpu_renderer(room, {.top_k = top_k, .threads = 1});
    const Frame all = renderer->render(pose, camera, Channels::kAll);
    const Frame labels = renderer->render(pose, camera, Channels::kLabels);
    EXPECT_EQ(labels.semantic.pixels(), all.semantic.pixels());
    EXPECT_EQ(labels.instance.pixels(), all.instance.pixels());
    EXPECT_EQ(labels.confidence.pixels(), all.confidence.pixels());
    EXPECT_LT(labels.stats.evaluations, all.stats.evaluations);
  }
}

TEST(CpuRendererSlabs, PictureIsThatOfTheReference) {
  // Three slabs and more.
  const auto room = shared(testing::room_scene(0.045F));
  const CameraPose pose = core::look_at({0.4, 0.4, 1.6}, {5.0, 4.0, 0.9});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(40, 30, 1.4);
  const Frame frame = render_with(room, pose, camera, {.threads = 2});
  const Frame expected =
      make_reference_renderer(room, {})->render(pose, camera, Channels::kAll);
  int off = 0;
  for (std::size_t i = 0; i < frame.rgb.size(); ++i) {
    const auto a = frame.rgb.pixels()[i], b = expected.rgb.pixels()[i];
    off +=
        std::max({std::abs(a.r - b.r), std::abs(a.g - b.g), std::abs(a.b - b.b)}) > 1 ? 1 : 0;
    EXPECT_NEAR(frame.alpha.pixels()[i], expected.alpha.pixels()[i], 1e-3);
  }
  EXPECT_LE(off, 2);
  expect_labels(frame, expected);
}

TEST(CpuRendererSlabs, WhatLiesBehindAWallIsNeitherProjectedNorBinned) {
  SurfelCloud near_wall;
  core::RandomStream random(5, "walls");
  const auto wall = [&](SurfelCloud& cloud, float x_m, std::uint16_t id) {
    testing::add_rectangle(cloud, random, {x_m, -2.0F, -2.0F}, {0.0F, 4.0F, 0.0F},
                           {0.0F, 0.0F, 4.0F}, 0.015F, id, id);
  };
  for (const float x_m : {2.0F, 2.02F, 2.04F}) wall(near_wall, x_m, 1);  // No light passes.
  SurfelCloud many = near_wall;
  for (int i = 0; i < 6; ++i) wall(many, 3.0F + 0.4F * static_cast<float>(i), 2);
  const CameraPose pose = core::look_at({0.0, 0.0, 0.0}, {1.0, 0.0, 0.0});
  const CameraIntrinsics camera = CameraIntrinsics::from_fov(96, 96, 0.9);
  const Frame one = render_with(shared(near_wall), pose, camera, {.threads = 1});
  const Frame all = render_with(shared(many), pose, camera, {.threads = 1});
  EXPECT_EQ(one.rgb.pixels(), all.rgb.pixels());
  EXPECT_EQ(one.alpha.pixels(), all.alpha.pixels());
  EXPECT_GT(one.stats.surfels_projected, 20000U);
  const std::size_t everything = binned_pairs(many, pose, camera, {}).size();
  EXPECT_LT(all.stats.pairs_binned, everything / 2);
}

TEST(CpuRendererLimits, OnePixelAndAHundredMillion) {
  SurfelCloud cloud;
  testing::add(cloud, {.position_m = {0.0F, 0.0F, 2.0F}, .opacity = 0.8F});
  const auto renderer = make_cpu_renderer(shared(cloud), {});
  const Frame one = renderer->render(CameraPose(), CameraIntrinsics{1, 1, 1.0, 1.0, 0.5, 0.5},
                                     Channels::kAll);
  ASSERT_EQ(one.alpha.size(), 1U);
  EXPECT_NEAR(one.alpha(0, 0), 0.8F, 1e-4F);
  EXPECT_NEAR(one.depth_m(0, 0), 2.0F, 1e-5F);
  const CameraIntrinsics large{10000, 10000, 5000.0, 5000.0, 5000.5, 5000.5};
  const Frame frame = renderer->render(CameraPose(), large, Channels::kNone);
  ASSERT_EQ(frame.alpha.size(), 100'000'000U);
  EXPECT_NEAR(frame.alpha(5000, 5000), 0.8F, 1e-4F);
  EXPECT_EQ(frame.alpha(9999, 9999), 0.0F);
  EXPECT_EQ(frame.alpha(0, 0), 0.0F);
}

TEST(CpuRendererLimits, NothingInView) {
  SurfelCloud cloud;
  testing::add(cloud, {.position_m = {0.0F, 0.0F, -2.0F}});
  const Frame frame = render_with(shared(cloud), CameraPose(),
                                  CameraIntrinsics{33, 17, 20.0, 20.0, 16.5, 8.5}, {});
  EXPECT_EQ(*std::max_element(frame.alpha.pixels().begin(), frame.alpha.pixels().end()), 0.0F);
  EXPECT_EQ(frame.stats.pairs_binned, 0U);
}

}  // namespace
}  // namespace segsim::renderer
