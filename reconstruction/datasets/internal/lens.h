#pragma once

/// @file
/// Lenses that bend straight lines, and pictures as a pinhole camera would have taken them.
///
///     Brown:    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
///               y' = y (1 + ...)                      + p1 (r^2 + 2 y^2) + 2 p2 x y
///     fisheye:  (x', y') = (x, y) theta_d / r,
///               theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8),  theta = atan(r)
///
/// with (x, y) = (X/Z, Y/Z) and pixel = f (x', y') + c, as OpenCV and COLMAP have them.

#include <array>
#include <cstdint>
#include <vector>

#include <glm/vec2.hpp>

#include "core/camera.h"
#include "core/image.h"

namespace segsim::reconstruction::internal {

enum class LensModel : std::uint8_t { kPinhole, kBrown, kFisheye };

struct Lens {
  LensModel model = LensModel::kPinhole;
  core::CameraIntrinsics camera;  ///< Of the picture as it was taken.
  std::array<double, 4> k{};      ///< Brown: k1 k2 k3; fisheye: k1 ... k4.
  double p1 = 0.0, p2 = 0.0;      ///< Brown only.

  [[nodiscard]] bool bends() const;
  bool operator==(const Lens& other) const;
  /// Where the ray (x, y, 1) meets the picture.
  [[nodiscard]] glm::dvec2 project(const glm::dvec2& ray) const;
};

/// The pinhole camera of the same image size with the widest view that shows nothing outside
/// of the picture; its principal point is the image centre. The lens's own camera if it does
/// not bend.
[[nodiscard]] core::CameraIntrinsics straight_camera(const Lens& lens);

/// Where each pixel of the straight picture comes from.
class Undistortion {
 public:
  /// @param width_px, height_px  Of the images to change; may differ from the lens's (depth).
  Undistortion(const Lens& lens, const core::CameraIntrinsics& straight, int width_px,
               int height_px);

  /// Bilinear. @throws ContractViolation for an image of another size, as the others.
  [[nodiscard]] core::Image<core::Rgb8> color(const core::Image<core::Rgb8>& image) const;
  /// Nearest pixel.
  template <class Pixel>
  [[nodiscard]] core::Image<Pixel> nearest(const core::Image<Pixel>& image) const {
    SEGSIM_CHECK(image.width_px() == width_px_ && image.height_px() == height_px_,
                 "size of the image");
    core::Image<Pixel> straight(width_px_, height_px_);
    for (std::size_t i = 0; i < source_px_.size(); ++i) {
      straight.pixels()[i] =
          image(clamp(source_px_[i].x, width_px_), clamp(source_px_[i].y, height_px_));
    }
    return straight;
  }

 private:
  static int clamp(float px, int size_px) {
    return px <= 0.0F                          ? 0
           : px >= static_cast<float>(size_px) ? size_px - 1
                                               : static_cast<int>(px);
  }

  int width_px_, height_px_;
  std::vector<glm::vec2> source_px_;
};

}  // namespace segsim::reconstruction::internal
