// The worked examples of two tiny scenes, under every rule set: expected values were computed
// by independent scripts (docs/metrics.md shows the first example).

#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <gmock/gmock.h>

#include "core/check.h"
#include "core/random.h"
#include "reconstruction/evaluation/panoptic_report.h"

namespace segsim::reconstruction {
namespace {

using core::SceneClass;

constexpr std::uint16_t kFloor = 1, kChair = 2, kTable = 3;
constexpr double kTolerance = 1e-6;  // The examples are given to six digits.

const std::vector<SceneClass>& classes() {
  static const std::vector<SceneClass> all{
      {kFloor, "floor", false}, {kChair, "chair", true}, {kTable, "table", true}};
  return all;
}

struct View {
  core::Image<std::uint16_t> semantic, instance;
  [[nodiscard]] LabelImages images() const { return {semantic, instance}; }
};

/// Rows of words, one a pixel.
View view(const std::vector<std::string>& rows, const std::map<std::string, Label>& labels) {
  std::vector<Label> pixels;
  for (const std::string& row : rows) {
    std::istringstream words(row);
    for (std::string word; words >> word;) pixels.push_back(labels.at(word));
  }
  const int height_px = static_cast<int>(rows.size());
  const int width_px = static_cast<int>(pixels.size()) / height_px;
  View result{core::Image<std::uint16_t>(width_px, height_px),
              core::Image<std::uint16_t>(width_px, height_px)};
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    result.semantic.pixels()[i] = pixels[i].class_id;
    result.instance.pixels()[i] = pixels[i].instance_id;
  }
  return result;
}

/// A view of one row: runs of (pixels, label).
View run_view(const std::vector<std::pair<int, Label>>& runs) {
  std::string row;
  std::map<std::string, Label> labels;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    labels[std::to_string(i)] = runs[i].second;
    for (int k = 0; k < runs[i].first; ++k) row += std::to_string(i) + " ";
  }
  return view({row}, labels);
}

ContingencyTable table_of(const std::vector<std::pair<View, View>>& views) {
  ContingencyTable table;
  for (const auto& [truth, predicted] : views)
    table.add_frame(truth.images(), predicted.images());
  return table;
}

/// Two views of two chairs and a table. In the switched prediction, chair 8 is called 7 in the
/// second view.
ContingencyTable two_views(bool switched) {
  const std::map<std::string, Label> truth{{"F", {kFloor, 0}},
                                           {"a", {kChair, 1}},
                                           {"b", {kChair, 2}},
                                           {"T", {kTable, 3}},
                                           {".", {}}};
  std::map<std::string, Label> predicted{{"F", {kFloor, 0}},
                                         {"7", {kChair, 7}},
                                         {"8", {kChair, 8}},
                                         {"9", {kTable, 9}},
                                         {"x", {kTable, 10}}};
  ContingencyTable table;
  table.add_frame(
      view({"F F F F F F", "a a F b b F", "a a F b b .", "F F F F F ."}, truth).images(),
      view({"F F F F F F", "7 7 F 8 8 8", "7 F F 8 8 8", "F F F F F F"}, predicted).images());
  if (switched) predicted["8"] = {kChair, 7};
  table.add_frame(
      view({"F F F T T T", "b b F T T T", "b b F F F F", "F F F F . ."}, truth).images(),
      view({"F F F 9 9 9", "8 8 F 9 9 F", "8 F F F F F", "F F F F x x"}, predicted).images());
  return table;
}

void expect_quality(const ContingencyTable& table, const PanopticRules& rules, double pq,
                    double sq, double rq,
                    const std::vector<SceneClass>& evaluated = classes()) {
  const PanopticQuality quality = panoptic_quality(table, evaluated, rules);
  const std::string name = rules.name + " " + std::to_string(rules.min_iou);
  EXPECT_NEAR(quality.pq, pq, kTolerance) << name;
  EXPECT_NEAR(quality.sq, sq, kTolerance) << name;
  EXPECT_NEAR(quality.rq, rq, kTolerance) << name;
}

std::vector<PanopticRules> every_rule_set() {
  return {PanopticRules::strict(), PanopticRules::zju(0.1), PanopticRules::zju(0.3),
          PanopticRules::panoptic_lifting(), PanopticRules::coco_per_frame()};
}

TEST(ContingencyTable, CountsPairsPerFrameAndScene) {
  const ContingencyTable table = two_views(false);
  ASSERT_EQ(table.frame_count(), 2U);
  std::uint64_t pixels = 0, true_floor = 0;
  for (const Overlap& cell : table.scene()) {
    pixels += cell.pixels;
    const bool is_floor = cell.truth == Label{kFloor, 0} && cell.predicted == cell.truth;
    true_floor += is_floor ? cell.pixels : 0;
  }
  EXPECT_EQ(true_floor, 25U);
  EXPECT_EQ(pixels, 48U);
  const auto frame = table.frame(1);
  EXPECT_TRUE(std::is_sorted(frame.begin(), frame.end(), [](const auto& a, const auto& b) {
    return std::pair(a.truth, a.predicted) < std::pair(b.truth, b.predicted);
  }));
}

TEST(ContingencyTable, EqualsPixelByPixelCounting) {
  core::RandomStream random(1, "contingency");
  std::map<std::pair<Label, Label>, std::uint64_t> expected;
  ContingencyTable table;
  for (int frame = 0; frame < 3; ++frame) {
    View truth{core::Image<std::uint16_t>(17, 9), core::Image<std::uint16_t>(17, 9)};
    View predicted = truth;
    for (std::size_t i = 0; i < truth.semantic.size(); ++i) {
      const auto draw = [&] { return static_cast<std::uint16_t>(65533 + random.index(3)); };
      const Label g{draw(), draw()}, p{draw(), draw()};
      truth.semantic.pixels()[i] = g.class_id, truth.instance.pixels()[i] = g.instance_id;
      predicted.semantic.pixels()[i] = p.class_id,
      predicted.instance.pixels()[i] = p.instance_id;
      ++expected[{g, p}];
    }
    table.add_frame(truth.images(), predicted.images());
  }
  const std::vector<Overlap> scene = table.scene();
  ASSERT_EQ(scene.size(), expected.size());
  auto entry = expected.begin();
  for (const Overlap& cell : scene) {
    EXPECT_EQ(cell.truth, entry->first.first);
    EXPECT_EQ(cell.predicted, entry->first.second);
    EXPECT_EQ(cell.pixels, (entry++)->second);
  }
}

TEST(ContingencyTable, RefusesImagesOfDifferentSize) {
  const View small = run_view({{3, {kChair, 1}}}), large = run_view({{4, {kChair, 1}}});
  ContingencyTable table;
  EXPECT_THROW(table.add_frame(small.images(), large.images()), core::ContractViolation);
}

TEST(PanopticQuality, ConsistentIds) {
  const ContingencyTable table = two_views(false);
  for (const PanopticRules& rules : every_rule_set()) {
    const double pq = rules.per_frame ? 0.820635 : 0.819764;
    expect_quality(table, rules, pq, pq, 1.0);
  }
  const ClassPanoptic chair =
      panoptic_quality(table, classes(), PanopticRules::strict()).classes[1];
  EXPECT_EQ(chair.true_positives, 2U);
  EXPECT_EQ(chair.false_positives, 0U);
  EXPECT_EQ(chair.missed, 0U);
  EXPECT_NEAR(chair.iou_sum, 0.75 + 7.0 / 9.0, 1e-12);
}

TEST(PanopticQuality, SwitchedIdsCostWhatTheRulesSay) {
  const ContingencyTable table = two_views(true);
  expect_quality(table, PanopticRules::strict(), 0.565134, 0.565134, 0.666667);
  expect_quality(table, PanopticRules::panoptic_lifting(), 0.565134, 0.565134, 0.666667);
  expect_quality(table, PanopticRules::zju(0.5), 0.565134, 0.565134, 0.666667);
  expect_quality(table, PanopticRules::zju(0.3), 0.710637, 0.710637, 1.0);
  expect_quality(table, PanopticRules::zju(0.1), 0.692439, 0.692439, 1.0);
  expect_quality(table, PanopticRules::coco_per_frame(), 0.820635, 0.820635, 1.0);

  const ClassPanoptic strict =
      panoptic_quality(table, classes(), PanopticRules::strict()).classes[1];
  EXPECT_EQ(strict.true_positives, 0U);
  EXPECT_EQ(strict.false_positives, 2U);
  EXPECT_EQ(strict.missed, 2U);
  const ClassPanoptic loose =
      panoptic_quality(table, classes(), PanopticRules::zju(0.1)).classes[1];
  EXPECT_EQ(loose.true_positives, 3U);  // Of two chairs.
  EXPECT_NEAR(loose.iou_sum, 3.0 / 7.0 + 3.0 / 11.0 + 4.0 / 9.0, 1e-12);
}

TEST(PanopticQuality, MeansOfThingsAndStuff) {
  const PanopticQuality quality =
      panoptic_quality(two_views(false), classes(), PanopticRules::strict());
  EXPECT_NEAR(quality.pq_stuff, 25.0 / 29.0, 1e-12);
  EXPECT_NEAR(quality.pq_things, 0.5 * ((0.75 + 7.0 / 9.0) / 2.0 + 5.0 / 6.0), 1e-12);
}

TEST(InstanceCoverage, OfTwoViews) {
  const CoverageQuality consistent = instance_coverage(two_views(false), classes());
  EXPECT_NEAR(consistent.mean, 0.761111, kTolerance);
  EXPECT_NEAR(consistent.weighted, 0.755556, kTolerance);
  ASSERT_EQ(consistent.instances.size(), 3U);
  EXPECT_EQ(consistent.instances[1].predicted_id, 8);
  EXPECT_NEAR(consistent.instances[1].coverage, 0.7, 1e-12);  // Void stays in the union.
  EXPECT_DOUBLE_EQ(consistent.recall, 1.0);
  const CoverageQuality switched = instance_coverage(two_views(true), classes());
  EXPECT_NEAR(switched.mean, 0.553968, kTolerance);
  EXPECT_NEAR(switched.weighted, 0.550794, kTolerance);
  EXPECT_DOUBLE_EQ(switched.recall, 1.0 / 3.0);
  EXPECT_DOUBLE_EQ(switched.precision, 1.0 / 3.0);  // Ids 7, 8 and 9 lie on objects.
}

TEST(InstanceCoverage, TakesTheLargestOverlapAndMayRepeatAnId) {
  const std::vector<SceneClass> chair{{kChair, "chair", true}};
  const View truth = run_view({{4, {kChair, 1}}, {4, {kChair, 2}}, {2, {kChair, 3}}});
  const View predicted = run_view({{7, {kChair, 5}}, {3, {kChair, 6}}});
  const CoverageQuality coverage = instance_coverage(table_of({{truth, predicted}}), chair);
  EXPECT_NEAR(coverage.mean, 0.5377, 5e-5);
  EXPECT_NEAR(coverage.weighted, 0.5119, 5e-5);
}

TEST(InstanceCoverage, IdZeroCoversOnlyIfAllowed) {
  const std::vector<SceneClass> chair{{kChair, "chair", true}};
  const ContingencyTable table = table_of(
      {{run_view({{10, {kChair, 1}}}), run_view({{6, {kChair, 0}}, {4, {kChair, 5}}})}});
  EXPECT_DOUBLE_EQ(instance_coverage(table, chair).mean, 0.4);
  EXPECT_DOUBLE_EQ(instance_coverage(table, chair, {.zero_id_may_cover = true}).mean, 0.6);
}

TEST(SemanticQuality, OfTwoViewsInBothConventions) {
  for (const bool switched : {false, true}) {
    const ContingencyTable table = two_views(switched);
    const SemanticQuality frames =
        semantic_quality(table, classes(), SemanticRules::averaged_per_frame());
    EXPECT_NEAR(frames.mean_iou, 0.819709, kTolerance);
    EXPECT_NEAR(frames.mean_accuracy, 0.870040, kTolerance);
    EXPECT_NEAR(frames.classes[0].iou, 0.5 * (13.0 / 15.0 + 6.0 / 7.0), 1e-12);
    EXPECT_NEAR(frames.classes[1].iou, 0.5 * (7.0 / 9.0 + 0.75), 1e-12);
    const SemanticQuality pooled = semantic_quality(table, classes(), SemanticRules::pooled());
    EXPECT_NEAR(pooled.mean_iou, 0.821544, kTolerance);
    EXPECT_NEAR(pooled.mean_accuracy, 0.876068, kTolerance);
    EXPECT_NEAR(pooled.classes[0].iou, 25.0 / 29.0, 1e-12);
    EXPECT_NEAR(pooled.classes[1].iou, 10.0 / 13.0, 1e-12);
    EXPECT_NEAR(pooled.classes[2].iou, 5.0 / 6.0, 1e-12);
  }
}

TEST(PanopticQuality, MergedBlobIsPerfectRecognitionBelowHalf) {
  const std::vector<SceneClass> chair{{kChair, "chair", true}};
  const ContingencyTable table = table_of(
      {{run_view({{10, {kChair, 1}}, {10, {kChair, 2}}}), run_view({{20, {kChair, 5}}})}});
  expect_quality(table, PanopticRules::strict(), 0.0, 0.0, 0.0, chair);
  const ClassPanoptic strict =
      panoptic_quality(table, chair, PanopticRules::strict()).classes[0];
  EXPECT_EQ(strict.false_positives, 1U);
  EXPECT_EQ(strict.missed, 2U);
  for (const double min_iou : {0.3, 0.1}) {
    expect_quality(table, PanopticRules::zju(min_iou), 0.5, 0.5, 1.0, chair);
  }
  EXPECT_DOUBLE_EQ(instance_coverage(table, chair).mean, 0.5);
  EXPECT_DOUBLE_EQ(instance_coverage(table, chair).weighted, 0.5);
}

TEST(PanopticQuality, UnequalBlob) {
  const std::vector<SceneClass> chair{{kChair, "chair", true}};
  const ContingencyTable table =
      table_of({{run_view({{12, {kChair, 1}}, {6, {kChair, 2}}, {2, {kChair, 3}}}),
                 run_view({{20, {kChair, 5}}})}});
  expect_quality(table, PanopticRules::strict(), 0.3, 0.6, 0.5, chair);
  expect_quality(table, PanopticRules::zju(0.1), 0.36, 0.45, 0.8, chair);
  EXPECT_NEAR(instance_coverage(table, chair).mean, 1.0 / 3.0, 1e-12);
  EXPECT_NEAR(instance_coverage(table, chair).weighted, 0.46, 1e-12);
}

TEST(SemanticQuality, AveragingPerFrameHidesFalsePositives) {
  const std::vector<SceneClass> two{{kFloor, "floor", false}, {kChair, "chair", true}};
  const Label floor{kFloor, 0}, chair{kChair, 1};
  const View first = run_view({{4, chair}, {4, floor}});
  const ContingencyTable table =
      table_of({{first, first}, {run_view({{8, floor}}), run_view({{4, floor}, {4, chair}})}});
  const SemanticQuality frames =
      semantic_quality(table, two, SemanticRules::averaged_per_frame());
  EXPECT_DOUBLE_EQ(frames.mean_iou, 0.875);
  EXPECT_DOUBLE_EQ(frames.mean_accuracy, 0.875);
  const SemanticQuality pooled = semantic_quality(table, two, SemanticRules::pooled());
  EXPECT_NEAR(pooled.mean_iou, 0.583333, kTolerance);
  EXPECT_NEAR(pooled.mean_accuracy, 0.833333, kTolerance);
  expect_quality(table, PanopticRules::strict(), 0.333333, 0.333333, 0.5, two);

  // A third class that never occurs.
  const SemanticQuality zju = semantic_quality(table, classes(), SemanticRules::zju());
  EXPECT_NEAR(zju.mean_iou, 0.583333, kTolerance);
  expect_quality(table, PanopticRules::zju(0.5), 0.222222, 0.222222, 0.333333);
  EXPECT_DOUBLE_EQ(
      semantic_quality(table, classes(), SemanticRules::averaged_per_frame()).mean_iou, 0.875);
  expect_quality(table, PanopticRules::strict(), 0.333333, 0.333333, 0.5);
}

TEST(SemanticQuality, PredictedVoidIsAClassForPanopticLifting) {
  const std::vector<SceneClass> chair{{kChair, "chair", true}};
  const ContingencyTable table =
      table_of({{run_view({{10, {kChair, 1}}}), run_view({{5, {kChair, 1}}, {5, {0, 0}}})}});
  EXPECT_DOUBLE_EQ(semantic_quality(table, chair, SemanticRules::pooled()).mean_iou, 0.5);
  EXPECT_DOUBLE_EQ(semantic_quality(table, chair, SemanticRules::panoptic_lifting()).mean_iou,
                   0.25);
}

TEST(PanopticQuality, PredictedVoidIsNeutralForPanopticLifting) {
  const std::vector<SceneClass> chair{{kChair, "chair", true}};
  const View truth = run_view({{10, {kChair, 1}}});
  for (const int found : {6, 4}) {
    const ContingencyTable table =
        table_of({{truth, run_view({{found, {kChair, 5}}, {10 - found, {0, 0}}})}});
    expect_quality(table, PanopticRules::panoptic_lifting(), 1.0, 1.0, 1.0, chair);
    const double iou = found / 10.0;
    for (const double min_iou : {0.3, 0.1}) {
      expect_quality(table, PanopticRules::zju(min_iou), iou, iou, 1.0, chair);
    }
    for (const PanopticRules& rules :
         {PanopticRules::strict(), PanopticRules::coco_per_frame()}) {
      const bool matches = found == 6;  // 0.4: one missed and one false positive.
      expect_quality(table, rules, matches ? iou : 0.0, matches ? iou : 0.0,
                     matches ? 1.0 : 0.0, chair);
    }
  }
}

TEST(PanopticQuality, PanopticLiftingDropsRareClasses) {
  const Label floor{kFloor, 0};
  // 3 % of the truth is chair, which the prediction nearly misses (0.3 %).
  const ContingencyTable table =
      table_of({{run_view({{970, floor}, {30, {kChair, 1}}}),
                 run_view({{970, floor}, {3, {kChair, 1}}, {27, floor}})}});
  expect_quality(table, PanopticRules::strict(), 0.5 * 970.0 / 997.0, 0.5 * 970.0 / 997.0,
                 0.5);
  expect_quality(table, PanopticRules::panoptic_lifting(), 1.0, 1.0, 1.0);
}

TEST(PanopticQuality, FalsePositiveOnVoidIsForgivenAboveHalf) {
  const Label floor{kFloor, 0}, none{};
  for (const int on_void : {50, 51}) {
    const ContingencyTable table =
        table_of({{run_view({{200 - on_void, floor}, {on_void, none}}),
                   run_view({{100, floor}, {100, {kChair, 5}}})}});
    for (const PanopticRules& rules :
         {PanopticRules::strict(), PanopticRules::zju(0.3), PanopticRules::coco_per_frame()}) {
      const ClassPanoptic chair = panoptic_quality(table, classes(), rules).classes[1];
      EXPECT_EQ(chair.false_positives, on_void == 50 ? 1U : 0U) << rules.name;
    }
  }
}

TEST(PanopticQuality, NothingPredictedIsZeroAndFinite) {
  const ContingencyTable table =
      table_of({{run_view({{6, {kFloor, 0}}, {4, {kChair, 1}}}), run_view({{10, {}}})}});
  for (const PanopticRules& rules : every_rule_set()) {
    expect_quality(table, rules, 0.0, 0.0, 0.0);
  }
  EXPECT_EQ(instance_coverage(table, classes()).mean, 0.0);
  EXPECT_EQ(instance_coverage(table, classes()).weighted, 0.0);
  EXPECT_EQ(semantic_quality(table, classes(), SemanticRules::pooled()).mean_iou, 0.0);
  const ContingencyTable empty;
  expect_quality(empty, PanopticRules::strict(), 0.0, 0.0, 0.0);
  EXPECT_EQ(instance_coverage(empty, classes()).mean, 0.0);
}

TEST(PanopticQuality, ClassWithoutTruthCountsOncePredicted) {
  const View truth = run_view({{10, {kFloor, 0}}});
  const ContingencyTable table =
      table_of({{truth, run_view({{8, {kFloor, 0}}, {2, {kChair, 5}}})}});
  const PanopticQuality quality = panoptic_quality(table, classes(), PanopticRules::strict());
  EXPECT_TRUE(quality.classes[1].counted);
  EXPECT_EQ(quality.classes[1].false_positives, 1U);
  EXPECT_EQ(quality.classes[1].pq(), 0.0);
  EXPECT_FALSE(quality.classes[2].counted);
  EXPECT_NEAR(quality.pq, 0.4, 1e-12);  // Floor 8 / 10, chair 0.
}

TEST(PanopticQuality, PerfectIsOneUnderEveryRuleWhateverLiesOnVoid) {
  const Label floor{kFloor, 0}, none{};
  const View truth = run_view({{40, floor}, {20, {kChair, 1}}, {20, {kTable, 2}}, {20, none}});
  for (const auto& on_void :
       std::vector<std::vector<std::pair<int, Label>>>{{{20, none}},
                                                       {{20, floor}},
                                                       {{7, {kChair, 9}}, {13, {kTable, 8}}},
                                                       {{15, {kChair, 1}}, {5, floor}}}) {
    std::vector<std::pair<int, Label>> runs{{40, floor}, {20, {kChair, 1}}, {20, {kTable, 2}}};
    runs.insert(runs.end(), on_void.begin(), on_void.end());
    const ContingencyTable table = table_of({{truth, run_view(runs)}});
    for (const PanopticRules& rules : every_rule_set()) {
      expect_quality(table, rules, 1.0, 1.0, 1.0);
    }
    for (const SemanticRules& rules :
         {SemanticRules::pooled(), SemanticRules::averaged_per_frame(), SemanticRules::zju(),
          SemanticRules::panoptic_lifting()}) {
      EXPECT_DOUBLE_EQ(semantic_quality(table, classes(), rules).mean_iou, 1.0);
      EXPECT_DOUBLE_EQ(semantic_quality(table, classes(), rules).mean_accuracy, 1.0);
    }
  }
  EXPECT_DOUBLE_EQ(instance_coverage(table_of({{truth, truth}}), classes()).weighted, 1.0);
}

TEST(PanopticQuality, IdsAreRemappedByMajorityUnderZjuRules) {
  const Label floor{kFloor, 0};
  // Id 5 is chair on 6 and table on 4 pixels: one chair segment, though table overlaps table.
  const ContingencyTable table =
      table_of({{run_view({{10, floor}, {6, {kChair, 1}}, {4, {kTable, 2}}}),
                 run_view({{10, floor}, {6, {kChair, 5}}, {4, {kTable, 5}}})}});
  expect_quality(table, PanopticRules::strict(), 1.0, 1.0, 1.0);
  expect_quality(table, PanopticRules::zju(0.3), (1.0 + 0.6) / 3.0, (1.0 + 0.6) / 3.0,
                 2.0 / 3.0);
  // Stuff with ids stays apart from stuff without, and merges among itself.
  const ContingencyTable stuff = table_of(
      {{run_view({{10, floor}}), run_view({{5, floor}, {3, {kFloor, 7}}, {2, {kFloor, 8}}})}});
  const ClassPanoptic zju =
      panoptic_quality(stuff, classes(), PanopticRules::zju(0.1)).classes[0];
  EXPECT_EQ(zju.true_positives, 2U);
  EXPECT_NEAR(zju.iou_sum, 1.0, 1e-12);
}

TEST(PanopticReport, HasTheFiguresOfItsRules) {
  const ContingencyTable consistent = two_views(false), switched = two_views(true);
  const auto pq = [](const ContingencyTable& table, const PanopticRules& rules) {
    const PanopticReport report = panoptic_report(table, classes(), rules);
    EXPECT_EQ(report.rules, rules.name);
    EXPECT_EQ(report.views, 2U);
    return report.panoptic.pq;
  };
  EXPECT_NEAR(pq(consistent, PanopticRules::strict()), 0.819764, kTolerance);
  EXPECT_NEAR(pq(switched, PanopticRules::strict()), 0.565134, kTolerance);
  EXPECT_NEAR(pq(switched, PanopticRules::zju(0.1)), 0.692439, kTolerance);
  EXPECT_NEAR(pq(consistent, PanopticRules::panoptic_lifting()), 0.819764, kTolerance);
  EXPECT_NEAR(pq(consistent, PanopticRules::coco_per_frame()), 0.820635, kTolerance);
  EXPECT_NEAR(panoptic_report(switched, classes(), PanopticRules::strict()).coverage.mean,
              0.553968, kTolerance);
}

}  // namespace
}  // namespace segsim::reconstruction
