#include "reconstruction/stereo/internal/plane_sweep.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/process/vector_clones.h"

namespace segsim::reconstruction::internal {
namespace {

// Part of each clone of sweep_plane().
#define SEGSIM_STEREO_INLINE [[gnu::always_inline]] inline

constexpr int kRadius_px = 2;
constexpr float kWindow = (2 * kRadius_px + 1) * (2 * kRadius_px + 1);
constexpr float kGreyUnit = 1.0F / 65280.0F;
/// Noise of 2 of 255 grey levels: below it there is nothing to correlate.
constexpr float kNoise = (2.0F / 255.0F) * (2.0F / 255.0F);
constexpr float kStep_px = 1.0F;
constexpr int kFewestPlanes = 16, kMostPlanes = 192, kPlanesMultiple = 8;

/// Grey values around 0: differences of squares lose fewer digits.
core::Image<float> centred(const core::Image<std::uint16_t>& grey) {
  core::Image<float> result(grey.width_px(), grey.height_px());
  for (std::size_t i = 0; i < grey.size(); ++i) {
    result.pixels()[i] = static_cast<float>(grey.pixels()[i]) * kGreyUnit - 0.5F;
  }
  return result;
}

/// Sums over windows, cut at the border by repeating the outermost pixels.
class WindowSums {
 public:
  WindowSums(int width_px, int height_px)
      : width_(width_px), height_(height_px), columns_(width_px + 2 * kRadius_px) {}

  /// Writes the sums of row y of a(x) b(x) to `sums`.
  SEGSIM_STEREO_INLINE void products(const core::Image<float>& a, const core::Image<float>& b,
                                     int y, float* sums) {
    float* inner = columns_.data() + kRadius_px;
    std::fill(columns_.begin(), columns_.end(), 0.0F);
    for (int dy = -kRadius_px; dy <= kRadius_px; ++dy) {
      const int v = std::clamp(y + dy, 0, height_ - 1);
      const float *p = a.row(v), *q = b.row(v);
      for (int x = 0; x < width_; ++x) inner[x] += p[x] * q[x];
    }
    across(sums);
  }
  SEGSIM_STEREO_INLINE void values(const core::Image<float>& a, int y, float* sums) {
    float* inner = columns_.data() + kRadius_px;
    std::fill(columns_.begin(), columns_.end(), 0.0F);
    for (int dy = -kRadius_px; dy <= kRadius_px; ++dy) {
      const float* p = a.row(std::clamp(y + dy, 0, height_ - 1));
      for (int x = 0; x < width_; ++x) inner[x] += p[x];
    }
    across(sums);
  }

 private:
  SEGSIM_STEREO_INLINE void across(float* sums) {
    const std::size_t last = columns_.size() - kRadius_px - 1;
    for (int i = 0; i < kRadius_px; ++i) {
      columns_[i] = columns_[kRadius_px];
      columns_[last + 1 + i] = columns_[last];
    }
    const float* c = columns_.data();
    static_assert(kRadius_px == 2);
    for (int x = 0; x < width_; ++x) {
      sums[x] = c[x] + c[x + 1] + c[x + 2] + c[x + 3] + c[x + 4];
    }
  }

  int width_, height_;
  std::vector<float> columns_;
};

/// Where a row of pixels lands in a source: the pixel above and left, and the shares of the
/// next ones.
struct Landing {
  explicit Landing(int width_px) : pixel(width_px), right(width_px), down(width_px) {}
  std::vector<int> pixel;  ///< Index in the source.
  std::vector<float> right, down;
};

/// Takes the source's picture at the plane's inverse depth; `seen` is 0 out of its view.
SEGSIM_STEREO_INLINE void warp(const core::Image<float>& source, const ViewWarp& map,
                               float inverse_m, Landing& landing, core::Image<float>& warped,
                               core::Image<float>& seen) {
  const int width = source.width_px(), height = source.height_px();
  const glm::vec3 at_origin = map.a * glm::vec3(0.5F, 0.5F, 1.0F) + inverse_m * map.b;
  const glm::vec3 by_x = map.a[0];
  const float largest_x = static_cast<float>(width) - 1.001F;
  const float largest_y = static_cast<float>(height) - 1.001F;
  int* pixel = landing.pixel.data();
  float *right = landing.right.data(), *down = landing.down.data();
  for (int y = 0; y < warped.height_px(); ++y) {
    const glm::vec3 start = at_origin + static_cast<float>(y) * map.a[1];
    float *out = warped.row(y), *valid = seen.row(y);
    for (int x = 0; x < width; ++x) {
      const auto along = static_cast<float>(x);
      const float hz = start.z + along * by_x.z;
      const float scale = 1.0F / std::max(hz, 1e-6F);
      const float u = (start.x + along * by_x.x) * scale - 0.5F;
      const float v = (start.y + along * by_x.y) * scale - 0.5F;
      const float cu = std::min(std::max(u, 0.0F), largest_x);
      const float cv = std::min(std::max(v, 0.0F), largest_y);
      valid[x] = ((hz > 1e-6F) & (cu == u) & (cv == v)) ? 1.0F : 0.0F;
      const int iu = static_cast<int>(cu), iv = static_cast<int>(cv);
      pixel[x] = iv * width + iu;
      right[x] = cu - static_cast<float>(iu);
      down[x] = cv - static_cast<float>(iv);
    }
    const float* grey = source.data();
    for (int x = 0; x < width; ++x) {
      const float *p = grey + pixel[x], *q = p + width;
      const float top = p[0] + right[x] * (p[1] - p[0]);
      const float bottom = q[0] + right[x] * (q[1] - q[0]);
      out[x] = top + down[x] * (bottom - top);
    }
  }
}

/// Sums of the reference's windows, which no plane changes.
struct ReferenceSums {
  core::Image<float> mean, variance;  ///< Variance with noise.
};

ReferenceSums reference_sums(const core::Image<float>& reference) {
  const int width = reference.width_px(), height = reference.height_px();
  ReferenceSums result{core::Image<float>(width, height), core::Image<float>(width, height)};
  WindowSums sums(width, height);
  std::vector<float> square(width);
  for (int y = 0; y < height; ++y) {
    sums.values(reference, y, result.mean.row(y));
    sums.products(reference, reference, y, square.data());
    for (int x = 0; x < width; ++x) {
      float& mean = result.mean(x, y);
      mean /= kWindow;
      result.variance(x, y) = std::max(0.0F, square[x] / kWindow - mean * mean) + kNoise;
    }
  }
  return result;
}

/// The costs of all sources at one plane, smallest first, as far as they are wanted.
class PlaneCosts {
 public:
  PlaneCosts(int width_px, std::size_t sources)
      : wanted_((sources + 1) / 2), rows_(wanted_, std::vector<float>(width_px)) {}
  SEGSIM_STEREO_INLINE void clear() {
    for (std::vector<float>& row : rows_) std::fill(row.begin(), row.end(), 1.0F);
  }
  SEGSIM_STEREO_INLINE void add(std::vector<float>& cost) {
    for (std::vector<float>& row : rows_) {
      for (std::size_t x = 0; x < row.size(); ++x) {
        const float low = std::min(row[x], cost[x]);
        cost[x] = std::max(row[x], cost[x]);
        row[x] = low;
      }
    }
  }
  [[nodiscard]] std::uint8_t mean(int x) const {
    float sum = 0.0F;
    for (const std::vector<float>& row : rows_) sum += row[x];
    // Rounds in the vector loop, which a call of lround() would break.
    // NOLINTNEXTLINE(bugprone-incorrect-roundings)
    return static_cast<std::uint8_t>(kWorstCost * sum / static_cast<float>(wanted_) + 0.5F);
  }

 private:
  std::size_t wanted_;
  std::vector<std::vector<float>> rows_;
};

/// What sweeping needs of one reference and its sources.
struct Sweep {
  Sweep(const core::Image<std::uint16_t>& grey,
        std::span<const core::Image<std::uint16_t>* const> sources)
      : reference(centred(grey)),
        own(reference_sums(reference)),
        sums(grey.width_px(), grey.height_px()),
        costs(grey.width_px(), sources.size()),
        landing(grey.width_px()) {
    for (const core::Image<std::uint16_t>* source : sources) {
      pictures.push_back(centred(*source));
      warped.emplace_back(grey.width_px(), grey.height_px());
      seen.emplace_back(grey.width_px(), grey.height_px());
    }
    for (std::vector<float>* row : {&sum, &square, &product, &cost}) {
      row->resize(static_cast<std::size_t>(grey.width_px()));
    }
  }
  core::Image<float> reference;
  ReferenceSums own;
  std::vector<core::Image<float>> pictures, warped, seen;
  WindowSums sums;
  PlaneCosts costs;
  Landing landing;
  std::vector<float> sum, square, product, cost;
};

SEGSIM_VECTOR_CLONES
void sweep_plane(Sweep& work, std::span<const ViewWarp> warps, int plane, CostVolume& volume) {
  const float inverse_m = volume.planes.inverse_m(static_cast<float>(plane));
  for (std::size_t s = 0; s < warps.size(); ++s) {
    warp(work.pictures[s], warps[s], inverse_m, work.landing, work.warped[s], work.seen[s]);
  }
  const float *sum = work.sum.data(), *square = work.square.data();
  const float* product = work.product.data();
  float* cost = work.cost.data();
  for (int y = 0; y < volume.height_px; ++y) {
    const float *mean = work.own.mean.row(y), *variance = work.own.variance.row(y);
    work.costs.clear();
    for (std::size_t s = 0; s < warps.size(); ++s) {
      const core::Image<float>& warped = work.warped[s];
      work.sums.values(warped, y, work.sum.data());
      work.sums.products(warped, warped, y, work.square.data());
      work.sums.products(work.reference, warped, y, work.product.data());
      const float* valid = work.seen[s].row(y);
      for (int x = 0; x < volume.width_px; ++x) {
        const float m = sum[x] / kWindow;
        const float v = std::max(0.0F, square[x] / kWindow - m * m) + kNoise;
        const float covariance = product[x] / kWindow - m * mean[x];
        const float alike = valid[x] * covariance / std::sqrt(v * variance[x]);
        cost[x] = std::min(1.0F, std::max(0.0F, 1.0F - alike));
      }
      work.costs.add(work.cost);
    }
    std::uint8_t* out = volume.at(0, y) + plane;
    for (int x = 0; x < volume.width_px; ++x) {
      out[static_cast<std::ptrdiff_t>(x) * volume.planes.count] = work.costs.mean(x);
    }
  }
}

}  // namespace

SweepPlanes sweep_planes(const DepthRange& range, std::span<const ViewWarp> warps,
                         const core::CameraIntrinsics& camera) {
  SEGSIM_CHECK(range.near_m > 0.0 && range.near_m < range.far_m, "depth range");
  SEGSIM_CHECK(!warps.empty(), "sources");
  const auto near_inverse = static_cast<float>(1.0 / range.near_m);
  const auto far_inverse = static_cast<float>(1.0 / range.far_m);
  float sum_px = 0.0F;
  for (const ViewWarp& map : warps) {
    const glm::vec3 middle =
        map.a * glm::vec3(0.5F * static_cast<float>(camera.width_px),
                          0.5F * static_cast<float>(camera.height_px), 1.0F);
    // Disparity by inverse depth, where the middle of the image lands far away.
    const float gain = glm::length(glm::vec2(map.b) - glm::vec2(middle) / middle.z * map.b.z) /
                       std::max(middle.z, 0.3F);
    sum_px += gain * (near_inverse - far_inverse);
  }
  const float parallax_px = sum_px / static_cast<float>(warps.size());
  const int wanted =
      std::clamp(static_cast<int>(parallax_px / kStep_px) + 2, kFewestPlanes, kMostPlanes);
  SweepPlanes planes;
  planes.count = (wanted + kPlanesMultiple - 1) / kPlanesMultiple * kPlanesMultiple;
  planes.first_inverse_m = far_inverse;
  planes.step_inverse_m = (near_inverse - far_inverse) / static_cast<float>(planes.count - 1);
  return planes;
}

CostVolume sweep(const core::Image<std::uint16_t>& reference,
                 std::span<const core::Image<std::uint16_t>* const> sources,
                 std::span<const ViewWarp> warps, const SweepPlanes& planes) {
  SEGSIM_CHECK(!sources.empty() && sources.size() == warps.size(), "sources");
  const int width = reference.width_px(), height = reference.height_px();
  CostVolume volume{width, height, planes, {}};
  volume.cost.resize(static_cast<std::size_t>(width) * height * planes.count);
  Sweep work(reference, sources);
  for (int plane = 0; plane < planes.count; ++plane) sweep_plane(work, warps, plane, volume);
  return volume;
}

void seed_costs(std::span<const glm::vec3> points_m, const core::CameraIntrinsics& camera,
                CostVolume& volume) {
  constexpr int kCheaper = 4;
  const SweepPlanes& planes = volume.planes;
  for (const glm::vec3& p_m : points_m) {
    const glm::dvec2 px = camera.project(glm::dvec3(p_m));
    const float plane = (1.0F / p_m.z - planes.first_inverse_m) / planes.step_inverse_m;
    if (!(plane >= 0.0F && plane <= static_cast<float>(planes.count - 1))) continue;
    if (!(std::abs(px.x) < 1e6 && std::abs(px.y) < 1e6)) continue;
    const int nearest = static_cast<int>(std::lround(plane));
    const int x = static_cast<int>(std::floor(px.x)), y = static_cast<int>(std::floor(px.y));
    for (int v = std::max(0, y - 1); v <= std::min(volume.height_px - 1, y + 1); ++v) {
      for (int u = std::max(0, x - 1); u <= std::min(volume.width_px - 1, x + 1); ++u) {
        std::uint8_t& cost = volume.at(u, v)[nearest];
        cost = static_cast<std::uint8_t>(cost / kCheaper);
      }
    }
  }
}

}  // namespace segsim::reconstruction::internal
