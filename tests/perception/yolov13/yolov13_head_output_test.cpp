#include "perception/yolov13/head_output.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/random.h"
#include "perception/internal/loss/ciou.h"

namespace segsim::perception::yolov13 {
namespace {

/// Logits of one image of 64 x 96 px and two of its objects.
HeadOutput random_output(int batch, int classes) {
  HeadOutput output{batch, classes, 64, 96, {}, {}};
  core::RandomStream random(11, "logits");
  const auto rows = static_cast<std::size_t>(batch * output.anchors());
  for (std::size_t i = 0; i < rows * 64; ++i) {
    output.box.push_back(static_cast<float>(2.0 * random.normal()));
  }
  for (std::size_t i = 0; i < rows * static_cast<std::size_t>(classes); ++i) {
    output.classes.push_back(static_cast<float>(random.normal() - 2.0));
  }
  return output;
}

struct Cell {
  double x_px, y_px, stride_px;
};

std::vector<Cell> cells_of(const HeadOutput& output) {
  std::vector<Cell> cells;
  for (const int stride : {8, 16, 32}) {
    for (int y = 0; y < output.height_px / stride; ++y) {
      for (int x = 0; x < output.width_px / stride; ++x) {
        cells.push_back({(x + 0.5) * stride, (y + 0.5) * stride, double(stride)});
      }
    }
  }
  return cells;
}

double softmax_at(const float* logits, int bin) {
  double sum = 0.0;
  for (int i = 0; i < 16; ++i) sum += std::exp(double{logits[i]});
  return std::exp(double{logits[bin]}) / sum;
}

double expectation(const float* logits) {
  double mean = 0.0;
  for (int i = 0; i < 16; ++i) mean += i * softmax_at(logits, i);
  return mean;
}

TEST(Yolov13Head, DecodesAsTheDefinitionSays) {
  const HeadOutput output = random_output(2, 3);
  const auto cells = cells_of(output);
  const auto found = decode(output);
  const std::size_t anchors = cells.size();
  ASSERT_EQ(found.size(), 2 * 7 * anchors);
  for (std::size_t image = 0; image < 2; ++image) {
    for (std::size_t a = 0; a < anchors; ++a) {
      const float* logits = output.box.data() + (image * anchors + a) * 64;
      const double l = expectation(logits), t = expectation(logits + 16),
                   r = expectation(logits + 32), b = expectation(logits + 48);
      const double s = cells[a].stride_px;
      const double wanted[] = {cells[a].x_px + (r - l) / 2 * s,
                               cells[a].y_px + (b - t) / 2 * s, (l + r) * s, (t + b) * s};
      for (std::size_t i = 0; i < 4; ++i) {
        EXPECT_NEAR(found[(image * 7 + i) * anchors + a], wanted[i], 1e-4);
      }
      for (std::size_t c = 0; c < 3; ++c) {
        const double logit = output.classes[(image * anchors + a) * 3 + c];
        EXPECT_NEAR(found[(image * 7 + 4 + c) * anchors + a], 1.0 / (1.0 + std::exp(-logit)),
                    1e-6);
      }
    }
  }
}

/// The published loss in scalars, one image: matrices of boxes x anchors, as it is written.
LossValues slow_loss(const HeadOutput& output, const std::vector<LabeledBox>& truth) {
  const auto cells = cells_of(output);
  const std::size_t anchors = cells.size(),
                    classes = static_cast<std::size_t>(output.class_count);
  std::vector<core::BoxPx> boxes;
  for (std::size_t a = 0; a < anchors; ++a) {
    const float* logits = output.box.data() + a * 64;
    const auto side = [&](int i) { return expectation(logits + 16 * i) * cells[a].stride_px; };
    boxes.push_back({static_cast<float>(cells[a].x_px - side(0)),
                     static_cast<float>(cells[a].y_px - side(1)),
                     static_cast<float>(cells[a].x_px + side(2)),
                     static_cast<float>(cells[a].y_px + side(3))});
  }
  const std::size_t count = truth.size();
  std::vector<std::vector<double>> overlap(count, std::vector<double>(anchors, 0.0)),
      metric = overlap;
  std::vector<std::vector<bool>> taken(count, std::vector<bool>(anchors, false));
  for (std::size_t b = 0; b < count; ++b) {
    const core::BoxPx& g = truth[b].box;
    for (std::size_t a = 0; a < anchors; ++a) {
      if (cells[a].x_px <= g.x0 || cells[a].x_px >= g.x1 || cells[a].y_px <= g.y0 ||
          cells[a].y_px >= g.y1)
        continue;
      overlap[b][a] = std::max(0.0, ciou(boxes[a], g));
      const double logit =
          output.classes[a * classes + static_cast<std::size_t>(truth[b].class_index)];
      metric[b][a] = std::sqrt(1.0 / (1.0 + std::exp(-logit))) * std::pow(overlap[b][a], 6);
    }
    for (std::size_t a = 0; a < anchors; ++a) {
      const auto better = std::count_if(metric[b].begin(), metric[b].end(),
                                        [&](double m) { return m > metric[b][a]; });
      taken[b][a] = metric[b][a] > 0.0 && better < 10;
    }
  }
  std::vector<int> owner(anchors, -1);
  for (std::size_t a = 0; a < anchors; ++a) {
    int takers = 0, best = 0;
    for (std::size_t b = 0; b < count; ++b) {
      if (taken[b][a]) {
        ++takers;
        owner[a] = static_cast<int>(b);
      }
      if (overlap[b][a] > overlap[static_cast<std::size_t>(best)][a])
        best = static_cast<int>(b);
    }
    if (takers > 1) owner[a] = best;
  }
  std::vector<double> target(anchors, 0.0);
  double sum = 0.0;
  for (std::size_t a = 0; a < anchors; ++a) {
    if (owner[a] < 0) continue;
    const auto b = static_cast<std::size_t>(owner[a]);
    double top_metric = 0.0, top_overlap = 0.0;
    for (std::size_t other = 0; other < anchors; ++other) {
      if (owner[other] != owner[a]) continue;
      top_metric = std::max(top_metric, metric[b][other]);
      top_overlap = std::max(top_overlap, overlap[b][other]);
    }
    sum += target[a] = metric[b][a] * top_overlap / (top_metric + 1e-9);
  }
  LossValues loss;
  for (std::size_t a = 0; a < anchors; ++a) {
    for (std::size_t c = 0; c < classes; ++c) {
      const bool own =
          owner[a] >= 0 &&
          truth[static_cast<std::size_t>(owner[a])].class_index == static_cast<int>(c);
      const double y = own ? target[a] : 0.0,
                   p = 1.0 / (1.0 + std::exp(-double{output.classes[a * classes + c]}));
      loss.classes -= y * std::log(p) + (1.0 - y) * std::log(1.0 - p);
    }
    if (owner[a] < 0) continue;
    const core::BoxPx& g = truth[static_cast<std::size_t>(owner[a])].box;
    loss.box += (1.0 - ciou(boxes[a], g)) * target[a];
    const double s = cells[a].stride_px;
    const double sides[] = {(cells[a].x_px - g.x0) / s, (cells[a].y_px - g.y0) / s,
                            (g.x1 - cells[a].x_px) / s, (g.y1 - cells[a].y_px) / s};
    for (int i = 0; i < 4; ++i) {
      const double d = std::clamp(sides[i], 0.0, 14.99);
      const int lower = static_cast<int>(d);
      const float* logits = output.box.data() + a * 64 + 16 * i;
      loss.bins -= target[a] / 4.0 *
                   (std::log(softmax_at(logits, lower)) * (lower + 1 - d) +
                    std::log(softmax_at(logits, lower + 1)) * (d - lower));
    }
  }
  const double divisor = std::max(sum, 1.0);
  loss.box /= divisor;
  loss.classes /= divisor;
  loss.bins /= divisor;
  loss.total = 7.5 * loss.box + 0.5 * loss.classes + 1.5 * loss.bins;
  return loss;
}

LabeledBox object(int class_index, core::BoxPx box) {
  LabeledBox label;
  label.class_index = class_index;
  label.box = box;
  return label;
}

TEST(Yolov13Head, LossIsThePublishedOne) {
  HeadOutput output = random_output(1, 3);
  // Three boxes over one another contest anchors; one has a single cell; one is far larger.
  const std::vector<LabeledBox> truth = {
      object(0, {10, 6, 70, 50}), object(2, {20, 10, 80, 60}), object(1, {24, 4, 76, 56}),
      object(1, {1, 1, 7, 7}), object(0, {0, 0, 96, 64})};
  const LossValues found = loss(output, {truth}), wanted = slow_loss(output, truth);
  EXPECT_NEAR(found.box, wanted.box, 1e-5 * wanted.box);
  EXPECT_NEAR(found.classes, wanted.classes, 1e-5 * wanted.classes);
  EXPECT_NEAR(found.bins, wanted.bins, 1e-5 * wanted.bins);
  EXPECT_NEAR(found.total, wanted.total, 1e-5 * wanted.total);
  EXPECT_GT(wanted.box, 0.0);
}

TEST(Yolov13Head, LossOfImagesWithoutObjectsJudgesClassesOnly) {
  const HeadOutput output = random_output(2, 3);
  const LossValues found = loss(output, {{}, {}});
  double wanted = 0.0;
  for (const float logit : output.classes) wanted += std::log1p(std::exp(double{logit}));
  EXPECT_EQ(found.box, 0.0);
  EXPECT_EQ(found.bins, 0.0);
  EXPECT_NEAR(found.classes, wanted, 1e-5 * wanted);
  EXPECT_NEAR(found.total, 2 * 0.5 * wanted, 1e-5 * wanted);
}

}  // namespace
}  // namespace segsim::perception::yolov13
