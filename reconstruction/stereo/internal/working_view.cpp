#include "reconstruction/stereo/internal/working_view.h"

#include <algorithm>
#include <cmath>

#include <glm/gtc/quaternion.hpp>

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

/// ITU-R BT.601, in 1/65536.
constexpr std::uint32_t kRed = 19595, kGreen = 38470, kBlue = 7471;

/// The pixels that lie in one of `count` equal parts of `size`, at least one.
struct Span {
  int begin, end;
};

Span part(int i, int count, int size) {
  const auto at = [&](int k) {
    return static_cast<int>(static_cast<std::int64_t>(k) * size / count);
  };
  return {at(i), std::max(at(i) + 1, at(i + 1))};
}

}  // namespace

core::Image<std::uint16_t> grey_of(const core::Image<core::Rgb8>& rgb, int width_px,
                                   int height_px) {
  core::Image<std::uint16_t> grey(width_px, height_px);
  for (int y = 0; y < height_px; ++y) {
    const Span rows = part(y, height_px, rgb.height_px());
    for (int x = 0; x < width_px; ++x) {
      const Span columns = part(x, width_px, rgb.width_px());
      std::uint64_t sum = 0;
      for (int v = rows.begin; v < rows.end; ++v) {
        const core::Rgb8* row = rgb.row(v);
        for (int u = columns.begin; u < columns.end; ++u) {
          sum += kRed * row[u].r + kGreen * row[u].g + kBlue * row[u].b;
        }
      }
      const auto pixels = static_cast<std::uint64_t>(rows.end - rows.begin) *
                          static_cast<std::uint64_t>(columns.end - columns.begin);
      grey(x, y) = static_cast<std::uint16_t>(sum / (256 * pixels));
    }
  }
  return grey;
}

core::Image<std::uint16_t> shrunk(const core::Image<std::uint16_t>& grey, int factor) {
  SEGSIM_CHECK(factor >= 1, std::to_string(factor));
  core::Image<std::uint16_t> small(grey.width_px() / factor, grey.height_px() / factor);
  for (int y = 0; y < small.height_px(); ++y) {
    for (int x = 0; x < small.width_px(); ++x) {
      std::uint32_t sum = 0;
      for (int v = 0; v < factor; ++v) {
        for (int u = 0; u < factor; ++u) sum += grey(x * factor + u, y * factor + v);
      }
      small(x, y) = static_cast<std::uint16_t>(sum / static_cast<unsigned>(factor * factor));
    }
  }
  return small;
}

ViewWarp warp_between(const core::CameraPose& T_world_from, const core::CameraPose& T_world_to,
                      const core::CameraIntrinsics& camera) {
  const auto T_to_from = T_world_to.inverse() * T_world_from;
  // Columns of K and of its inverse; pixel (x, y) here is the image position, centre at + 0.5.
  const glm::dmat3 K(camera.fx_px, 0.0, 0.0, 0.0, camera.fy_px, 0.0, camera.cx_px,
                     camera.cy_px, 1.0);
  const glm::dmat3 inverse_intrinsics(1.0 / camera.fx_px, 0.0, 0.0, 0.0, 1.0 / camera.fy_px,
                                      0.0, -camera.cx_px / camera.fx_px,
                                      -camera.cy_px / camera.fy_px, 1.0);
  return {glm::mat3(K * glm::mat3_cast(T_to_from.rotation()) * inverse_intrinsics),
          glm::vec3(K * T_to_from.translation_m())};
}

}  // namespace segsim::reconstruction::internal
