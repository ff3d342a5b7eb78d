#include "worlds/masks/internal/mask_shapes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "core/check.h"

namespace segsim::worlds::internal {
namespace {

cv::Rect whole(const cv::Size& image) { return {0, 0, image.width, image.height}; }

/// `box` in the coordinates of `outer`.
cv::Rect inside(const cv::Rect& box, const cv::Rect& outer) {
  return {box.x - outer.x, box.y - outer.y, box.width, box.height};
}

/// Of pixel centres to the border, positive inside.
cv::Mat1f signed_distance(const cv::Mat1b& set) {
  cv::Mat1f in, out;
  cv::distanceTransform(set, in, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::distanceTransform(255 - set, out, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  // Distances are to the nearest centre on the other side; the border lies half a pixel
  // before.
  for (int y = 0; y < set.rows; ++y) {
    for (int x = 0; x < set.cols; ++x) {
      in(y, x) = set(y, x) != 0 ? in(y, x) - 0.5F : 0.5F - out(y, x);
    }
  }
  return in;
}

/// Kernel weights of the grid nodes around each of `count_px` pixels: node k of pixel i counts
/// with weights[i * kTaps + k] and is number first(i) + k.
struct Taps {
  static constexpr int kTaps = 13;  // Nodes lie half a length apart: 3 lengths to both sides.
  std::vector<float> weights;
  std::vector<int> first;
  int nodes = 0;

  Taps(int count_px, double length_px) {
    const double spacing_px = 0.5 * length_px;
    for (int i = 0; i < count_px; ++i) {
      const int begin = static_cast<int>(std::floor(i / spacing_px));
      first.push_back(begin);
      for (int k = 0; k < kTaps; ++k) {
        const int node = begin + k - kTaps / 2;
        const double d = (i / spacing_px - node) * 0.5;  // In lengths.
        weights.push_back(static_cast<float>(std::exp(-0.5 * d * d)));
      }
    }
    nodes = first.back() + kTaps;
  }
};

/// White noise on a grid, blurred by a Gaussian: mean 0, variance 1.
cv::Mat1f smooth_noise(const cv::Size& size, double length_px, core::RandomStream& random) {
  const Taps across(size.width, length_px), down(size.height, length_px);
  // The sum of squared weights is 2 sqrt(pi) in each direction, at any pixel within 1e-4.
  const auto norm = static_cast<float>(1.0 / (2.0 * std::sqrt(std::numbers::pi)));
  cv::Mat1f rows(down.nodes, size.width, 0.0F);
  std::vector<float> nodes(static_cast<std::size_t>(across.nodes));
  for (int j = 0; j < down.nodes; ++j) {
    for (float& node : nodes) node = static_cast<float>(random.normal());
    for (int x = 0; x < size.width; ++x) {
      const float* weight = &across.weights[static_cast<std::size_t>(x * Taps::kTaps)];
      const float* node = &nodes[static_cast<std::size_t>(across.first[x])];
      for (int k = 0; k < Taps::kTaps; ++k) rows(j, x) += weight[k] * node[k];
    }
  }
  cv::Mat1f noise(size, 0.0F);
  for (int y = 0; y < size.height; ++y) {
    for (int k = 0; k < Taps::kTaps; ++k) {
      const float weight = norm * down.weights[static_cast<std::size_t>(y * Taps::kTaps + k)];
      const float* row = rows[down.first[static_cast<std::size_t>(y)] + k];
      for (int x = 0; x < size.width; ++x) noise(y, x) += weight * row[x];
    }
  }
  return noise;
}

cv::Point random_pixel(const Shape& shape, core::RandomStream& random) {
  const int area_px = shape.area_px();
  SEGSIM_CHECK(area_px > 0, "a shape without pixels");
  auto left = random.index(static_cast<std::uint32_t>(area_px));
  for (int y = 0; y < shape.set.rows; ++y) {
    for (int x = 0; x < shape.set.cols; ++x) {
      if (shape.set(y, x) != 0 && left-- == 0) return {shape.box.x + x, shape.box.y + y};
    }
  }
  SEGSIM_CHECK(false, "more pixels counted than found");
  return {};
}

}  // namespace

int Shape::area_px() const { return cv::countNonZero(set); }

Shape widened(const Shape& shape, const cv::Rect& box) {
  Shape result;
  result.box = shape.box | box;
  result.set = cv::Mat1b(result.box.size(), std::uint8_t{0});
  shape.set.copyTo(result.set(inside(shape.box, result.box)));
  return result;
}

Shape padded(const Shape& shape, int margin_px, const cv::Size& image) {
  const cv::Rect box(shape.box.x - margin_px, shape.box.y - margin_px,
                     shape.box.width + 2 * margin_px, shape.box.height + 2 * margin_px);
  return widened(shape, box & whole(image));
}

Shape with_moved_border(const Shape& shape, double shift_px, double wobble_px,
                        double length_px, const cv::Size& image, core::RandomStream& random) {
  if (shift_px == 0.0 && wobble_px == 0.0) return shape;
  const int margin_px = static_cast<int>(std::ceil(std::abs(shift_px) + 4.0 * wobble_px)) + 1;
  Shape result = padded(shape, margin_px, image);
  const cv::Mat1f distance = signed_distance(result.set);
  const cv::Mat1f noise = smooth_noise(result.box.size(), length_px, random);
  for (int y = 0; y < distance.rows; ++y) {
    for (int x = 0; x < distance.cols; ++x) {
      const bool in = distance(y, x) + shift_px + wobble_px * noise(y, x) > 0.0;
      result.set(y, x) = in ? 255 : 0;
    }
  }
  return result;
}

Shape random_blob(const Shape& where, double area_px, const cv::Size& image,
                  core::RandomStream& random) {
  const cv::Point centre = random_pixel(where, random);
  const double radius_px = std::sqrt(area_px / std::numbers::pi);
  const double stretch = std::exp(0.35 * random.normal());
  const double angle_rad = random.uniform(0.0, std::numbers::pi);
  const double a_px = radius_px * stretch, b_px = radius_px / stretch;
  // No ellipse needs more than the image; a box that large would not fit an int.
  const double reach_px = std::min(std::max(a_px, b_px), 2.0 * (image.width + image.height));
  const int reach = static_cast<int>(std::ceil(reach_px)) + 1;

  Shape blob;
  blob.box = cv::Rect(centre.x - reach, centre.y - reach, 2 * reach + 1, 2 * reach + 1) &
             whole(image);
  blob.set = cv::Mat1b(blob.box.size(), std::uint8_t{0});
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  for (int y = 0; y < blob.box.height; ++y) {
    for (int x = 0; x < blob.box.width; ++x) {
      const double dx = blob.box.x + x - centre.x, dy = blob.box.y + y - centre.y;
      const double u = (c * dx + s * dy) / a_px, v = (c * dy - s * dx) / b_px;
      if (u * u + v * v < 1.0) blob.set(y, x) = 255;
    }
  }
  return blob;
}

Shape ring_around(const Shape& shape, int width_px, const cv::Size& image) {
  Shape ring = padded(shape, width_px + 1, image);
  cv::Mat1f away;
  cv::distanceTransform(255 - ring.set, away, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::inRange(away, 0.5, static_cast<double>(width_px), ring.set);
  return ring;
}

Shape united(const Shape& a, const Shape& b) {
  Shape result = widened(a, b.box);
  cv::Mat1b part = result.set(inside(b.box, result.box));
  cv::bitwise_or(part, b.set, part);
  return result;
}

Shape without(const Shape& a, const Shape& b) {
  Shape result = widened(a, b.box);
  result.set(inside(b.box, result.box)).setTo(0, b.set);
  return result;
}

Shape common(const Shape& a, const Shape& b) {
  Shape result;
  result.box = a.box & b.box;
  if (result.box.empty()) return {};
  cv::bitwise_and(a.set(inside(result.box, a.box)), b.set(inside(result.box, b.box)),
                  result.set);
  return result;
}

double iou(const Shape& a, const Shape& b) {
  const Shape both = common(a, b);
  const double shared = both.set.empty() ? 0.0 : both.area_px();
  const double total = a.area_px() + b.area_px() - shared;
  return total > 0.0 ? shared / total : 0.0;
}

Shape random_part(const Shape& shape, core::RandomStream& random) {
  const double angle_rad = random.uniform(0.0, std::numbers::pi);
  const double share = random.uniform(0.25, 0.75);
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  std::vector<double> along;
  for (int y = 0; y < shape.set.rows; ++y) {
    for (int x = 0; x < shape.set.cols; ++x) {
      if (shape.set(y, x) != 0) along.push_back(c * x + s * y);
    }
  }
  SEGSIM_CHECK(!along.empty(), "a shape without pixels");
  const auto cut = along.begin() +
                   static_cast<std::ptrdiff_t>(share * static_cast<double>(along.size() - 1));
  std::nth_element(along.begin(), cut, along.end());
  Shape part{shape.box, shape.set.clone()};
  for (int y = 0; y < shape.set.rows; ++y) {
    for (int x = 0; x < shape.set.cols; ++x) {
      if (!(c * x + s * y > *cut)) part.set(y, x) = 0;
    }
  }
  return part;
}

}  // namespace segsim::worlds::internal
