#pragma once

/// @file
/// The differentiable rasterizer as plainly as its formulas allow: every pixel goes through
/// all surfels near it, in the order of their depths. No lists, no vectors, no shortcuts.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <thread>
#include <utility>
#include <vector>

#include "core/camera.h"
#include "reconstruction/rasterizer/surfel_activation.h"
#include "renderer/scene/projection_camera.h"
#include "renderer/scene/render_options.h"
#include "tests/reconstruction/training/training_surfels.h"

namespace segsim::reconstruction::testing {

template <class Real>
class PlainRasterizer {
 public:
  struct Weight {
    std::int32_t surfel;
    Real weight;
  };

  PlainRasterizer(const OwnedSurfels<Real>& surfels, const core::CameraIntrinsics& camera,
                  const core::CameraPose& T_world_camera)
      : surfels_(surfels),
        intrinsics_(camera),
        camera_(renderer::internal::projection_camera<Real>(T_world_camera, camera)),
        key_camera_(renderer::internal::projection_camera<float>(T_world_camera, camera)) {
    for (std::int64_t i = 0; i < surfels.count(); ++i) project(i);
    std::sort(drawn_.begin(), drawn_.end(), [](const Drawn& a, const Drawn& b) {
      return std::pair(a.key, a.id) < std::pair(b.key, b.id);
    });
  }

  /// Images, then gradients; `weights` receives a row for every pixel.
  void run(const OwnedImages<Real>& loss, OwnedImages<Real>& images,
           OwnedGradients<Real>& gradients, std::vector<Real>& max_weight,
           std::vector<std::vector<Weight>>& weights) const {
    const auto count = static_cast<std::size_t>(surfels_.count());
    max_weight.assign(count, Real(0));
    weights.assign(images.area(), {});
    constexpr int kThreads = 16;
    std::vector<std::vector<LocalGradient<Real>>> parts(kThreads);
    std::vector<std::thread> threads;
    for (int t = 0; t < kThreads; ++t) {
      threads.emplace_back([&, t] {
        auto& sums = parts[static_cast<std::size_t>(t)];
        sums.resize(count);
        for (int y = t; y < intrinsics_.height_px; y += kThreads) {
          draw_row(y, loss, images, sums, weights);
        }
      });
    }
    for (std::thread& thread : threads) thread.join();
    for (const auto& row : weights) {
      for (const Weight& w : row) {
        Real& most = max_weight[static_cast<std::size_t>(w.surfel)];
        most = std::max(most, w.weight);
      }
    }
    for (std::int64_t i = 0; i < surfels_.count(); ++i) {
      write_zero_gradients(surfels_.view(), i, gradients.view());
    }
    for (const Drawn& d : drawn_) {
      LocalGradient<Real> sum;
      for (const auto& part : parts) add(part[static_cast<std::size_t>(d.id)], sum);
      write_gradients(surfels_.view(), d.id, camera_, intrinsics_.width_px,
                      intrinsics_.height_px, sum, gradients.view());
    }
  }

 private:
  struct Drawn {
    float key;
    std::int64_t id;
    DrawnSurfel<Real> surfel;
    double x_lo, x_hi, y_lo, y_hi;  ///< Pixel centres that it may reach, generously.
  };

  void project(std::int64_t i) {
    const SurfelParameters<Real> view = surfels_.view();
    const renderer::Vec3<Real> p = load_vec3(view.position_m, i);
    constexpr float kNearM = renderer::RenderOptions{}.near_m;
    Drawn d;
    d.id = i;
    d.key = renderer::depth_of_centre(
        key_camera_, renderer::Vec3<float>{static_cast<float>(p.x), static_cast<float>(p.y),
                                           static_cast<float>(p.z)});
    if (!(d.key > kNearM)) return;
    const ActiveSurfel<Real> active = activate(view, i);
    const Real k2 = renderer::extent_squared(active.opacity);
    if (!(k2 > Real(0))) return;
    const renderer::SurfelProjection<Real> s =
        renderer::project_surfel(camera_, p, scaled(active.t_u, active.scale_u_m),
                                 scaled(active.t_v, active.scale_v_m));
    d.surfel = drawn_surfel(active, s, k2, Real(kNearM), camera_);
    d.surfel.colour = colour_of(view, i, camera_);
    d.x_lo = d.y_lo = 0.0;
    d.x_hi = intrinsics_.width_px, d.y_hi = intrinsics_.height_px;
    if (!renderer::crosses_near_plane(s, k2 * Real(1.01), Real(kNearM))) {
      const renderer::ScreenBox<Real> box =
          renderer::with_low_pass(renderer::box_of(renderer::outline_of_disc(s, k2)), s, k2);
      constexpr double kMarginPx = 1.0;
      d.x_lo = static_cast<double>(box.x_min_px) - kMarginPx;
      d.x_hi = static_cast<double>(box.x_max_px) + kMarginPx;
      d.y_lo = static_cast<double>(box.y_min_px) - kMarginPx;
      d.y_hi = static_cast<double>(box.y_max_px) + kMarginPx;
      if (d.x_hi < 0.0 || d.y_hi < 0.0 || d.x_lo > intrinsics_.width_px ||
          d.y_lo > intrinsics_.height_px) {
        return;
      }
    }
    drawn_.push_back(d);
  }

  void draw_row(int y, const OwnedImages<Real>& loss, OwnedImages<Real>& images,
                std::vector<LocalGradient<Real>>& gradients,
                std::vector<std::vector<Weight>>& weights) const {
    std::vector<const Drawn*> row;
    const double y_px = y + 0.5;
    for (const Drawn& d : drawn_) {
      if (d.y_lo <= y_px && y_px <= d.y_hi) row.push_back(&d);
    }
    std::vector<std::pair<const Drawn*, SurfelHit<Real>>> met;
    for (int x = 0; x < intrinsics_.width_px; ++x) {
      const double x_px = x + 0.5;
      const std::size_t at = static_cast<std::size_t>(y) * intrinsics_.width_px + x;
      PixelSums<Real> sums;
      met.clear();
      for (const Drawn* d : row) {
        SurfelHit<Real> hit;
        if (x_px < d->x_lo || x_px > d->x_hi ||
            !meet_surfel(d->surfel, Real(x_px), Real(y_px), hit)) {
          continue;
        }
        const Real weight = blend_hit(d->surfel, hit, sums);
        if (weight < Real(0)) break;
        met.emplace_back(d, hit);
        weights[at].push_back({static_cast<std::int32_t>(d->id), weight});
      }
      write(at, sums, images);
      PixelAdjoint<Real> pixel = begin_adjoint(loss_at(at, loss), sums);
      for (const auto& [d, hit] : met) {
        const HitGradient<Real> by = unblend_hit(d->surfel, hit, pixel);
        add_hit_gradient(d->surfel, hit, pixel.loss, by,
                         gradients[static_cast<std::size_t>(d->id)]);
      }
    }
  }

  static void write(std::size_t at, const PixelSums<Real>& sums, OwnedImages<Real>& images) {
    images.rgb[3 * at] = sums.rgb.x, images.rgb[3 * at + 1] = sums.rgb.y;
    images.rgb[3 * at + 2] = sums.rgb.z;
    images.depth_m[at] = sums.depth_m;
    images.alpha[at] = Real(1) - sums.transmittance;
    images.normal[3 * at] = sums.normal.x, images.normal[3 * at + 1] = sums.normal.y;
    images.normal[3 * at + 2] = sums.normal.z;
    images.median_m[at] = sums.median_m;
    images.distortion[at] = distortion_of(sums);
  }

  static PixelLoss<Real> loss_at(std::size_t at, const OwnedImages<Real>& loss) {
    const auto vector = [at](const std::vector<Real>& v) {
      return renderer::Vec3<Real>{v[3 * at], v[3 * at + 1], v[3 * at + 2]};
    };
    return {vector(loss.rgb), loss.depth_m[at], loss.alpha[at], vector(loss.normal),
            loss.distortion[at]};
  }

  static void add(const LocalGradient<Real>& from, LocalGradient<Real>& to) {
    to.m00 += from.m00, to.m01 += from.m01, to.m10 += from.m10, to.m11 += from.m11;
    to.g0 += from.g0, to.g1 += from.g1, to.x0 += from.x0, to.y0 += from.y0;
    to.z0 += from.z0, to.reach += from.reach, to.log_opacity += from.log_opacity;
    to.colour.x += from.colour.x, to.colour.y += from.colour.y, to.colour.z += from.colour.z;
    to.normal.x += from.normal.x, to.normal.y += from.normal.y, to.normal.z += from.normal.z;
  }

  const OwnedSurfels<Real>& surfels_;
  core::CameraIntrinsics intrinsics_;
  renderer::ProjectionCamera<Real> camera_;
  renderer::ProjectionCamera<float> key_camera_;
  std::vector<Drawn> drawn_;
};

}  // namespace segsim::reconstruction::testing
