#include "experiments/detection/detector_comparison.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "experiments/detection/comparison_files.h"
#include "experiments/detection/photo_dataset.h"
#include "perception/data/image_file.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;

constexpr int kImages = 60;

/// Two classes; 'before' finds an object with probability 0.3, 'after' with 0.8.
detection::SetComparison random_set() {
  detection::SetComparison set;
  set.name = "views";
  set.json = "labels.json";
  set.dataset.class_names = {"chair", "couch", "bed"};
  core::RandomStream random(3, "comparison test");
  for (int i = 0; i < kImages; ++i) {
    perception::LabeledImage image;
    image.id = i + 1;
    image.file = "images/" + std::to_string(i + 1) + ".png";
    image.width_px = 200;
    image.height_px = 150;
    perception::ImageResult before, after;
    for (std::uint32_t n = 1 + random.index(3); n > 0; --n) {
      perception::LabeledBox label;
      label.class_index = static_cast<int>(random.index(2));
      const auto x = static_cast<float>(random.index(90)),
                 y = static_cast<float>(random.index(90)),
                 s = static_cast<float>(8 + random.index(50));
      label.box = {x, y, x + s, y + s};
      label.area_px2 = double{s} * s;
      label.distance_m = 60.0 / double{s};
      image.boxes.push_back(label);
      const auto score = static_cast<float>(random.uniform());
      if (random.chance(0.3))
        before.detections.push_back({label.class_index, score, label.box});
      if (random.chance(0.8))
        after.detections.push_back({label.class_index, score, label.box});
    }
    before.truth = after.truth = image.boxes;
    set.dataset.images.push_back(image);
    set.before_results.push_back(before);
    set.after_results.push_back(after);
  }
  set.before = set.after = {};
  set.before.confusion = perception::confusion_matrix(set.before_results, 3, 0.5);
  set.after.confusion = perception::confusion_matrix(set.after_results, 3, 0.5);
  set.before.score_threshold = set.after.score_threshold = 0.5;
  return set;
}

const detection::ComparisonRow& row(const detection::SetComparison& set,
                                    const std::string& group, const std::string& name) {
  for (const detection::ComparisonRow& r : set.rows) {
    if (r.group == group && r.name == name) return r;
  }
  throw std::runtime_error("no row " + group + " " + name);
}

TEST(DetectorComparison, ValuesAreCocosAndIntervalsHoldThem) {
  detection::SetComparison set = random_set();
  detection::compare_results({}, set);
  const auto images = perception::evaluation_images(set.after_results);
  const perception::CocoSummary summary = perception::coco_summary(images, 3);
  const detection::ComparisonRow& all = row(set, "all", "");
  EXPECT_NEAR(all.after[0].value, summary.ap, 1e-12);
  EXPECT_NEAR(all.after[1].value, summary.ap50, 1e-12);
  EXPECT_NEAR(all.after[2].value, summary.ar_1, 1e-12);
  EXPECT_NEAR(all.after[3].value, summary.ar_10, 1e-12);
  EXPECT_NEAR(all.after[4].value, summary.ar_100, 1e-12);
  EXPECT_NEAR(row(set, "size", "small").after[0].value, summary.ap_small, 1e-12);
  EXPECT_NEAR(row(set, "size", "medium").after[4].value, summary.ar_medium, 1e-12);
  for (const detection::ComparisonRow& r : set.rows) {
    for (const detection::Estimate& e : {r.before[1], r.after[1], r.difference[1]}) {
      EXPECT_LE(e.interval.low, e.value + 1e-12) << r.group << r.name;
      EXPECT_GE(e.interval.high, e.value - 1e-12) << r.group << r.name;
    }
  }
  EXPECT_GT(all.difference[1].interval.low, 0.2);  // 0.8 against 0.3 in 60 images.
  // A class without objects has no row; strata add up to all objects.
  EXPECT_THROW((void)row(set, "class", "bed"), std::runtime_error);
  EXPECT_EQ(row(set, "class", "chair").objects + row(set, "class", "couch").objects,
            all.objects);
  int near_and_far = 0;
  for (const detection::ComparisonRow& r : set.rows)
    near_and_far += r.group == "distance" ? r.objects : 0;
  EXPECT_EQ(near_and_far, all.objects);
}

TEST(DetectorComparison, IntervalsOfARateAgreeWithItsBinomialSpread) {
  // One object an image, found or not, no false detection: recall is a rate of independent
  // trials, whose normal interval is known.
  detection::SetComparison set;
  set.name = "trials";
  set.dataset.class_names = {"chair"};
  constexpr int kTrials = 400, kFound = 120;
  perception::LabeledBox label;
  label.box = {0, 0, 50, 50};
  label.area_px2 = 2500;
  for (int i = 0; i < kTrials; ++i) {
    perception::ImageResult result{{label}, {}};
    if (i < kFound) result.detections.push_back({0, 0.9F, label.box});
    set.before_results.push_back(result);
    set.after_results.push_back(result);
  }
  detection::compare_results({.rounds = 2000}, set);
  const double p = static_cast<double>(kFound) / kTrials;
  const double half = 1.96 * std::sqrt(p * (1.0 - p) / kTrials);
  const detection::Estimate& recall = row(set, "all", "").before[4];
  EXPECT_DOUBLE_EQ(recall.value, p);
  EXPECT_NEAR(recall.interval.low, p - half, 0.006);
  EXPECT_NEAR(recall.interval.high, p + half, 0.006);
  // Both detectors are the same: the paired difference is 0 in every draw.
  EXPECT_EQ(row(set, "all", "").difference[4].interval.low, 0.0);
  EXPECT_EQ(row(set, "all", "").difference[4].interval.high, 0.0);
}

TEST(DetectorComparison, SeedDecides) {
  detection::SetComparison a = random_set(), b = random_set(), c = random_set();
  detection::compare_results({.rounds = 50, .seed = 1}, a);
  detection::compare_results({.rounds = 50, .seed = 1}, b);
  detection::compare_results({.rounds = 50, .seed = 2}, c);
  EXPECT_EQ(a.rows[0].after[0].interval.low, b.rows[0].after[0].interval.low);
  EXPECT_NE(a.rows[0].after[0].interval.low, c.rows[0].after[0].interval.low);
}

TEST(DetectorComparison, FilesHoldTheSameNumbers) {
  const TemporaryFolder folder("comparison_files");
  detection::ComparisonReport report;
  report.options.before = folder.path() / "before";
  report.options.after = folder.path() / "after";
  std::ofstream(report.options.before) << "b";
  std::ofstream(report.options.after) << "a";
  report.options.rounds = 20;
  report.notes = {"a note"};
  report.sets = {random_set()};
  report.sets[0].dataset.folder = folder.path();
  for (const auto& image : report.sets[0].dataset.images) {
    perception::write_image(folder.path() / image.file,
                            core::Image<core::Rgb8>(200, 150, {90, 120, 150}));
  }
  detection::compare_results(report.options, report.sets[0]);
  detection::write_comparison(folder.path() / "out", report);

  const auto json = nlohmann::json::parse(core::read_file(folder.path() / "out/compare.json"));
  const double ap50 = json["sets"][0]["rows"][0]["AP50"]["after"]["value"];
  EXPECT_NEAR(ap50, report.sets[0].rows[0].after[1].value, 1e-12);
  double mean = 0.0;
  for (const double p : json["sets"][0]["curves"][0]["after"]) mean += p / 101.0;
  EXPECT_NEAR(mean, ap50, 1e-9);  // The area under the mean curve is the mean AP50.
  char text[32];
  std::snprintf(text, sizeof text, "%.1f [", 100.0 * ap50);
  EXPECT_THAT(core::read_file(folder.path() / "out/compare.txt"), HasSubstr(text));
  EXPECT_THAT(core::read_file(folder.path() / "out/compare.md"), HasSubstr("- a note"));
  EXPECT_THAT(core::read_file(folder.path() / "out/compare.csv"),
              HasSubstr("views,class,chair,"));
  for (const char* name : {"precision-views.png", "confusion-views.png", "misses-views.png"}) {
    EXPECT_GT(perception::read_image(folder.path() / "out" / name).width_px(), 300) << name;
  }
}

TEST(DetectorComparison, TheRecordHasEveryNumberWithItsInterval) {
  detection::ComparisonReport report;
  report.options.rounds = 20;
  report.sets = {random_set()};
  detection::compare_results(report.options, report.sets[0]);
  const auto values_of = [&] {
    std::map<std::string, core::MeasuredValue> values;
    const core::MeasurementRecord record = detection::comparison_record(report);
    for (const core::MeasuredValue& value : record.values) {
      values[value.case_name + "; " + value.name] = value;
    }
    EXPECT_EQ(values.size(), record.values.size()) << "a name comes twice";
    return values;
  };
  const std::map<std::string, core::MeasuredValue> values = values_of();
  EXPECT_EQ(values.at("views; images").value, kImages);
  const detection::ComparisonRow& chairs = row(report.sets[0], "class", "chair");
  EXPECT_EQ(values.at("views, chair; objects").value, chairs.objects);
  const core::MeasuredValue& after = values.at("views, chair; AP50 after");
  EXPECT_EQ(after.unit, "%");
  EXPECT_DOUBLE_EQ(after.value, 100.0 * chairs.after[1].value);
  ASSERT_TRUE(after.interval95.has_value());
  EXPECT_DOUBLE_EQ(after.interval95->first, 100.0 * chairs.after[1].interval.low);
  EXPECT_DOUBLE_EQ(values.at("views, all; AR100 difference").value,
                   100.0 * row(report.sets[0], "all", "").difference[4].value);
  // No picture shows a bed: it has no precision, which is another thing than 0.
  EXPECT_FALSE(values.contains("views, bed; AP50 after"));
  report.options.rounds = 0;
  EXPECT_FALSE(values_of().at("views, chair; AP50 after").interval95.has_value());
}

/// A camera at the origin that looks along +x, 1 m above the floor; f = 50 px.
reconstruction::RgbdFrame frame_ahead(float depth_m) {
  reconstruction::RgbdFrame frame;
  frame.name = "00001";
  frame.T_world_camera = core::look_at({0.0, 0.0, 1.0}, {1.0, 0.0, 1.0});
  frame.depth_m = core::Image<float>(100, 100, depth_m);
  return frame;
}

reconstruction::AnnotatedBox box_at(std::uint16_t id, const glm::dvec3& center_m,
                                    const glm::dvec3& size_m, double yaw_rad = 0.0) {
  reconstruction::AnnotatedBox box;
  box.id = id;
  box.class_name = "chair";
  box.box = {center_m, size_m, yaw_rad};
  return box;
}

int count_of(const core::Image<std::uint16_t>& image, std::uint16_t id) {
  return static_cast<int>(std::count(image.pixels().begin(), image.pixels().end(), id));
}

TEST(CastBoxes, NearBoxesHideFarOnes) {
  const auto camera = core::CameraIntrinsics::from_fov(100, 100, 1.5707963267948966);
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  // Near faces at 2 m and 4 m: 50 px of a metre wide box are 25 and 12.5 px.
  const std::vector<reconstruction::AnnotatedBox> boxes{
      box_at(1, {2.5, 0.0, 1.0}, {1.0, 1.0, 1.0}),
      box_at(2, {4.5, 1.0, 1.0}, {1.0, 1.0, 1.0})};
  const detection::PhotoLabels labels =
      detection::cast_boxes(frame_ahead(kNone), camera, boxes, 0.15);
  EXPECT_NEAR(count_of(labels.instance, 1), 25 * 25, 60);
  EXPECT_EQ(labels.visible_fraction.at(1), 1.0);
  EXPECT_LT(labels.visible_fraction.at(2), 0.7);
  EXPECT_GT(labels.visible_fraction.at(2), 0.01);
  EXPECT_NEAR(labels.depth_m(50, 50), 2.0, 1e-5);
  // A quarter turn of a square box changes nothing.
  const detection::PhotoLabels turned = detection::cast_boxes(
      frame_ahead(kNone), camera,
      {box_at(1, {2.5, 0.0, 1.0}, {1.0, 1.0, 1.0}, 1.5707963267948966)}, 0.15);
  // Only pixels whose centres lie on the outline may differ.
  EXPECT_NEAR(count_of(turned.instance, 1), count_of(labels.instance, 1), 4 * 25);
}

TEST(CastBoxes, MeasuredDepthDecidesWhereItIsThere) {
  const auto camera = core::CameraIntrinsics::from_fov(100, 100, 1.5707963267948966);
  const std::vector<reconstruction::AnnotatedBox> boxes{
      box_at(1, {2.5, 0.0, 1.0}, {1.0, 1.0, 1.0})};
  EXPECT_EQ(
      count_of(detection::cast_boxes(frame_ahead(1.0F), camera, boxes, 0.15).instance, 1), 0);
  EXPECT_EQ(
      count_of(detection::cast_boxes(frame_ahead(9.0F), camera, boxes, 0.15).instance, 1), 0);
  // A surface on the near face; deeper in, rays near the edges would have left the box.
  EXPECT_GT(
      count_of(detection::cast_boxes(frame_ahead(2.0F), camera, boxes, 0.15).instance, 1),
      550);
}

TEST(CastBoxes, PartsReplaceTheBox) {
  const auto camera = core::CameraIntrinsics::from_fov(100, 100, 1.5707963267948966);
  auto table = box_at(1, {2.5, 0.0, 1.0}, {1.0, 1.0, 1.0});
  table.parts = {{{2.5, 0.0, 1.45}, {1.0, 1.0, 0.1}, 0.0}};
  const detection::PhotoLabels labels = detection::cast_boxes(
      frame_ahead(std::numeric_limits<float>::quiet_NaN()), camera, {table}, 0.15);
  EXPECT_EQ(labels.instance(50, 50), 0);  // Below the top there is air.
  EXPECT_GT(count_of(labels.instance, 1), 40);
}

}  // namespace
}  // namespace segsim::experiments
