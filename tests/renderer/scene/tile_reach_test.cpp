/// @file
/// Tile lists of 10^5 awkward surfels and of rooms: AccuTile lists every tile that a surfel
/// reaches with a pixel centre, and hardly another.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "renderer/scene/room_scene.h"
#include "tests/renderer/awkward_surfels.h"
#include "tests/renderer/blending_oracle.h"
#include "tests/renderer/scenes.h"
#include "tests/renderer/view_stages.h"

namespace segsim::renderer {
namespace {

using core::CameraIntrinsics;
using core::CameraPose;
using core::Channels;
using internal::ReferenceSurfel;
using testing::ViewStages;

Vec3<double> vec(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

/// A surfel's reach on the screen in double precision.
class Reach {
 public:
  Reach(const ReferenceSurfel& surfel, const CameraIntrinsics& camera, double near_m)
      : surfel_(surfel), camera_(camera), near_m_(near_m) {
    const ProjectionCamera<double> unit{{1, 0, 0},    {0, 1, 0},    {0, 0, 1},
                                        {0, 0, 0},    camera.fx_px, camera.fy_px,
                                        camera.cx_px, camera.cy_px};
    const auto s =
        project_surfel<double>(unit, vec(surfel.centre_m), vec(surfel.u_m), vec(surfel.v_m));
    clipped_ = crosses_near_plane(s, surfel.k2, near_m);
    if (!clipped_) outline_ = outline_of_disc(s, surfel.k2);
    box_ = with_low_pass(
        clipped_ ? box_of_clipped_disc(s, surfel.k2, near_m) : box_of(outline_), s, surfel.k2);
  }
  [[nodiscard]] bool clipped() const { return clipped_; }

  /// The surfel is seen for certain at some pixel centre of the tile.
  [[nodiscard]] bool certainly_hits(int tile_x, int tile_y) const {
    const int x0 = tile_x * internal::kTileSizePx, y0 = tile_y * internal::kTileSizePx;
    const int x1 = std::min(x0 + internal::kTileSizePx, camera_.width_px) - 1;
    const int y1 = std::min(y0 + internal::kTileSizePx, camera_.height_px) - 1;
    for (int y = std::max(y0, whole(box_.y_min_px) - 1);
         y <= std::min(y1, whole(box_.y_max_px) + 1); ++y) {
      for (int x = std::max(x0, whole(box_.x_min_px) - 1);
           x <= std::min(x1, whole(box_.x_max_px) + 1); ++x) {
        const testing::RayHit hit =
            testing::hit_of(surfel_, camera_, {x + 0.5, y + 0.5}, near_m_);
        if (hit.certain && hit.visible()) return true;
      }
    }
    return false;
  }

  /// The surfel is seen somewhere between the tile's outermost pixel centres, by samples a
  /// third of a pixel apart.
  [[nodiscard]] bool sampled_in(int tile_x, int tile_y) const {
    constexpr int kSteps = 3 * (internal::kTileSizePx - 1);
    const glm::dvec2 first(tile_x * internal::kTileSizePx + 0.5,
                           tile_y * internal::kTileSizePx + 0.5);
    for (int y = 0; y <= kSteps; ++y) {
      for (int x = 0; x <= kSteps; ++x) {
        const glm::dvec2 px = first + glm::dvec2(x, y) / 3.0;
        if (testing::hit_of(surfel_, camera_, px, near_m_).visible()) return true;
      }
    }
    return false;
  }

  /// Outline or low pass meet the rectangle between the tile's outermost pixel centres,
  /// within rounding. For surfels before the near plane.
  [[nodiscard]] bool meets_rectangle(int tile_x, int tile_y) const {
    const double x_lo = tile_x * internal::kTileSizePx + 0.5, x_hi = x_lo + 15.0;
    const double y_lo = tile_y * internal::kTileSizePx + 0.5, y_hi = y_lo + 15.0;
    const glm::dvec2 nearest =
        glm::clamp(surfel_.low_pass_px, glm::dvec2(x_lo, y_lo), glm::dvec2(x_hi, y_hi));
    const double low_pass_px = std::sqrt(0.5 * surfel_.k2) + kRoundingPx;
    if (glm::length(nearest - surfel_.low_pass_px) <= low_pass_px) return true;
    const auto span =
        columns_in_band(outline_, 1e9, 1e9, 0.0, y_lo - kRoundingPx, y_hi + kRoundingPx);
    return span.x_min_px <= x_hi + kRoundingPx && span.x_max_px >= x_lo - kRoundingPx;
  }

 private:
  /// Of float outlines, which are right to 1e-3 px (surfel_outline_test).
  static constexpr double kRoundingPx = 2e-3;

  static int whole(double px) { return static_cast<int>(std::clamp(px, -1e6, 1e6)); }

  const ReferenceSurfel& surfel_;
  const CameraIntrinsics& camera_;
  double near_m_;
  bool clipped_ = false;
  ScreenEllipse<double> outline_{};
  ScreenBox<double> box_{};
};

struct Tally {
  std::size_t hits = 0, missed = 0;   ///< Tiles with a certain pixel; not listed.
  std::size_t pairs = 0;              ///< Listed.
  std::size_t unreached = 0;          ///< Listed, though the rectangle is out of reach.
  std::size_t clipped = 0;            ///< Listed for surfels that cross the near plane.
  std::size_t clipped_unreached = 0;  ///< The same of these.
};

/// @param samples_clipped  Also count clipped_unreached, which is slow.
Tally tally_of(const std::shared_ptr<const SurfelCloud>& cloud, const CameraPose& pose,
               const CameraIntrinsics& camera, bool samples_clipped) {
  const RenderOptions options;
  ViewStages stages(cloud, pose, camera, options);
  stages.project();
  stages.list();
  const internal::ReferenceSurfels surfels(*cloud, options, pose, camera);
  const auto tiles_x = static_cast<std::size_t>(stages.bins.tiles_x());
  const testing::Pairs pairs = stages.pairs();
  Tally tally;
  tally.pairs = pairs.size();
  std::vector<std::uint8_t> listed(stages.bins.tile_count());
  for (const ReferenceSurfel& surfel : surfels.sorted()) {
    const Reach reach(surfel, camera, options.near_m);
    const auto id = static_cast<std::uint32_t>(surfel.index);
    std::fill(listed.begin(), listed.end(), 0);
    for (auto at = pairs.lower_bound({id, 0}); at != pairs.end() && at->first == id; ++at) {
      listed[at->second] = 1;
    }
    for (std::size_t tile = 0; tile < listed.size(); ++tile) {
      const auto x = static_cast<int>(tile % tiles_x), y = static_cast<int>(tile / tiles_x);
      const bool hit = reach.certainly_hits(x, y);
      tally.hits += hit ? 1 : 0;
      tally.missed += hit && listed[tile] == 0 ? 1 : 0;
      if (listed[tile] == 0) continue;
      tally.clipped += reach.clipped() ? 1 : 0;
      if (hit) continue;
      if (!reach.clipped()) {
        tally.unreached += reach.meets_rectangle(x, y) ? 0 : 1;
      } else if (samples_clipped) {
        tally.clipped_unreached += reach.sampled_in(x, y) ? 0 : 1;
      }
    }
  }
  return tally;
}

void add(const Tally& from, Tally& to) {
  to.hits += from.hits;
  to.missed += from.missed;
  to.pairs += from.pairs;
  to.unreached += from.unreached;
  to.clipped += from.clipped;
  to.clipped_unreached += from.clipped_unreached;
}

TEST(TileReach, HundredThousandAwkwardSurfels) {
  const CameraIntrinsics camera{75, 60, 66.0, 62.0, 36.6, 31.2};
  core::RandomStream random(9, "tile_reach");
  std::array<Tally, testing::kAwkwardKinds> tallies{};
  constexpr int kClouds = 104, kSurfels = 1000;
  for (int i = 0; i < kClouds; ++i) {
    const int kind = i % testing::kAwkwardKinds;
    SurfelCloud cloud;
    for (int n = 0; n < kSurfels; ++n) {
      const auto disc =
          testing::random_awkward_disc(random, static_cast<testing::AwkwardKind>(kind));
      testing::Surfel surfel;
      surfel.position_m = glm::vec3(disc.centre_m);
      surfel.R_world_surfel =
          glm::quat(glm::quat_cast(glm::dmat3(disc.u, disc.v, disc.normal)));
      surfel.scale_m = {static_cast<float>(disc.scale_u_m),
                        static_cast<float>(disc.scale_v_m)};
      surfel.opacity = static_cast<float>(disc.opacity);
      testing::add(cloud, surfel);
    }
    add(tally_of(std::make_shared<const SurfelCloud>(std::move(cloud)), CameraPose(), camera,
                 false),
        tallies[kind]);
  }
  Tally sum;
  for (int kind = 0; kind < testing::kAwkwardKinds; ++kind) {
    const Tally& tally = tallies[kind];
    EXPECT_EQ(tally.missed, 0U) << "kind " << kind;
    // Before the near plane the lists are exact, whatever the surfel.
    const std::size_t exact = tally.pairs - tally.clipped;
    EXPECT_LE(static_cast<double>(tally.unreached), 0.005 * static_cast<double>(exact))
        << "kind " << kind;
    add(tally, sum);
  }
  EXPECT_GT(sum.hits, 400000U);
  EXPECT_GT(sum.clipped, 100000U);
  RecordProperty("pairs", std::to_string(sum.pairs));
  RecordProperty("unreached", std::to_string(sum.unreached));
}

TEST(TileReach, OfARoom) {
  const auto room =
      std::make_shared<const SurfelCloud>(make_room_scene({.surfel_count = 300'000}));
  const CameraIntrinsics camera = room_camera(640, 480);
  Tally tally;
  for (const CameraPose& pose : room_camera_ring(1))
    add(tally_of(room, pose, camera, true), tally);
  EXPECT_EQ(tally.missed, 0U);
  const std::size_t unreached = tally.unreached + tally.clipped_unreached;
  EXPECT_LE(static_cast<double>(unreached), 0.005 * static_cast<double>(tally.pairs));
  EXPECT_GT(tally.pairs, 300000U);
  RecordProperty("pairs", std::to_string(tally.pairs));
  RecordProperty("unreached", std::to_string(unreached));
}

/// Pixels whose labels differ.
int labels_off(const core::Frame& a, const core::Frame& b) {
  int off = 0;
  for (std::size_t i = 0; i < a.alpha.size(); ++i) {
    off += a.semantic.pixels()[i] != b.semantic.pixels()[i] ||
                   a.instance.pixels()[i] != b.instance.pixels()[i] ||
                   a.confidence.pixels()[i] != b.confidence.pixels()[i] ||
                   a.instance_confidence.pixels()[i] != b.instance_confidence.pixels()[i]
               ? 1
               : 0;
  }
  return off;
}

/// Draws a view from exact lists and from lists of all surfels.
void compare_with_everything(const std::shared_ptr<const SurfelCloud>& cloud,
                             const CameraPose& pose, const CameraIntrinsics& camera,
                             const RenderOptions& options) {
  ViewStages exact(cloud, pose, camera, options), everything(cloud, pose, camera, options);
  exact.project();
  exact.list();
  const auto stats = exact.raster(Channels::kAll);
  everything.project();
  everything.bin_everything_everywhere();
  everything.list();
  const auto all_stats = everything.raster(Channels::kAll);
  EXPECT_EQ(everything.bins.list(0).size(), everything.surfel_count());
  EXPECT_GT(all_stats.pairs_touched, stats.pairs_touched);
  const core::Frame &a = exact.frame(), &b = everything.frame();
  EXPECT_EQ(a.alpha.pixels(), b.alpha.pixels());
  EXPECT_EQ(a.rgb.pixels(), b.rgb.pixels());
  EXPECT_EQ(a.normal.pixels(), b.normal.pixels());
  for (std::size_t i = 0; i < a.depth_m.size(); ++i) {
    const float x = a.depth_m.pixels()[i], y = b.depth_m.pixels()[i];
    EXPECT_TRUE(x == y || (std::isnan(x) && std::isnan(y))) << i;
  }
  EXPECT_EQ(stats.contributions, all_stats.contributions);
  EXPECT_EQ(labels_off(a, b), 0);
}

TEST(TileReach, PictureIsThatOfBinningEverythingEverywhere) {
  struct Case {
    std::shared_ptr<const SurfelCloud> cloud;
    CameraPose pose;
    CameraIntrinsics camera;
  };
  std::vector<Case> cases;
  const CameraIntrinsics odd{93, 70, 80.0, 75.0, 44.3, 36.8};
  for (std::uint64_t seed = 70; seed < 74; ++seed) {
    const auto cloud = std::make_shared<const SurfelCloud>(testing::random_scene(seed, 1500));
    cases.push_back({cloud, core::look_at({-4.5, 0.4, 1.0}, {0.0, 0.0, 0.0}), odd});
    cases.push_back({cloud, core::look_at({0.1, 0.2, -0.1}, {1.0, 0.3, 0.2}), odd});
  }
  const auto room =
      std::make_shared<const SurfelCloud>(make_room_scene({.surfel_count = 30'000}));
  for (const CameraPose& pose : room_camera_ring(4)) {
    cases.push_back({room, pose, room_camera(160, 120)});
  }
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const auto& [cloud, pose, camera] = cases[i];
    for (const int top_k : {1, 4, 12, kAllSurfels}) {
      SCOPED_TRACE("case " + std::to_string(i) + ", K = " + std::to_string(top_k));
      compare_with_everything(cloud, pose, camera, {.top_k = top_k});
    }
  }
}

}  // namespace
}  // namespace segsim::renderer
