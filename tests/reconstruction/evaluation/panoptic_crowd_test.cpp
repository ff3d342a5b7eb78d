/// COCO's rule for crowds (`iscrowd`): examples counted by hand, and 40 random views whose
/// counts two programs of others agreed on.

#include <algorithm>
#include <utility>
#include <vector>

#include <gmock/gmock.h>

#include "reconstruction/evaluation/panoptic_quality.h"

namespace segsim::reconstruction {
namespace {

using IdImage = core::Image<std::uint16_t>;
using Runs = std::vector<std::pair<int, Label>>;  // (pixels, label)

constexpr std::uint16_t kFloor = 1, kChair = 2, kTable = 3;
constexpr Label kVoid{}, kGround{kFloor, 0}, kCrowd{kChair, 9};

const std::vector<core::SceneClass>& classes() {
  static const std::vector<core::SceneClass> all{
      {kFloor, "floor", false}, {kChair, "chair", true}, {kTable, "table", true}};
  return all;
}

/// The images of a view whose pixels lie in one row.
struct View {
  explicit View(const std::vector<Label>& pixels)
      : semantic(static_cast<int>(pixels.size()), 1),
        instance(static_cast<int>(pixels.size()), 1) {
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      semantic.pixels()[i] = pixels[i].class_id;
      instance.pixels()[i] = pixels[i].instance_id;
    }
  }
  explicit View(const Runs& runs) : View(pixels_of(runs)) {}

  static std::vector<Label> pixels_of(const Runs& runs) {
    std::vector<Label> pixels;
    for (const auto& [count, label] : runs) {
      pixels.insert(pixels.end(), static_cast<std::size_t>(count), label);
    }
    return pixels;
  }

  IdImage semantic, instance;
};

ContingencyTable one_view(const Runs& truth, const Runs& predicted,
                          const std::vector<Label>& crowds = {kCrowd}) {
  const View g(truth), p(predicted);
  ContingencyTable table;
  table.add_frame({g.semantic, g.instance, crowds}, {p.semantic, p.instance});
  return table;
}

PanopticRules without_crowds() {
  PanopticRules rules = PanopticRules::coco_per_frame();
  rules.crowds_are_ignored = false;
  return rules;
}

ClassPanoptic of_class(std::uint16_t class_id, const ContingencyTable& table,
                       const PanopticRules& rules = PanopticRules::coco_per_frame()) {
  return panoptic_quality(table, classes(), rules).classes.at(class_id - 1U);
}

void expect_counts(const ClassPanoptic& found, std::uint64_t true_positives,
                   std::uint64_t false_positives, std::uint64_t missed) {
  EXPECT_EQ(found.true_positives, true_positives);
  EXPECT_EQ(found.false_positives, false_positives);
  EXPECT_EQ(found.missed, missed);
}

/// A chair of 10 px that is found, and a prediction of 10 px of which `on_crowd` lie on the
/// crowd of 20 px, `on_void` on void and the others on the floor.
ContingencyTable beside_a_crowd(int on_crowd, int on_void, std::uint16_t class_id = kChair) {
  const Label found{kChair, 1}, second{class_id, 2};
  return one_view({{10, {kChair, 5}}, {20, kCrowd}, {10, kVoid}, {20, kGround}},
                  {{10, found},
                   {20 - on_crowd, kGround},
                   {on_crowd + on_void, second},
                   {10 - on_void, kVoid},
                   {10 - on_crowd - on_void, second},
                   {10 + on_crowd + on_void, kGround}});
}

TEST(PanopticCrowd, APredictionWithMoreThanHalfOnACrowdOfItsClassIsNoFalsePositive) {
  expect_counts(of_class(kChair, beside_a_crowd(6, 0)), 1, 0, 0);
  expect_counts(of_class(kChair, beside_a_crowd(5, 0)), 1, 1, 0);  // Half is not more.
  EXPECT_DOUBLE_EQ(of_class(kChair, beside_a_crowd(6, 0)).pq(), 1.0);
  EXPECT_DOUBLE_EQ(of_class(kChair, beside_a_crowd(5, 0)).pq(), 1.0 / 1.5);
}

TEST(PanopticCrowd, VoidAndCrowdCountTogether) {
  expect_counts(of_class(kChair, beside_a_crowd(3, 3)), 1, 0, 0);
  expect_counts(of_class(kChair, beside_a_crowd(3, 2)), 1, 1, 0);
}

TEST(PanopticCrowd, ACrowdOfAnotherClassForgivesNothing) {
  const ContingencyTable table = beside_a_crowd(10, 0, kTable);
  expect_counts(of_class(kTable, table), 0, 1, 0);
  expect_counts(of_class(kChair, table), 1, 0, 0);
}

TEST(PanopticCrowd, ACrowdIsNeitherFoundNorMissed) {
  const Runs truth{{20, kCrowd}, {20, kGround}};
  const ContingencyTable found = one_view(truth, {{20, {kChair, 3}}, {20, kGround}});
  const ContingencyTable missed = one_view(truth, {{40, kGround}});
  for (const ContingencyTable& table : {found, missed}) {
    const PanopticQuality quality =
        panoptic_quality(table, classes(), PanopticRules::coco_per_frame());
    expect_counts(quality.classes[1], 0, 0, 0);
    EXPECT_FALSE(quality.classes[1].counted);  // The mean is that of the floor alone.
    EXPECT_DOUBLE_EQ(quality.pq, quality.classes[0].pq());
  }
  expect_counts(of_class(kChair, found, without_crowds()), 1, 0, 0);
  expect_counts(of_class(kChair, missed, without_crowds()), 0, 0, 1);
}

/// Void leaves the union of a match; a crowd does not.
TEST(PanopticCrowd, PixelsOnACrowdStayInTheUnion) {
  const Label chair{kChair, 1};
  const Runs predicted{{12, chair}, {18, kGround}};
  const ContingencyTable on_crowd =
      one_view({{10, {kChair, 5}}, {12, kCrowd}, {8, kGround}}, predicted);
  const ContingencyTable on_void =
      one_view({{10, {kChair, 5}}, {12, kVoid}, {8, kGround}}, predicted);
  EXPECT_DOUBLE_EQ(of_class(kChair, on_crowd).iou_sum, 10.0 / 12.0);
  EXPECT_DOUBLE_EQ(of_class(kChair, on_void).iou_sum, 1.0);
}

/// panopticapi keeps one crowd of a class in a view, the last of its list; here all count.
TEST(PanopticCrowd, AllCrowdsOfAClassCount) {
  const Label other{kChair, 8};
  const ContingencyTable table =
      one_view({{3, kCrowd}, {3, other}, {4, kGround}}, {{10, {kChair, 1}}}, {kCrowd, other});
  expect_counts(of_class(kChair, table), 0, 0, 0);
}

/// Ids mean something in their view alone.
TEST(PanopticCrowd, ACrowdIsOneOfItsView) {
  ContingencyTable table = one_view({{10, kCrowd}}, {{10, kGround}});
  const View truth(Runs{{10, kCrowd}}), predicted(Runs{{10, kGround}});
  table.add_frame({truth.semantic, truth.instance}, {predicted.semantic, predicted.instance});
  expect_counts(of_class(kChair, table), 0, 0, 1);
}

TEST(PanopticCrowd, OtherRuleSetsTakeItForAnObject) {
  const ContingencyTable table = beside_a_crowd(6, 0);
  for (const PanopticRules& rules :
       {PanopticRules::strict(), PanopticRules::zju(0.3), PanopticRules::panoptic_lifting()}) {
    expect_counts(of_class(kChair, table, rules), 1, 1, 1);
  }
}

TEST(PanopticCrowd, IsReadOffTheSegmentsOfMasks) {
  core::FrameMasks masks;
  masks.segments.resize(2);
  masks.segments[0].id = 1;
  masks.segments[0].class_id = kChair;
  masks.segments[1].id = 4;
  masks.segments[1].class_id = kTable;
  masks.segments[1].crowd = true;
  EXPECT_THAT(images_of(masks).crowds, ::testing::ElementsAre(Label{kTable, 4}));
}

/// The upper half of a 64-bit linear congruential generator (Knuth's MMIX).
class SmallRandom {
 public:
  explicit SmallRandom(std::uint64_t seed) : state_(seed) {}
  int below(int n) {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<int>((state_ >> 33U) % static_cast<std::uint64_t>(n));
  }

 private:
  std::uint64_t state_;
};

constexpr int kWidth = 24, kHeight = 16;

void fill(std::vector<Label>& image, int x, int y, int width, int height, const Label& label) {
  for (int j = std::max(y, 0); j < std::min(y + height, kHeight); ++j) {
    for (int i = std::max(x, 0); i < std::min(x + width, kWidth); ++i) {
      image[static_cast<std::size_t>(j * kWidth + i)] = label;
    }
  }
}

/// Nine rectangles on a floor: void, chairs, tables, at most one crowd of each class; they are
/// predicted a pixel off, every fifth in the other class, crowds as two objects.
void add_random_view(SmallRandom& random, ContingencyTable& table) {
  std::vector<Label> truth(kWidth * kHeight, kGround), predicted = truth;
  std::vector<Label> crowds;
  for (std::uint16_t k = 1; k < 10; ++k) {
    const int kind = random.below(5), x = random.below(kWidth), y = random.below(kHeight);
    const int width = 3 + random.below(8), height = 3 + random.below(6);
    const int dx = random.below(3) - 1, dy = random.below(3) - 1;
    const bool confused = random.below(5) == 0;
    if (kind == 0) {
      fill(truth, x, y, width, height, kVoid);
      fill(predicted, x + dx, y + dy, width, height, {kChair, k});
      continue;
    }
    const std::uint16_t class_id = kind < 3 ? kChair : kTable;
    const std::uint16_t said = confused == (class_id == kChair) ? kTable : kChair;
    const bool first = std::none_of(crowds.begin(), crowds.end(), [&](const Label& label) {
      return label.class_id == class_id;
    });
    fill(truth, x, y, width, height, {class_id, k});
    if (!first || random.below(2) != 0) {
      fill(predicted, x + dx, y + dy, width, height, {said, k});
      continue;
    }
    crowds.push_back({class_id, k});
    const int half = width / 2;
    fill(predicted, x + dx, y + dy, half, height, {said, k});
    fill(predicted, x + dx + half, y + dy, width - half, height,
         {said, static_cast<std::uint16_t>(k + 20)});
  }
  const View g(truth), p(predicted);
  table.add_frame({g.semantic, g.instance, crowds}, {p.semantic, p.instance});
}

/// The same views as COCO panoptic files gave these counts in hotcoco 1.3.0 (`pq_compute`) and
/// by the rules of panopticapi at 1ad5afa.
TEST(PanopticCrowd, CountsAreThoseOfTheReference) {
  SmallRandom random(7);
  ContingencyTable table;
  for (int i = 0; i < 40; ++i) add_random_view(random, table);
  expect_counts(of_class(kFloor, table), 40, 0, 0);
  expect_counts(of_class(kChair, table), 46, 112, 72);
  expect_counts(of_class(kTable, table), 33, 69, 54);
  EXPECT_NEAR(of_class(kFloor, table).iou_sum, 31.537287393360685, 1e-12);
  EXPECT_NEAR(of_class(kChair, table).iou_sum, 33.211748102065926, 1e-12);
  EXPECT_NEAR(of_class(kTable, table).iou_sum, 23.917090269751505, 1e-12);
  const PanopticQuality quality =
      panoptic_quality(table, classes(), PanopticRules::coco_per_frame());
  EXPECT_NEAR(quality.pq, 0.4273959761595827, 1e-12);
  EXPECT_NEAR(quality.sq, 0.7450623399988544, 1e-12);
  EXPECT_NEAR(quality.rq, 0.5608465608465608, 1e-12);
  EXPECT_NEAR(panoptic_quality(table, classes(), without_crowds()).pq, 0.411248111362617,
              1e-12);
}

}  // namespace
}  // namespace segsim::reconstruction
