#include "reconstruction/training/training_set.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace segsim::reconstruction {
namespace {

constexpr double kExtentMargin = 1.1, kSmallestExtent_m = 0.5;

/// The middle pixel of each block; empty stays empty.
template <class Pixel>
core::Image<Pixel> middles(const core::Image<Pixel>& image, int n) {
  core::Image<Pixel> small(image.width_px() / n, image.height_px() / n);
  for (int y = 0; y < small.height_px(); ++y) {
    for (int x = 0; x < small.width_px(); ++x) {
      small(x, y) = image(n * x + n / 2, n * y + n / 2);
    }
  }
  return small;
}

/// The mean of each block, rounded.
core::Image<core::Rgb8> block_means(const core::Image<core::Rgb8>& image, int n) {
  core::Image<core::Rgb8> small(image.width_px() / n, image.height_px() / n);
  const int pixels = n * n;
  for (int y = 0; y < small.height_px(); ++y) {
    for (int x = 0; x < small.width_px(); ++x) {
      int r = 0, g = 0, b = 0;
      for (int j = 0; j < n; ++j) {
        for (int i = 0; i < n; ++i) {
          const core::Rgb8& pixel = image(n * x + i, n * y + j);
          r += pixel.r, g += pixel.g, b += pixel.b;
        }
      }
      const auto mean = [pixels](int sum) {
        return static_cast<std::uint8_t>((sum + pixels / 2) / pixels);
      };
      small(x, y) = {mean(r), mean(g), mean(b)};
    }
  }
  return small;
}

/// 0 where any pixel of the block is 0: its mean is of that pixel as well.
core::Image<std::uint8_t> block_minima(const core::Image<std::uint8_t>& image, int n) {
  core::Image<std::uint8_t> small(image.width_px() / n, image.height_px() / n, 255);
  for (int y = 0; y < n * small.height_px(); ++y) {
    for (int x = 0; x < n * small.width_px(); ++x) {
      std::uint8_t& least = small(x / n, y / n);
      least = std::min(least, image(x, y));
    }
  }
  return small;
}

/// Crowds stay crowds in an image that shows part of the segments.
void copy_crowds(const core::FrameMasks& from, core::FrameMasks& to) {
  for (core::MaskSegment& segment : to.segments) {
    segment.crowd =
        std::any_of(from.segments.begin(), from.segments.end(), [&](const auto& s) {
          return s.crowd && s.id == segment.id && s.class_id == segment.class_id;
        });
  }
}

}  // namespace

core::FrameMasks exact_masks(const RgbdFrame& frame) {
  core::FrameMasks masks;
  masks.semantic = frame.semantic;
  masks.instance = frame.instance;
  masks.confidence =
      core::Image<std::uint8_t>(frame.semantic.width_px(), frame.semantic.height_px());
  for (std::size_t i = 0; i < masks.semantic.size(); ++i) {
    masks.confidence.data()[i] = masks.semantic.data()[i] == 0 ? 0 : 255;
  }
  masks.segments = core::segments_of(masks);
  for (core::MaskSegment& segment : masks.segments) {
    segment.crowd = segment.id != 0 &&
                    std::binary_search(frame.crowds.begin(), frame.crowds.end(), segment.id);
  }
  return masks;
}

core::CameraIntrinsics shrunk(const core::CameraIntrinsics& intrinsics, int n) {
  core::CameraIntrinsics small = intrinsics;
  small.width_px /= n, small.height_px /= n;
  for (double* value : {&small.fx_px, &small.fy_px, &small.cx_px, &small.cy_px}) *value /= n;
  return small;
}

TrainingView shrunk(const TrainingView& view, int n) {
  TrainingView small;
  small.frame = view.frame;
  small.name = view.name;
  small.T_world_camera = view.T_world_camera;
  small.rgb = block_means(view.rgb, n);
  small.depth_m = middles(view.depth_m, n);
  small.sensor = view.sensor;
  if (!view.valid.empty()) small.valid = block_minima(view.valid, n);
  small.masks.semantic = middles(view.masks.semantic, n);
  small.masks.instance = middles(view.masks.instance, n);
  small.masks.confidence = middles(view.masks.confidence, n);
  if (!small.masks.semantic.empty()) small.masks.segments = core::segments_of(small.masks);
  copy_crowds(view.masks, small.masks);
  return small;
}

double TrainingSet::extent_m() const {
  glm::dvec3 centre(0.0);
  for (const TrainingView& view : training) centre += view.T_world_camera.translation_m();
  centre /= static_cast<double>(std::max<std::size_t>(training.size(), 1));
  double radius = 0.0;
  for (const TrainingView& view : training) {
    radius = std::max(radius, glm::distance(view.T_world_camera.translation_m(), centre));
  }
  return std::max(kExtentMargin * radius, kSmallestExtent_m);
}

}  // namespace segsim::reconstruction
