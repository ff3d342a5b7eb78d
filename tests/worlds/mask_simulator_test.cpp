#include "worlds/masks/mask_simulator.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include <gmock/gmock.h>

namespace segsim::worlds {
namespace {

using core::FrameMasks;

constexpr std::uint16_t kWall = 1, kChair = 2, kTable = 3;
constexpr int kWidth = 160, kHeight = 120;

const std::vector<core::SceneClass>& classes() {
  static const std::vector<core::SceneClass> all{
      {kWall, "wall", false}, {kChair, "chair", true}, {kTable, "table", true}};
  return all;
}

/// A wall with two touching chairs (1, 2), a chair apart (3), a table (4), and void on top.
struct Room {
  core::Image<std::uint16_t> semantic{kWidth, kHeight, kWall}, instance{kWidth, kHeight};
  std::uint32_t frame = 0;

  explicit Room(std::uint32_t frame_number = 0) : frame(frame_number) {
    fill(0, 0, kWidth, 10, 0, 0);
    fill(20, 50, 30, 40, kChair, 1);
    fill(50, 50, 30, 40, kChair, 2);
    fill(100, 30, 25, 25, kChair, 3);
    fill(95, 70, 50, 30, kTable, 4);
  }
  void fill(int x0, int y0, int width, int height, std::uint16_t class_id, std::uint16_t id) {
    for (int y = y0; y < y0 + height; ++y) {
      for (int x = x0; x < x0 + width; ++x) semantic(x, y) = class_id, instance(x, y) = id;
    }
  }
  [[nodiscard]] ExactView view() const {
    return {
        semantic, instance, {}, core::CameraIntrinsics::from_fov(kWidth, kHeight, 1.2), frame};
  }
};

/// No noise but what the test adds.
MaskNoise exact() { return MaskNoise().at_level(0.0); }

FrameMasks simulate(const MaskNoise& noise, const Room& room = Room(),
                    std::uint64_t seed = 1) {
  return MaskSimulator(classes(), noise, seed, "room").simulate(room.view());
}

/// Pixels of each pair (true instance, id of the view).
std::map<std::pair<int, int>, int> pairs(const Room& room, const FrameMasks& masks) {
  std::map<std::pair<int, int>, int> result;
  for (std::size_t i = 0; i < room.instance.size(); ++i) {
    ++result[{room.instance.pixels()[i], masks.instance.pixels()[i]}];
  }
  return result;
}

std::size_t things(const FrameMasks& masks) {
  return static_cast<std::size_t>(
      std::count_if(masks.segments.begin(), masks.segments.end(),
                    [](const core::MaskSegment& s) { return s.id > 0; }));
}

/// Mean of `value` over many views.
template <class Value>
double mean_over_views(const MaskNoise& noise, int views, const Value& value) {
  double sum = 0.0;
  for (int f = 0; f < views; ++f) {
    const Room room(static_cast<std::uint32_t>(f));
    sum += value(room, simulate(noise, room));
  }
  return sum / views;
}

TEST(MaskSimulator, LevelZeroIsExactWithOtherIds) {
  const Room room;
  const FrameMasks masks = simulate(exact(), room);
  EXPECT_EQ(masks.semantic.pixels(), room.semantic.pixels());
  std::map<int, std::set<int>> ids;
  for (const auto& [pair, pixels] : pairs(room, masks)) ids[pair.first].insert(pair.second);
  EXPECT_THAT(ids[0], ::testing::ElementsAre(0));
  std::set<int> used;
  for (int object = 1; object <= 4; ++object) {
    ASSERT_EQ(ids[object].size(), 1U);
    used.insert(*ids[object].begin());
  }
  EXPECT_THAT(used, ::testing::ElementsAre(1, 2, 3, 4));
  ASSERT_EQ(masks.segments.size(), 5U);  // The wall has id 0 and comes first.
  EXPECT_EQ(masks.segments[0].class_id, kWall);
  EXPECT_EQ(masks.confidence(0, 0), 0);
  EXPECT_GT(masks.confidence(60, 60), 0);
}

TEST(MaskSimulator, IdsTellNothingAboutTheObject) {
  // Mutual information between objects and ids over 600 views of 4 objects. Independent draws
  // leave (4 - 1)^2 / (2 n) nats by chance.
  constexpr int kViews = 600;
  std::map<std::pair<int, int>, double> joint;
  for (int f = 0; f < kViews; ++f) {
    const Room room(static_cast<std::uint32_t>(f));
    const FrameMasks masks = simulate(exact(), room);
    for (const auto& [x, y, object] :
         {std::tuple{30, 60, 1}, {60, 60, 2}, {110, 40, 3}, {100, 80, 4}}) {
      joint[{object, masks.instance(x, y)}] += 1.0 / (4.0 * kViews);
    }
  }
  double information = 0.0;
  for (const auto& [pair, p] : joint) information += p * std::log(p / (0.25 * 0.25));
  EXPECT_LT(information, 5.0 * 9.0 / (2.0 * 4.0 * kViews));
}

TEST(MaskSimulator, IsAFunctionOfSeedSceneAndFrame) {
  const Room room(7);
  const MaskSimulator simulator(classes(), {}, 1, "room");
  const FrameMasks first = simulator.simulate(room.view());
  (void)simulator.simulate(Room(8).view());  // Other views in between change nothing.
  const FrameMasks again = simulator.simulate(room.view());
  EXPECT_EQ(first.semantic.pixels(), again.semantic.pixels());
  EXPECT_EQ(first.instance.pixels(), again.instance.pixels());
  EXPECT_EQ(first.confidence.pixels(), again.confidence.pixels());
  const auto other_scene = MaskSimulator(classes(), {}, 1, "hall").simulate(room.view());
  EXPECT_NE(first.instance.pixels(), other_scene.instance.pixels());
  EXPECT_NE(first.instance.pixels(), simulate({}, room, 2).instance.pixels());
  EXPECT_NE(first.instance.pixels(), simulate({}, Room(9)).instance.pixels());
}

TEST(MaskSimulator, SegmentsDescribeTheImages) {
  for (std::uint32_t f = 0; f < 20; ++f) {
    const FrameMasks masks = simulate({}, Room(f));
    int labelled = 0, listed = 0;
    for (const std::uint16_t id : masks.semantic.pixels()) labelled += id != 0 ? 1 : 0;
    std::set<int> ids;
    for (const core::MaskSegment& segment : masks.segments) {
      listed += segment.area_px;
      const bool thing = segment.class_id != kWall;
      EXPECT_EQ(segment.id > 0, thing);
      if (thing) {
        EXPECT_TRUE(ids.insert(segment.id).second);
      }
      EXPECT_GE(segment.score, 0.04F);
      EXPECT_LE(segment.score, 0.96F);
      EXPECT_LE(segment.area_px, static_cast<int>(segment.box.area_px2()));
    }
    EXPECT_EQ(listed, labelled);
    // Ids are 1 ... n without gaps.
    if (!ids.empty()) {
      EXPECT_EQ(*ids.rbegin(), static_cast<int>(ids.size()));
    }
  }
}

TEST(MaskSimulator, MergesTouchingThingsOfOneClass) {
  MaskNoise noise = exact();
  noise.merge = 1.0;
  const Room room;
  const FrameMasks masks = simulate(noise, room);
  EXPECT_EQ(masks.instance(30, 60), masks.instance(60, 60));
  EXPECT_NE(masks.instance(30, 60), masks.instance(110, 40));  // A chair apart.
  EXPECT_NE(masks.instance(30, 60), masks.instance(100, 80));  // A table.
  EXPECT_EQ(things(masks), 3U);
  noise.merge = 0.14;
  EXPECT_NEAR(mean_over_views(noise, 800,
                              [](const Room&, const FrameMasks& m) {
                                return m.instance(30, 60) == m.instance(60, 60) ? 1.0 : 0.0;
                              }),
              0.14, 3.0 * std::sqrt(0.14 * 0.86 / 800));
}

TEST(MaskSimulator, MissesAtTheStatedRateAndCorrelatedInTime) {
  MaskNoise noise = exact();
  noise.miss_always = 0.2;
  constexpr int kViews = 3000;
  std::vector<bool> missed;
  for (int f = 0; f < kViews; ++f) {
    const FrameMasks masks = simulate(noise, Room(static_cast<std::uint32_t>(f)));
    missed.push_back(masks.instance(110, 40) == 0);
  }
  double rate = 0.0, both = 0.0;
  for (std::size_t f = 0; f < missed.size(); ++f) {
    rate += missed[f] ? 1.0 / kViews : 0.0;
    if (f >= 3) both += missed[f] && missed[f - 3] ? 1.0 / (kViews - 3) : 0.0;
  }
  EXPECT_NEAR(rate, 0.2, 0.04);
  // Two normals of correlation 0.8 are both below the 20 % quantile with probability 0.1231
  // (numerical integration); independent ones with 0.04.
  EXPECT_NEAR(both, 0.1290, 0.04);
}

TEST(MaskSimulator, SmallAndCutOffThingsAreMissedMore) {
  MaskNoise noise = exact();
  noise.miss_small = 1.0;
  noise.miss_correlation = 0.0;
  const double share = 25.0 * 25.0 / (kWidth * kHeight);
  const double expected = std::exp(-share / noise.miss_area);
  EXPECT_NEAR(mean_over_views(noise, 1500,
                              [](const Room&, const FrameMasks& m) {
                                return m.instance(110, 40) == 0 ? 1.0 : 0.0;
                              }),
              expected, 0.02);
  noise.miss_small = 0.0;
  noise.miss_border = 1.0;
  Room room;
  room.fill(150, 60, 10, 20, kChair, 5);
  const FrameMasks masks = simulate(noise, room);
  EXPECT_EQ(masks.instance(155, 70), 0);
  EXPECT_NE(masks.instance(110, 40), 0);
  EXPECT_EQ(masks.semantic(155, 30), kWall);  // Stuff is always cut off, and never for it.
}

TEST(MaskSimulator, BorderNoiseHasTheStatedSize) {
  MaskNoise noise = exact();
  noise.border_shift_px = 0.0;
  noise.border_wobble_px = 2.0;  // 1 px at this width.
  // Radius of the chair in the middle of its right side, over many views.
  double sum = 0.0, squares = 0.0;
  constexpr int kViews = 1000;
  for (int f = 0; f < kViews; ++f) {
    Room room(static_cast<std::uint32_t>(f));
    room.fill(0, 0, kWidth, kHeight, 0, 0);  // Nobody else paints over the border.
    room.fill(100, 30, 25, 25, kChair, 3);
    const FrameMasks masks = simulate(noise, room);
    const int id = masks.instance(112, 42);
    int x = 112;
    while (x < kWidth && masks.instance(x, 42) == id) ++x;
    sum += x - 125.0;
    squares += (x - 125.0) * (x - 125.0);
  }
  EXPECT_NEAR(sum / kViews, 0.0, 0.1);
  EXPECT_NEAR(squares / kViews, 1.0 + 1.0 / 12.0,
              0.15);  // Whole pixels: rounding adds 1 / 12.
}

TEST(MaskSimulator, LeaksChangeAreasByTheStatedShare) {
  MaskNoise noise = exact();
  noise.leak = 1.0;
  noise.leak_share_min = noise.leak_share_max = 0.5;
  int grown = 0, shrunk = 0;
  for (std::uint32_t f = 0; f < 100; ++f) {
    Room room(f);
    room.fill(0, 10, kWidth, kHeight - 10, 0, 0);
    room.fill(60, 40, 30, 30, kChair, 1);
    const int area = simulate(noise, room).segments.at(0).area_px;
    (area > 900 ? grown : shrunk) += 1;
    EXPECT_GT(area, 900 * 0.35);
    EXPECT_LT(area, 900 * 1.9);
  }
  EXPECT_NEAR(grown, 60, 15);
  EXPECT_NEAR(shrunk, 40, 15);
}

TEST(MaskSimulator, ConfusesClassesPartlyTheSameWayAlways) {
  MaskNoise noise = exact();
  noise.confuse = 0.4;
  const auto is_wrong = [](const Room&, const FrameMasks& m) {
    return m.semantic(100, 80) != kTable ? 1.0 : 0.0;
  };
  // Half of the rate is drawn once per object and direction: 0 or all of the views, here.
  const double rate = mean_over_views(noise, 800, is_wrong);
  EXPECT_TRUE(std::abs(rate - 0.25) < 0.04 || rate == 1.0) << rate;
  noise.confuse_systematic = 0.0;
  EXPECT_NEAR(mean_over_views(noise, 800, is_wrong), 0.4, 0.04);
  noise.confuse_systematic = 1.0;
  int always = 0;
  constexpr int kScenes = 400;
  for (int s = 0; s < kScenes; ++s) {
    const MaskSimulator simulator(classes(), noise, 1, std::to_string(s));
    const bool first = is_wrong(Room(), simulator.simulate(Room(0).view())) > 0.0;
    EXPECT_EQ(first, is_wrong(Room(), simulator.simulate(Room(1).view())) > 0.0);
    always += first ? 1 : 0;
  }
  EXPECT_NEAR(always / static_cast<double>(kScenes), 0.4, 0.08);
}

TEST(MaskSimulator, SplitsAndDuplicatesThings) {
  MaskNoise noise = exact();
  noise.split = 1.0;
  EXPECT_EQ(things(simulate(noise)), 8U);
  EXPECT_EQ(simulate(noise).semantic.pixels(), Room().semantic.pixels());
  noise.split = 0.0;
  noise.duplicate = 1.0;
  // A duplicate below its original is not seen: about half of them.
  const double seen = mean_over_views(noise, 200, [](const Room&, const FrameMasks& m) {
    return static_cast<double>(things(m));
  });
  EXPECT_GT(seen, 5.0);
  EXPECT_LT(seen, 8.0);
}

TEST(MaskSimulator, HallucinatesAtTheStatedRate) {
  MaskNoise noise = exact();
  noise.hallucinate = 2.0;
  noise.hallucinated_spread = 0.0;
  double extra = 0.0;
  constexpr int kViews = 600;
  for (int f = 0; f < kViews; ++f) {
    Room room(static_cast<std::uint32_t>(f));
    room.fill(0, 0, kWidth, kHeight, 0, 0);
    room.fill(0, 0, 10, 10, kChair, 1);
    extra += (static_cast<double>(things(simulate(noise, room))) - 1.0) / kViews;
  }
  // No wall or floor is made up, so all are things; a few hide others.
  EXPECT_NEAR(extra, 2.0, 0.2);
}

TEST(MaskSimulator, ScoresKnowALittleAboutTheMask) {
  MaskNoise noise;
  noise.hallucinate = noise.duplicate = noise.split = noise.confuse = noise.merge = 0.0;
  double n = 0, sx = 0, sy = 0, sxx = 0, syy = 0, sxy = 0;
  for (std::uint32_t f = 0; f < 1500; ++f) {
    const Room room(f);
    const FrameMasks masks = simulate(noise, room);
    for (const core::MaskSegment& segment : masks.segments) {
      if (segment.class_id != kTable) continue;
      int common = 0;
      for (std::size_t i = 0; i < room.instance.size(); ++i) {
        common += room.instance.pixels()[i] == 4 && masks.instance.pixels()[i] == segment.id;
      }
      const double x = common / (1500.0 + segment.area_px - common), y = segment.score;
      n += 1, sx += x, sy += y, sxx += x * x, syy += y * y, sxy += x * y;
    }
  }
  const double correlation =
      (n * sxy - sx * sy) / std::sqrt((n * sxx - sx * sx) * (n * syy - sy * sy));
  EXPECT_GT(correlation, 0.15);
  EXPECT_LT(correlation, 0.5);
}

TEST(MaskNoise, LevelsScaleRatesAndLengths) {
  const MaskNoise half = MaskNoise().at_level(0.5);
  EXPECT_DOUBLE_EQ(half.merge, 0.07);
  EXPECT_DOUBLE_EQ(half.duplicate, 0.30);
  EXPECT_DOUBLE_EQ(half.border_wobble_px, 0.4);
  EXPECT_DOUBLE_EQ(half.miss_small, 0.125);
  EXPECT_DOUBLE_EQ(half.miss_area, MaskNoise().miss_area);
  EXPECT_DOUBLE_EQ(half.leak_share_max, MaskNoise().leak_share_max);
  EXPECT_EQ(MaskNoise().at_level(1.0).listing(), MaskNoise().listing());
}

TEST(MaskSimulator, AcceptsEmptyAndUnlistedTruth) {
  Room room;
  room.fill(0, 0, kWidth, kHeight, 9, 4);  // Not in the table.
  const FrameMasks masks = simulate({}, room);
  EXPECT_TRUE(masks.segments.empty());
  EXPECT_THAT(masks.semantic.pixels(), ::testing::Each(0));
}

}  // namespace
}  // namespace segsim::worlds
