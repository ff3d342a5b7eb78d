/// @file
/// 10^5 pictures of one surfel each, of every awkward kind, pixel by pixel against double
/// precision.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>

#include "renderer/cpu_renderer.h"
#include "tests/renderer/awkward_surfels.h"
#include "tests/renderer/blending_oracle.h"
#include "tests/renderer/scenes.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using core::Frame;

constexpr int kCases = 104000;

/// Four tiles, the last ones cut by the image's edge.
const CameraIntrinsics kCamera{30, 23, 27.0, 25.0, 14.6, 11.2};

/// Puts the disc's centre on the ray of a pixel's centre, where alpha is the opacity.
void snap_to_pixel(testing::AwkwardDisc& disc) {
  const glm::dvec2 px = glm::floor(kCamera.project(disc.centre_m)) + 0.5;
  disc.centre_m = kCamera.back_project(px, disc.centre_m.z);
}

std::shared_ptr<const SurfelCloud> scene_of(const testing::AwkwardDisc& disc) {
  SurfelCloud cloud;
  testing::Surfel surfel;
  surfel.position_m = glm::vec3(disc.centre_m);
  surfel.R_world_surfel = glm::quat(glm::quat_cast(glm::dmat3(disc.u, disc.v, disc.normal)));
  surfel.scale_m = {static_cast<float>(disc.scale_u_m), static_cast<float>(disc.scale_v_m)};
  surfel.opacity = static_cast<float>(disc.opacity);
  testing::add(cloud, surfel);
  return std::make_shared<const SurfelCloud>(std::move(cloud));
}

/// Worst disagreement of a kind, and how much there was to disagree about.
struct Tally {
  double alpha = 0.0, relative_alpha = 0.0, depth = 0.0, normal = 0.0;
  int pixels = 0, surfaces = 0, undecided = 0;
};

/// @return  False if a pixel is hit that must not be, or the other way round.
bool compare_pixel(const internal::ReferenceSurfel& surfel, const Frame& frame, int x, int y,
                   Tally& tally) {
  const testing::RayHit expected =
      testing::hit_of(surfel, kCamera, {x + 0.5, y + 0.5}, RenderOptions{}.near_m);
  const auto alpha = static_cast<double>(frame.alpha(x, y));
  tally.undecided += expected.certain ? 0 : 1;
  if ((alpha > 0.0) != expected.visible()) return !expected.certain;
  if (alpha == 0.0 || !expected.certain) return true;
  ++tally.pixels;
  tally.alpha = std::max(tally.alpha, std::abs(alpha - expected.alpha));
  tally.relative_alpha =
      std::max(tally.relative_alpha, std::abs(alpha / expected.alpha - 1.0));
  if (alpha < 0.5 || expected.alpha < 0.5) return true;
  ++tally.surfaces;
  const double depth_m = static_cast<double>(frame.depth_m(x, y));
  tally.depth = std::max(tally.depth, std::abs(depth_m / expected.depth_m - 1.0));
  // Which side of an edge-on surfel faces the camera, nobody can tell.
  if (surfel.edge_on) return true;
  const glm::dvec3 normal_off = glm::dvec3(frame.normal(x, y)) - surfel.normal_world;
  tally.normal = std::max(tally.normal, glm::length(normal_off));
  return true;
}

TEST(OneSurfel, HundredThousandPicturesAreThoseOfDoublePrecision) {
  core::RandomStream random(3, "one_surfel");
  std::array<Tally, testing::kAwkwardKinds> tallies{};
  Frame frame;
  for (int i = 0; i < kCases; ++i) {
    const auto kind = static_cast<testing::AwkwardKind>(i % testing::kAwkwardKinds);
    testing::AwkwardDisc disc = testing::random_awkward_disc(random, kind);
    if (kind == testing::kFaint) snap_to_pixel(disc);
    const auto scene = scene_of(disc);
    const testing::BlendingOracle oracle(scene, CameraPose(), kCamera);
    make_cpu_renderer(scene, {.threads = 1})
        ->render(CameraPose(), kCamera, Channels::kDepth | Channels::kNormal, frame);
    Tally& tally = tallies[kind];
    if (oracle.surfels().sorted().empty()) {
      ASSERT_EQ(frame.stats.contributions, 0U) << "case " << i << " kind " << kind;
      continue;
    }
    const internal::ReferenceSurfel& surfel = oracle.surfels().sorted().front();
    for (int y = 0; y < kCamera.height_px; ++y) {
      for (int x = 0; x < kCamera.width_px; ++x) {
        ASSERT_TRUE(compare_pixel(surfel, frame, x, y, tally))
            << "case " << i << " kind " << kind << " pixel " << x << " " << y << " alpha "
            << frame.alpha(x, y);
      }
    }
  }
  double worst_alpha = 0.0;
  for (int kind = 0; kind < testing::kAwkwardKinds; ++kind) {
    SCOPED_TRACE(kind);
    const Tally& tally = tallies[kind];
    EXPECT_LT(tally.alpha, 5e-4);
    // Discs of 1 : 1000 have no digits to spare.
    EXPECT_LT(tally.relative_alpha, kind == testing::kSlender ? 1e-2 : 2e-3);
    EXPECT_LT(tally.depth, 2e-4);
    EXPECT_LT(tally.normal, 1e-6);
    if (kind == testing::kBehind) continue;  // None is drawn.
    EXPECT_GT(tally.pixels, kind == testing::kFaint ? 3000 : 100000);
    EXPECT_LT(tally.undecided, kind == testing::kFaint ? 1000 : 100);
    EXPECT_GE(tally.surfaces, kind == testing::kFaint ? 0 : 4000);
    worst_alpha = std::max(worst_alpha, tally.alpha);
  }
  RecordProperty("worst_alpha_1e-6", std::to_string(1e6 * worst_alpha));
}

}  // namespace
}  // namespace segsim::renderer
