#include "nav/objects/class_cloud.h"

#include <algorithm>
#include <bit>
#include <set>
#include <vector>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "core/random.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

using test::kNan;
using test::TestView;

VlfmRules published(Quirk quirk) {
  VlfmRules rules;
  rules.set(quirk, Rule::kVlfm);
  return rules;
}

/// 640 x 480: erosion and cluster sizes as published.
struct Scene : TestView {
  Scene() : TestView({}, 3.0F, 0.88, 640, 480) {}
  core::Image<std::uint8_t> mask{640, 480, 0};
  /// An object that fills these pixels at a depth.
  void object(int x0, int y0, int x1, int y1, float depth_m) {
    std::fill(mask.pixels().begin(), mask.pixels().end(), std::uint8_t{0});
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) {
        mask(x, y) = 1;
        depth(x, y) = depth_m;
      }
    }
  }
};

TEST(ClassCloud, KeepsTheObjectsSurface) {
  Scene scene;
  scene.object(280, 200, 360, 280, 2.0F);
  ClassCloud cloud;
  EXPECT_TRUE(cloud.add(scene.observation, scene.mask));
  ASSERT_FALSE(cloud.points().empty());
  for (const CloudPoint& p : cloud.points()) {
    EXPECT_NEAR(p.p_odom_m.x, 2.0F, 1e-4F);
    // 80 px less 2 x 5 of erosion, at 2 m and 388.19 px: 0.36 m.
    EXPECT_LE(std::abs(p.p_odom_m.y), 0.5 * 70.0 / 388.19 * 2.0 + 1e-3);
    EXPECT_EQ(p.detection, ClassCloud::kTrusted);
  }
}

TEST(ClassCloud, ErosionRemovesWhatIsThinnerThanElevenPixels) {
  Scene scene;
  ClassCloud cloud;
  scene.object(280, 100, 290, 380, 2.0F);
  EXPECT_FALSE(cloud.add(scene.observation, scene.mask));
  scene.object(280, 100, 292, 380, 2.0F);  // Two columns stay.
  EXPECT_TRUE(cloud.add(scene.observation, scene.mask));
}

TEST(ClassCloud, TooCloseIsRejected) {
  Scene scene;
  ClassCloud cloud;
  scene.object(200, 150, 440, 330, 0.95F);
  EXPECT_FALSE(cloud.add(scene.observation, scene.mask));
  scene.object(200, 150, 440, 330, 1.05F);
  EXPECT_TRUE(cloud.add(scene.observation, scene.mask));
}

TEST(ClassCloud, FewerThanAHundredPointsAreNoObject) {
  Scene scene;
  ClassCloud cloud;
  scene.object(300, 200, 319, 219, 2.0F);  // 9 x 9 after erosion.
  EXPECT_FALSE(cloud.add(scene.observation, scene.mask));
  scene.object(300, 200, 321, 221, 2.0F);  // 11 x 11.
  EXPECT_TRUE(cloud.add(scene.observation, scene.mask));
}

TEST(ClassCloud, FarPointsAndEdgeDetectionsAreSecondClass) {
  const auto trusted = [](const Scene& scene) {
    ClassCloud cloud;
    EXPECT_TRUE(cloud.add(scene.observation, scene.mask));
    return cloud.points().front().detection == ClassCloud::kTrusted;
  };
  Scene scene;
  scene.object(280, 200, 360, 280, 4.74F);
  EXPECT_TRUE(trusted(scene));
  scene.object(280, 200, 360, 280, 4.76F);  // 0.95 x 5 = 4.75 m.
  EXPECT_FALSE(trusted(scene));
  scene.object(10, 200, 200, 280, 2.0F);  // Touches the left 5 % (32 px), ends before 213.
  EXPECT_FALSE(trusted(scene));
  scene.object(40, 200, 200, 280, 2.0F);
  EXPECT_TRUE(trusted(scene));
  scene.object(10, 200, 240, 280, 2.0F);  // Reaches beyond the third.
  EXPECT_TRUE(trusted(scene));
  scene.object(440, 200, 630, 280, 2.0F);
  EXPECT_FALSE(trusted(scene));
}

TEST(ClassCloud, SecondClassGoesWhenSeenFromNear) {
  Scene scene;
  scene.object(280, 200, 360, 280, 4.9F);
  ClassCloud cloud;
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  cloud.refute_second_class(scene.observation);  // 4.9 m away: stays.
  EXPECT_FALSE(cloud.points().empty());
  scene.move_to({2.6, 0.0, 3.1});  // Near, but looking away.
  cloud.refute_second_class(scene.observation);
  EXPECT_FALSE(cloud.points().empty());
  scene.move_to({2.6, 0.0, 0.0});  // 2.3 m.
  cloud.refute_second_class(scene.observation);
  EXPECT_TRUE(cloud.points().empty());
  // Trusted points stay.
  scene.move_to({});
  scene.object(280, 200, 360, 280, 2.0F);
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  cloud.refute_second_class(scene.observation);
  EXPECT_FALSE(cloud.points().empty());
}

TEST(ClassCloud, MissingDepthIsFarOrLeftOut) {  // Q8
  Scene scene;
  scene.object(280, 200, 360, 280, kNan);
  ClassCloud far({}, published(Quirk::kZeroDepth)), none;
  EXPECT_TRUE(far.add(scene.observation, scene.mask));
  EXPECT_NEAR(far.points().front().p_odom_m.x, 5.0F, 1e-4F);
  EXPECT_FALSE(none.add(scene.observation, scene.mask));
}

TEST(ClassCloud, CloudsGrowOrAreThinned) {  // Q11
  Scene scene;
  scene.object(200, 150, 440, 330, 2.0F);
  ClassCloud endless({}, published(Quirk::kEndlessClouds), 7), thinned;
  for (int k = 0; k < 4; ++k) {
    ASSERT_TRUE(endless.add(scene.observation, scene.mask));
    ASSERT_TRUE(thinned.add(scene.observation, scene.mask));
  }
  EXPECT_EQ(endless.points().size(), 4U * 5000U);
  // 230 x 170 px at 2 m = 1.18 m x 0.88 m on a plane: voxels of 2 cm, two layers at the most.
  EXPECT_LT(thinned.points().size(), 2U * 61U * 46U);
  EXPECT_GT(thinned.points().size(), 1000U);
}

TEST(ClassCloud, IdsAreRandomNumbersOrCounted) {  // Q12
  Scene scene;
  scene.object(280, 200, 360, 280, 4.9F);
  ClassCloud random({}, published(Quirk::kFloatIds), 3), counted;
  std::set<std::uint64_t> ids;
  for (int k = 0; k < 3; ++k) {
    scene.move_to({0.0, 3.0 * k, 0.0});  // Other voxels.
    ASSERT_TRUE(random.add(scene.observation, scene.mask));
    ASSERT_TRUE(counted.add(scene.observation, scene.mask));
    const float id =
        std::bit_cast<float>(static_cast<std::uint32_t>(random.points().back().detection));
    EXPECT_GT(id, 0.0F);
    EXPECT_LT(id, 1.0F);
    ids.insert(counted.points().back().detection);
  }
  EXPECT_EQ(ids, (std::set<std::uint64_t>{1, 2, 3}));
}

TEST(ClassCloud, TargetHasHysteresis) {
  Scene scene;
  scene.object(200, 200, 440, 280, 4.0F);  // About 2.4 m wide, 4 m ahead.
  ClassCloud cloud;
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  const glm::dvec3 first = cloud.target_m({0.0, 0.0}).value();
  EXPECT_NEAR(first.y, 0.0, 0.05);
  EXPECT_EQ(cloud.target_m({0.0, 0.45}).value(), first);  // Moved 0.45 m, from 4 m away.
  const glm::dvec3 second = cloud.target_m({0.0, 0.6}).value();
  EXPECT_NEAR(second.y, 0.6, 0.05);
  EXPECT_EQ(cloud.target_m({2.5, 0.55}).value(), second);  // Near: less than 0.1 m.
  EXPECT_NEAR(cloud.target_m({2.5, 0.3}).value().y, 0.3, 0.05);
  cloud.erase_around({4.0, 0.3}, 5.0);
  EXPECT_FALSE(cloud.target_m({0.0, 0.0}));
}

TEST(ClassCloud, TrustedPointsFirst) {
  Scene scene;
  ClassCloud cloud;
  scene.object(10, 200, 200, 280, 2.0F);  // Second class, nearer.
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  scene.object(280, 200, 360, 280, 4.0F);
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  EXPECT_NEAR(cloud.target_m({0.0, 0.0}).value().x, 4.0, 0.05);
}

/// A clump of a few points in mid-air hangs before a large object.
TEST(ClassCloud, AClumpIsNoTargetWhileThereIsMore) {
  for (const double share : {0.0, 0.05}) {
    ClassCloudOptions options;
    options.support_share = share;
    ClassCloud cloud(options);
    Scene scene;
    scene.object(280, 190, 380, 290, 3.0F);
    ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
    scene.object(320, 230, 342, 252, 1.5F);
    ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
    EXPECT_NEAR(cloud.target_m({0.0, 0.0}).value().x, share > 0.0 ? 3.0 : 1.5, 0.05);
    // Alone it is all there is.
    cloud.erase_around({3.0, 0.0}, 1.0);
    EXPECT_NEAR(cloud.target_m({0.0, 0.0}).value().x, 1.5, 0.05);
  }
}

/// Two chairs 2 m apart are two objects, not one in the middle between them.
TEST(ClassCloud, GroupsAreApartAndKnowTheirDetections) {
  ClassCloud cloud;
  Scene scene;
  EXPECT_TRUE(cloud.groups().empty());
  const core::BoxPx left{80, 200, 160, 280}, right{480, 200, 560, 280};
  const auto see = [&](std::uint64_t capture_index, const core::BoxPx& box) {
    scene.observation.capture_index = capture_index;
    scene.object(static_cast<int>(box.x0), 200, static_cast<int>(box.x1), 280, 2.11F);
    ASSERT_TRUE(cloud.add(scene.observation, scene.mask, box));
  };
  see(4, left);
  see(4, right);
  see(5, right);  // Adds nothing: its voxels are full.
  const std::vector<CloudGroup> groups = cloud.groups();
  ASSERT_EQ(groups.size(), 2U);
  // Pixel 520 lies 200 px right of the middle: 2.11 m x 200 / 388.19.
  EXPECT_NEAR(groups[0].center_m.y, -2.11 * 200.0 / 388.19, 0.02);
  EXPECT_NEAR(groups[1].center_m.y, 2.11 * 200.0 / 388.19, 0.02);
  for (const CloudGroup& group : groups) {
    EXPECT_NEAR(group.center_m.x, 2.11, 0.02);
    ASSERT_EQ(group.made_of.size(), 1U);
    EXPECT_EQ(group.made_of[0].capture_index, 4U);
  }
  EXPECT_EQ(groups[0].made_of[0].box.x0, right.x0);
  EXPECT_EQ(groups[1].made_of[0].box.x0, left.x0);
  // What connects them makes them one.
  see(6, {80, 200, 560, 280});
  ASSERT_EQ(cloud.groups().size(), 1U);
  EXPECT_EQ(cloud.groups()[0].made_of.size(), 3U);
}

/// What a first view took for the object, a second one shows beside the box.
TEST(ClassCloud, CarvingRemovesWhatALaterViewShowsBesideTheBox) {
  for (const double carve_m : {0.0, 1.0}) {
    ClassCloudOptions options;
    options.carve_m = carve_m;
    ClassCloud cloud(options);
    Scene scene;
    // One surface at 2 m: the object and what stands beside it, in one mask.
    scene.object(240, 200, 400, 280, 2.0F);
    ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
    cloud.carve(scene.observation, std::vector<core::BoxPx>{{240, 200, 400, 280}});
    const auto beside = [&] {  // Left of the image's middle is y > 0.
      return std::count_if(cloud.points().begin(), cloud.points().end(),
                           [](const CloudPoint& p) { return p.p_odom_m.y > 0.1F; });
    };
    const auto before = beside();
    ASSERT_GT(before, 0);
    // Now the detector knows better; the depth is the same.
    scene.object(320, 200, 400, 280, 2.0F);
    ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
    cloud.carve(scene.observation, std::vector<core::BoxPx>{{320, 200, 400, 280}});
    EXPECT_EQ(beside(), carve_m > 0.0 ? 0 : before);
    EXPECT_FALSE(cloud.points().empty());
  }
}

TEST(ClassCloud, CarvingSparesWhatIsHiddenOrFarAway) {
  ClassCloudOptions options;
  options.carve_m = 0.5;
  ClassCloud cloud(options);
  Scene scene;
  scene.object(100, 200, 200, 280, 2.0F);  // 1 m beside the next one.
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  cloud.carve(scene.observation, std::vector<core::BoxPx>{{100, 200, 200, 280}});
  const std::size_t other = cloud.points().size();
  scene.object(400, 200, 480, 280, 2.0F);
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  cloud.carve(scene.observation, std::vector<core::BoxPx>{{400, 200, 480, 280}});
  const std::size_t both = cloud.points().size();
  EXPECT_GT(both, other);
  // Something stands before the first one's left half now: not in plain view.
  Scene hidden;
  hidden.object(100, 200, 480, 280, 1.2F);
  hidden.object(400, 200, 480, 280, 2.0F);
  ASSERT_TRUE(cloud.add(hidden.observation, hidden.mask));
  cloud.carve(hidden.observation, std::vector<core::BoxPx>{{400, 200, 480, 280}});
  EXPECT_GE(cloud.points().size(), both);
}

TEST(ClassCloud, FloorIsNoObject) {
  for (const double floor_m : {0.0, 0.06}) {
    ClassCloudOptions options;
    options.floor_m = floor_m;
    ClassCloud cloud(options);
    Scene scene;
    // The camera is 0.88 m up: from row 240 + 0.88 / 2 * 388 = 411 on, 2 m away is below the
    // floor.
    scene.object(280, 300, 360, 430, 2.0F);
    ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
    const auto low = std::min_element(
        cloud.points().begin(), cloud.points().end(),
        [](const CloudPoint& a, const CloudPoint& b) { return a.p_odom_m.z < b.p_odom_m.z; });
    if (floor_m > 0.0) {
      EXPECT_GE(low->p_odom_m.z, 0.06F);
    } else {
      EXPECT_LT(low->p_odom_m.z, 0.0F);
    }
  }
}

TEST(VoxelSet, HoldsWhatASetHolds) {
  internal::VoxelSet voxels;
  std::set<std::uint64_t> truth;
  core::RandomStream random(7, "voxels");
  for (int k = 0; k < 20'000; ++k) {
    // Few keys, in clumps: chains of neighbours, and holes in their middle.
    const std::uint64_t key = random.index(3000) / 2 + (random.chance(0.5) ? 1ULL << 63 : 0);
    if (random.chance(0.6)) {
      ASSERT_EQ(voxels.insert(key), truth.insert(key).second) << k;
    } else {
      voxels.erase(key);
      truth.erase(key);
    }
    ASSERT_EQ(voxels.size(), truth.size()) << k;
  }
  for (const std::uint64_t key : truth) EXPECT_FALSE(voxels.insert(key));
  voxels.clear();
  EXPECT_TRUE(voxels.insert(*truth.begin()));
}

/// The target is kept between decisions; it has to follow what comes and goes.
TEST(ClassCloud, TheTargetFollowsTheCloud) {
  Scene scene;
  ClassCloudOptions options;
  options.keep_below_m = options.keep_far_below_m = 0.0;
  options.support_share = 0.05;
  ClassCloud cloud(options);
  scene.object(280, 200, 360, 280, 4.0F);
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  EXPECT_NEAR(cloud.target_m({0.0, 0.0})->x, 4.0, 1e-4);
  scene.object(280, 200, 360, 280, 2.0F);
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  EXPECT_NEAR(cloud.target_m({0.0, 0.0})->x, 2.0, 1e-4);
  EXPECT_NEAR(cloud.target_m({6.0, 0.0})->x, 4.0, 1e-4);
  cloud.erase_around({4.0, 0.0}, 1.0);
  EXPECT_NEAR(cloud.target_m({6.0, 0.0})->x, 2.0, 1e-4);
  // Voxels are free again.
  scene.object(280, 200, 360, 280, 4.0F);
  ASSERT_TRUE(cloud.add(scene.observation, scene.mask));
  EXPECT_NEAR(cloud.target_m({6.0, 0.0})->x, 4.0, 1e-4);
}

}  // namespace
}  // namespace segsim::nav
