#include "perception/evaluation/average_precision.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "core/random.h"
#include "perception/data/nms.h"

namespace segsim::perception {
namespace {

using core::BoxPx;
using core::Detection;

LabeledBox object(int class_index, BoxPx box, bool ignore = false, bool crowd = false) {
  LabeledBox label;
  label.class_index = class_index;
  label.box = box;
  label.ignore = ignore;
  label.crowd = crowd;
  return label;
}

TEST(AveragePrecision, PerfectDetectionsGiveOne) {
  const BoxPx a{0, 0, 10, 10}, b{20, 20, 50, 40};
  const std::vector<ImageResult> images = {
      {{object(0, a), object(1, b)}, {{0, 0.9F, a}, {1, 0.2F, b}}}};
  const PrecisionReport report = average_precision(images, 3, 0.5F);
  EXPECT_NEAR(report.ap, 1.0, 1e-12);
  EXPECT_NEAR(report.ap50, 1.0, 1e-12);
  EXPECT_EQ(report.classes[2].ap, -1.0);  // No objects: left out of the mean.
  EXPECT_EQ(report.operating.true_positives, 1);
  EXPECT_EQ(report.operating.missed, 1);
  EXPECT_DOUBLE_EQ(report.operating.recall(), 0.5);
}

TEST(AveragePrecision, AgreesWithHandWorkedExample) {
  // Two objects; found, false, found in order of score. Recall 0.5, 0.5, 1; precision 1, 1/2,
  // 2/3. Recall points 0 ... 0.5 (51 of them) see 1, the other 50 see 2/3.
  const BoxPx a{0, 0, 10, 10}, b{20, 0, 30, 10}, nowhere{60, 60, 70, 70};
  const std::vector<ImageResult> images = {
      {{object(0, a), object(0, b)}, {{0, 0.9F, a}, {0, 0.8F, nowhere}, {0, 0.7F, b}}}};
  const double expected = (51.0 + 50.0 * 2.0 / 3.0) / 101.0;
  EXPECT_NEAR(average_precision(images, 1, 0.5F).ap50, expected, 1e-12);
}

TEST(AveragePrecision, IouDecidesHowManyThresholdsCount) {
  // IoU 0.8 exactly: counts at 0.50 ... 0.80, seven of ten.
  const std::vector<ImageResult> images = {
      {{object(0, {0, 0, 10, 10})}, {{0, 0.9F, {0, 0, 10, 8}}}}};
  EXPECT_NEAR(average_precision(images, 1, 0.5F).ap, 0.7, 1e-12);
}

TEST(AveragePrecision, SecondDetectionOfAnObjectIsFalse) {
  const BoxPx a{0, 0, 10, 10};
  const std::vector<ImageResult> images = {{{object(0, a)}, {{0, 0.9F, a}, {0, 0.8F, a}}}};
  const PrecisionReport report = average_precision(images, 1, 0.0F);
  EXPECT_EQ(report.operating.true_positives, 1);
  EXPECT_EQ(report.operating.false_positives, 1);
}

TEST(AveragePrecision, IgnoredRegionsNeitherRewardNorPunish) {
  const BoxPx a{0, 0, 10, 10}, hidden{30, 0, 40, 10}, crowd{0, 50, 100, 100};
  const std::vector<ImageResult> images = {
      {{object(0, hidden, true), object(0, crowd, false, true), object(0, a)},
       {{0, 0.95F, hidden},
        {0, 0.94F, {10, 60, 20, 70}},
        {0, 0.93F, {40, 60, 50, 70}},  // A crowd takes any number.
        {0, 0.9F, a}}}};
  const PrecisionReport report = average_precision(images, 1, 0.5F);
  EXPECT_NEAR(report.ap, 1.0, 1e-12);
  EXPECT_EQ(report.classes[0].objects, 1);
  EXPECT_EQ(report.operating.false_positives, 0);
}

/// AP at one IoU threshold without sorting tricks: every distinct score is a threshold,
/// matching is repeated for each, and the envelope is the maximum over all of them with enough
/// recall.
double brute_force_ap(const std::vector<ImageResult>& images, int class_index,
                      double min_iou) {
  std::vector<float> scores;
  int objects = 0;
  for (const ImageResult& image : images) {
    for (const Detection& d : image.detections) scores.push_back(d.score);
    for (const LabeledBox& t : image.truth) {
      objects += t.class_index == class_index && !t.not_scored() ? 1 : 0;
    }
  }
  std::vector<std::pair<double, double>> curve;  // recall, precision
  for (const float threshold : scores) {
    int found = 0, wrong = 0;
    for (const ImageResult& image : images) {
      std::vector<Detection> detections;
      for (const Detection& d : image.detections) {
        if (d.class_index == class_index && d.score >= threshold) detections.push_back(d);
      }
      std::sort(detections.begin(), detections.end(),
                [](const auto& a, const auto& b) { return a.score > b.score; });
      std::vector<bool> taken(image.truth.size(), false);
      for (const Detection& d : detections) {
        // Best free scored object, else best free ignored one.
        int match = -1;
        for (const bool ignored : {false, true}) {
          double best = min_iou;
          for (std::size_t t = 0; t < image.truth.size() && (match < 0 || !ignored); ++t) {
            const LabeledBox& label = image.truth[t];
            if (label.class_index != class_index || taken[t] || label.ignore != ignored)
              continue;
            const double shared = core::iou(d.box, label.box);
            if (shared < best) continue;
            best = shared;
            match = static_cast<int>(t);
          }
          if (match >= 0) break;
        }
        if (match < 0) {
          ++wrong;
        } else {
          taken[match] = true;
          found += image.truth[match].ignore ? 0 : 1;
        }
      }
    }
    if (found + wrong > 0) {
      curve.emplace_back(static_cast<double>(found) / objects,
                         static_cast<double>(found) / (found + wrong));
    }
  }
  double sum = 0.0;
  for (int k = 0; k <= 100; ++k) {
    double best = 0.0;
    for (const auto& [recall, precision] : curve) {
      if (recall >= k * 0.01) best = std::max(best, precision);
    }
    sum += best;
  }
  return sum / 101.0;
}

std::vector<ImageResult> random_images(std::uint64_t seed) {
  core::RandomStream random(seed, "images");
  const auto box = [&random] {
    const auto x = static_cast<float>(random.index(60)),
               y = static_cast<float>(random.index(60));
    return BoxPx{x, y, x + 8 + static_cast<float>(random.index(30)),
                 y + 8 + static_cast<float>(random.index(30))};
  };
  std::vector<ImageResult> images(8);
  for (ImageResult& image : images) {
    for (std::uint32_t i = random.index(5); i > 0; --i) {
      const int class_index = static_cast<int>(random.index(2));
      image.truth.push_back(object(class_index, box(), random.chance(0.2)));
      BoxPx found = image.truth.back().box;
      found.x1 += static_cast<float>(random.index(6));
      found.y0 += static_cast<float>(random.index(4));
      if (random.chance(0.8)) {
        image.detections.push_back({class_index, static_cast<float>(random.uniform()), found});
      }
    }
    for (std::uint32_t i = random.index(4); i > 0; --i) {
      image.detections.push_back(
          {static_cast<int>(random.index(2)), static_cast<float>(random.uniform()), box()});
    }
  }
  return images;
}

TEST(AveragePrecision, AgreesWithBruteForce) {
  int compared = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const auto images = random_images(seed);
    const PrecisionReport report = average_precision(images, 2, 0.5F);
    for (int c = 0; c < 2; ++c) {
      if (report.classes[c].objects == 0) continue;
      EXPECT_NEAR(report.classes[c].ap50, brute_force_ap(images, c, 0.5), 1e-9) << seed;
      ++compared;
    }
  }
  EXPECT_GT(compared, 60);
}

TEST(BestF1, NoOtherThresholdIsBetter) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto images = random_images(seed);
    const OperatingPoint best = best_f1(operating_points(images, 2));
    const auto at = [&images](float threshold) {
      return average_precision(images, 2, threshold).operating;
    };
    EXPECT_EQ(at(best.score_threshold).true_positives, best.true_positives);
    EXPECT_EQ(at(best.score_threshold).false_positives, best.false_positives);
    for (int k = 0; k <= 200; ++k) {
      EXPECT_LE(at(static_cast<float>(k) / 200.0F).f1(), best.f1() + 1e-12);
    }
  }
}

TEST(BestF1, WithoutTruePositivesItIsHalf) { EXPECT_EQ(best_f1({}).score_threshold, 0.5F); }

TEST(MostRecall, FindsMostAmongThePreciseOnes) {
  int reached = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const std::vector<OperatingPoint> points = operating_points(random_images(seed), 2);
    for (const double wanted : {0.3, 0.6, 0.9}) {
      const OperatingPoint chosen = most_recall(points, wanted);
      const bool possible = std::any_of(points.begin(), points.end(), [&](const auto& point) {
        return point.true_positives > 0 && point.precision() >= wanted;
      });
      if (!possible) {
        EXPECT_EQ(chosen.score_threshold, best_f1(points).score_threshold);
        continue;
      }
      ++reached;
      EXPECT_GE(chosen.precision(), wanted);
      for (const OperatingPoint& point : points) {
        if (point.precision() >= wanted) {
          EXPECT_LE(point.true_positives, chosen.true_positives);
        }
      }
    }
  }
  EXPECT_GT(reached, 20);
}

TEST(SuppressOverlaps, KeepsTheBestOfEachClassInOrder) {
  const BoxPx a{0, 0, 10, 10}, near_a{0, 0, 10, 9}, b{50, 50, 60, 60};
  const std::vector<Detection> input = {
      {0, 0.5F, near_a}, {0, 0.9F, a}, {1, 0.5F, near_a}, {0, 0.5F, b}};
  const auto kept = suppress_overlaps(input, 0.65F, 100);
  ASSERT_EQ(kept.size(), 3U);
  EXPECT_EQ(kept[0].score, 0.9F);
  EXPECT_EQ(kept[1].class_index, 1);  // Equal scores: the lower index first.
  EXPECT_EQ(kept[2].box.x0, 50.0F);
  EXPECT_EQ(suppress_overlaps(input, 0.65F, 2).size(), 2U);
  EXPECT_EQ(suppress_overlaps(input, 0.95F, 100).size(), 4U);
}

}  // namespace
}  // namespace segsim::perception
