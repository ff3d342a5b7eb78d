#include "perception/evaluation/coco_evaluation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

/// A generator that any language can repeat: the classic linear congruence of ANSI C.
class Draw {
 public:
  explicit Draw(std::uint32_t seed) : state_(seed) {}
  int operator()(int below) {
    state_ = static_cast<std::uint32_t>((state_ * std::uint64_t{1103515245} + 12345) %
                                        (std::uint64_t{1} << 31U));
    return static_cast<int>((state_ >> 16U) % static_cast<std::uint32_t>(below));
  }

 private:
  std::uint32_t state_;
};

struct Case {
  std::uint32_t seed = 0;
  int images = 0, classes = 0, objects = 0, false_detections = 0;
  std::array<double, 12> expected{};  ///< In the order of CocoSummary.
};

double side(Draw& draw) {
  constexpr int kLargest[] = {150, 700, 2500};
  const int largest = kLargest[draw(3)];
  return (10 + draw(largest)) / 10.0;
}

/// Crowds, areas smaller than boxes, doubled and shifted detections, detections of other
/// classes, halves whose IoU is exactly 0.5, many equal scores, images without objects.
std::vector<EvaluationImage> images_of(const Case& c) {
  Draw draw(c.seed);
  std::vector<EvaluationImage> images(static_cast<std::size_t>(c.images));
  for (EvaluationImage& image : images) {
    for (int n = draw(c.objects + 1); n > 0; --n) {
      TruthRegion truth;
      truth.class_index = draw(c.classes);
      RegionPx& r = truth.region;
      r.x = draw(3000) / 10.0;
      r.y = draw(2000) / 10.0;
      r.width = side(draw);
      r.height = side(draw);
      truth.area_px2 = r.width * r.height * (draw(2) == 0 ? 1.0 : 0.5);
      truth.crowd = draw(12) == 0;
      image.truth.push_back(truth);
      for (int k = draw(4); k > 0; --k) {
        const auto shift = [&draw] { return (draw(61) - 30) / 100.0; };
        ScoredRegion found;
        found.score = draw(50) / 50.0;
        found.class_index = draw(10) != 0 ? truth.class_index : draw(c.classes);
        found.region = {r.x, r.y, r.width, r.height / 2.0};
        if (draw(5) != 0) {
          found.region.x = r.x + shift() * r.width * 0.5;
          found.region.y = r.y + shift() * r.height * 0.5;
          found.region.width = r.width * (1 + shift() * 0.5);
          found.region.height = r.height * (1 + shift() * 0.5);
        }
        image.detections.push_back(found);
      }
    }
    for (int n = draw(c.false_detections + 1); n > 0; --n) {
      ScoredRegion wrong;
      wrong.class_index = draw(c.classes);
      wrong.region.x = draw(3000) / 10.0;
      wrong.region.y = draw(2000) / 10.0;
      wrong.region.width = (10 + draw(900)) / 10.0;
      wrong.region.height = (10 + draw(900)) / 10.0;
      wrong.score = draw(50) / 50.0;
      image.detections.push_back(wrong);
    }
  }
  return images;
}

/// Expected values: the same data through evaluateImg, accumulate and summarize of
/// cocodataset/cocoapi (PythonAPI/pycocotools/cocoeval.py), rewritten line by line with numpy
/// 1.24.2, with the IoU of common/maskApi.c (bbIou) in doubles; computed on 2026-11-21.
const std::vector<Case> kCases = {
    {1,
     12,
     3,
     6,
     6,
     {0.236576410539, 0.473318331037, 0.197570418350, 0.264483552028, 0.283282015891,
      0.300000000000, 0.198421052632, 0.506140350877, 0.506140350877, 0.513434343434,
      0.518333333333, 0.300000000000}},
    {2,
     40,
     4,
     8,
     10,
     {0.101372100406, 0.242318461280, 0.064659801959, 0.123369292061, 0.122508985363,
      0.175618811881, 0.119889161889, 0.325426358176, 0.325426358176, 0.304101916602,
      0.425631313131, 0.287500000000}},
    {3,
     5,
     2,
     10,
     300,
     {0.012944707291, 0.036331625149, 0.007857970243, 0.017957106961, 0.011926516736,
      0.450000000000, 0.013333333333, 0.079523809524, 0.353333333333, 0.342857142857,
      0.357142857143, 0.500000000000}},
    {4,
     6,
     5,
     2,
     2,
     {0.269000471476, 0.798915605846, 0.166666666667, 0.319306930693, -1.000000000000,
      0.700000000000, 0.322222222222, 0.400000000000, 0.400000000000, 0.400000000000,
      -1.000000000000, 0.700000000000}},
    {5,
     60,
     1,
     3,
     3,
     {0.139151687816, 0.328646368301, 0.094400842122, 0.163078059445, 0.101640225978,
      0.345947666195, 0.113483146067, 0.428089887640, 0.428089887640, 0.424561403509,
      0.434782608696, 0.433333333333}}};

std::array<double, 12> numbers_of(const CocoSummary& s) {
  return {s.ap,   s.ap50,  s.ap75,   s.ap_small, s.ap_medium, s.ap_large,
          s.ar_1, s.ar_10, s.ar_100, s.ar_small, s.ar_medium, s.ar_large};
}

TEST(CocoEvaluation, AgreesWithTheReference) {
  for (const Case& c : kCases) {
    const auto images = images_of(c);
    const auto found = numbers_of(coco_summary(images, c.classes));
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_NEAR(found[i], c.expected[i], 1e-9) << "case " << c.seed << ", number " << i;
    }
  }
}

nlohmann::json box_json(const RegionPx& r) { return {r.x, r.y, r.width, r.height}; }

TEST(CocoEvaluation, FilesGiveTheSameNumbersWhateverTheirOrder) {
  const tests::TemporaryFolder folder;
  const Case& c = kCases[1];
  const auto images = images_of(c);
  nlohmann::json truth{{"images", nlohmann::json::array()},
                       {"annotations", nlohmann::json::array()},
                       {"categories", nlohmann::json::array()}};
  nlohmann::json results = nlohmann::json::array();
  for (int k = c.classes; k-- > 0;) {
    truth["categories"].push_back({{"id", 10 + 3 * k}, {"name", "c" + std::to_string(k)}});
  }
  for (std::size_t i = images.size(); i-- > 0;) {  // Ids ascend, the file descends.
    const int image_id = 100 + 7 * static_cast<int>(i);
    truth["images"].push_back({{"id", image_id},
                               {"file_name", std::to_string(i) + ".png"},
                               {"width", 600},
                               {"height", 600}});
    for (const TruthRegion& object : images[i].truth) {
      truth["annotations"].push_back({{"id", truth["annotations"].size() + 1},
                                      {"image_id", image_id},
                                      {"category_id", 10 + 3 * object.class_index},
                                      {"bbox", box_json(object.region)},
                                      {"area", object.area_px2},
                                      {"iscrowd", object.crowd ? 1 : 0}});
    }
    for (const ScoredRegion& found : images[i].detections) {
      results.push_back({{"image_id", image_id},
                         {"category_id", 10 + 3 * found.class_index},
                         {"bbox", box_json(found.region)},
                         {"score", found.score}});
    }
  }
  std::ofstream(folder / "truth.json") << truth;
  std::ofstream(folder / "results.json") << results;
  const CocoFiles files = read_coco_results(folder / "truth.json", folder / "results.json");
  EXPECT_EQ(files.class_names.front(), "c0");
  const auto found = numbers_of(coco_summary(files.images, c.classes));
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_NEAR(found[i], c.expected[i], 1e-9) << i;
  }
}

TruthRegion object(const RegionPx& region) { return {0, region, region.area_px2()}; }

TEST(CocoEvaluation, BordersOfSizeBelongToBothRanges) {
  const std::vector<EvaluationImage> images{{{object({0, 0, 32, 32})}, {}}};
  EXPECT_EQ(judge_class(images, 0, 0.5, 100, small_objects()).objects(), 1);
  EXPECT_EQ(judge_class(images, 0, 0.5, 100, medium_objects()).objects(), 1);
  EXPECT_EQ(judge_class(images, 0, 0.5, 100, large_objects()).objects(), 0);
}

TEST(CocoEvaluation, SizeOfObjectsIsTheAnnotationsAreaAndOfWrongDetectionsTheirBox) {
  TruthRegion thin = object({0, 0, 40, 40});
  thin.area_px2 = 500.0;  // A mask that fills a third of its box: small.
  const std::vector<EvaluationImage> images{
      {{thin}, {{0, {100, 100, 50, 50}, 0.9}, {0, {200, 200, 10, 10}, 0.8}}}};
  const JudgedClass small = judge_class(images, 0, 0.5, 100, small_objects());
  EXPECT_EQ(small.objects(), 1);
  ASSERT_EQ(small.detections.size(), 2U);
  EXPECT_EQ(small.detections[0].verdict, Verdict::kIgnored);  // 2500 px^2: not small.
  EXPECT_EQ(small.detections[1].verdict, Verdict::kFalse);
}

TEST(CocoEvaluation, OnlyTheBestDetectionsOfAnImageCount) {
  EvaluationImage image{{object({0, 0, 10, 10}), object({50, 0, 10, 10})}, {}};
  image.detections = {{0, {50, 0, 10, 10}, 0.3}, {0, {0, 0, 10, 10}, 0.7}};
  const std::vector<EvaluationImage> images{image};
  EXPECT_EQ(greatest_recall(judge_class(images, 0, 0.5, 1)), 0.5);
  EXPECT_EQ(greatest_recall(judge_class(images, 0, 0.5, 2)), 1.0);
}

TEST(CocoEvaluation, ObjectsOutOfTheDistanceNeitherRewardNorPunish) {
  TruthRegion near = object({0, 0, 10, 10}), far = object({50, 0, 10, 10}),
              unknown = object({90, 0, 10, 10});
  near.distance_m = 1.0;
  far.distance_m = 3.0;
  const std::vector<EvaluationImage> images{{{near, far, unknown},
                                             {{0, near.region, 0.9},
                                              {0, unknown.region, 0.8},
                                              {0, far.region, 0.7},
                                              {0, {200, 0, 10, 10}, 0.6}}}};
  ObjectRange range;
  range.min_distance_m = 2.0;
  range.max_distance_m = 3.0;  // Exclusive.
  EXPECT_EQ(judge_class(images, 0, 0.5, 100, range).objects(), 0);
  range.max_distance_m = 3.5;
  const JudgedClass judged = judge_class(images, 0, 0.5, 100, range);
  EXPECT_EQ(judged.objects(), 1);
  EXPECT_EQ(judged.detections[0].verdict, Verdict::kIgnored);
  EXPECT_EQ(judged.detections[1].verdict, Verdict::kIgnored);
  EXPECT_EQ(judged.detections[2].verdict, Verdict::kTrue);
  EXPECT_EQ(judged.detections[3].verdict, Verdict::kFalse);
}

TEST(CocoEvaluation, WithoutObjectsEveryNumberIsMinusOne) {
  const std::vector<EvaluationImage> images{{{}, {{0, {0, 0, 5, 5}, 0.9}}}};
  for (const double number : numbers_of(coco_summary(images, 2))) EXPECT_EQ(number, -1.0);
}

TEST(CocoEvaluation, ResamplingGivesTheSameNumbers) {
  const auto images =
      images_of({.seed = 77, .images = 30, .classes = 3, .objects = 6, .false_detections = 8});
  Draw draw(5);
  for (int round = 0; round < 20; ++round) {
    std::vector<int> copies(images.size(), 0);
    for (std::size_t i = 0; i < images.size(); ++i) {
      ++copies[static_cast<std::size_t>(draw(static_cast<int>(images.size())))];
    }
    if (round == 0) copies.assign(images.size(), 1);
    if (round == 1) copies.assign(images.size(), 0);
    for (int c = 0; c < 4; ++c) {  // The last has no objects.
      for (const int k : {0, 5, 9}) {
        const JudgedClass judged =
            judge_class(images, c, iou_threshold(k), 10, small_objects());
        const ResampledClass resampled(judged);
        EXPECT_EQ(resampled.objects(), judged.objects());
        EXPECT_DOUBLE_EQ(resampled.mean_precision(copies),
                         std::max(-1.0, mean_precision(judged, copies)));
        EXPECT_DOUBLE_EQ(resampled.greatest_recall(copies), greatest_recall(judged, copies));
      }
    }
  }
}

TEST(CocoEvaluation, CopiesEqualRepeatedImages) {
  const auto images = images_of(kCases[0]);
  const std::vector<int> copies{2, 0, 1, 3, 0, 1, 1, 0, 2, 1, 0, 1};
  int compared = 0;
  for (int c = 0; c < 3; ++c) {
    for (int k = 0; k < kIouThresholds; ++k) {
      // Scores made distinct between images: how ties interleave would differ.
      auto distinct = images;
      for (std::size_t i = 0; i < distinct.size(); ++i) {
        for (ScoredRegion& d : distinct[i].detections) {
          d.score += 1e-4 * static_cast<double>(i);
        }
      }
      std::vector<EvaluationImage> again;
      for (std::size_t i = 0; i < distinct.size(); ++i) {
        for (int n = 0; n < copies[i]; ++n) again.push_back(distinct[i]);
      }
      const JudgedClass drawn = judge_class(distinct, c, iou_threshold(k));
      const JudgedClass whole = judge_class(again, c, iou_threshold(k));
      EXPECT_NEAR(mean_precision(drawn, copies), mean_precision(whole), 1e-9);
      EXPECT_NEAR(greatest_recall(drawn, copies), greatest_recall(whole), 1e-12);
      ++compared;
    }
  }
  EXPECT_EQ(compared, 30);
}

TEST(CocoEvaluation, IgnoreOfAnAnnotationIsAChoice) {
  const tests::TemporaryFolder folder;
  std::ofstream(folder / "truth.json")
      << R"({"images":[{"id":1,"file_name":"a.png","width":100,"height":100}],
             "categories":[{"id":1,"name":"chair"}],
             "annotations":[{"id":1,"image_id":1,"category_id":1,"bbox":[0,0,10,10],
                             "area":100,"iscrowd":0,"ignore":1}]})";
  std::ofstream(folder / "results.json")
      << R"([{"image_id":1,"category_id":1,"bbox":[0,0,10,10],"score":0.5}])";
  const auto ap = [&](bool honour) {
    const CocoFiles files = read_coco_results(folder / "truth.json", folder / "results.json",
                                              {.honour_ignore = honour});
    return coco_summary(files.images, 1).ap;
  };
  EXPECT_EQ(ap(true), -1.0);
  EXPECT_NEAR(ap(false), 1.0, 1e-12);
}

TEST(CocoEvaluation, BadResultsAreNamed) {
  const tests::TemporaryFolder folder;
  std::ofstream(folder / "truth.json")
      << R"({"images":[{"id":1,"file_name":"a.png","width":100,"height":100}],
             "categories":[{"id":1,"name":"chair"}],"annotations":[]})";
  const std::pair<const char*, const char*> faults[] = {
      {"{}", "expected a list, found {}"},
      {R"([{"category_id":1,"bbox":[0,0,1,1],"score":1}])", "[0].image_id"},
      {R"([{"image_id":2,"category_id":1,"bbox":[0,0,1,1],"score":1}])", "the id of an image"},
      {R"([{"image_id":1,"category_id":9,"bbox":[0,0,1,1],"score":1}])",
       "the id of a category"},
      {R"([{"image_id":1,"category_id":1,"bbox":[0,0,1],"score":1}])", "[0].bbox"},
      {R"([{"image_id":1,"category_id":1,"bbox":[0,0,-1,1],"score":1}])", "sizes >= 0"},
      {R"([{"image_id":1,"category_id":1,"bbox":[0,0,1,1],"score":"x"}])", "[0].score"},
      {"[", "not JSON"}};
  for (const auto& [text, expected] : faults) {
    std::ofstream(folder / "results.json") << text;
    try {
      (void)read_coco_results(folder / "truth.json", folder / "results.json");
      ADD_FAILURE() << text;
    } catch (const core::InputError& error) {
      EXPECT_NE(std::string(error.what()).find(expected), std::string::npos) << error.what();
    }
  }
}

}  // namespace
}  // namespace segsim::perception
