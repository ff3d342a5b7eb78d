#include "reconstruction/inspection/rig_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include <Eigen/Dense>
#include <glm/geometric.hpp>
#include <opencv2/imgproc.hpp>

#include "core/check.h"
#include "core/formatted.h"
#include "reconstruction/inspection/internal/edge_maps.h"
#include "reconstruction/inspection/internal/grey_image.h"
#include "reconstruction/inspection/internal/median.h"
#include "reconstruction/inspection/internal/pose_steps.h"
#include "reconstruction/lifting/parallel_loading.h"

namespace segsim::reconstruction {

using internal::ContourPoint;
using internal::DirectedEdges;

struct RigView::Impl {
  DirectedEdges edges;
  std::vector<ContourPoint> points;
  std::optional<double> time_s, depth_time_s;
};

namespace {

constexpr int kWidth_px = 320;
constexpr std::size_t kMostPoints = 1200;  ///< Of a view.
constexpr std::size_t kFewestPoints = 1500, kFewestViews = 8;
constexpr int kFolds = 4;
constexpr double kSmallestContrast = 0.04;  ///< Of the best agreement against chance.
constexpr double kLargestError_px = 0.6;    ///< Of the reduced picture.
constexpr double kFarthest_m = 0.2, kFarthest_rad = 8.0 * std::numbers::pi / 180.0;
constexpr double kFarthest_s = 0.25;
constexpr double kReach_px = 1.5;  ///< At which agreement is told.
/// What holds parameters that contours tell nothing about: standard deviations.
constexpr double kPrior_m = 0.05, kPrior_rad = 0.05, kPrior_s = 0.1;
constexpr double kNoise_px = 0.7;     ///< Of an edge, against these.
constexpr double kCorrelated = 30.0;  ///< So many neighbouring contour points err alike.

constexpr int kParameters = 7;
/// Turn about x, y, z [rad], shift along x, y, z [m], time [s]: on top of the start.
using Parameters = Eigen::Matrix<double, kParameters, 1>;
constexpr std::array<double, kParameters> kSteps{1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3};

glm::dquat turn(const glm::dvec3& v_rad) {
  const double angle_rad = glm::length(v_rad);
  if (angle_rad < 1e-12) return {1.0, 0.0, 0.0, 0.0};
  return glm::angleAxis(angle_rad, v_rad / angle_rad);
}

RigOffset offset_of(const Parameters& p, const RigOffset& start) {
  const CameraToCamera T{turn({p[0], p[1], p[2]}), {p[3], p[4], p[5]}};
  return {T * start.T_color_depth, start.depth_time_s + p[6]};
}

class Fitter {
 public:
  Fitter(std::vector<const RigView::Impl*> views, const core::CameraIntrinsics& camera,
         const PoseTrack& track, const RigFitOptions& options)
      : views_(std::move(views)), track_(track), options_(options) {
    if (!views_.empty()) {
      camera_ = camera.resized(views_[0]->edges.width_px(), views_[0]->edges.height_px());
    }
    for (int k = 0; k < kParameters; ++k) {
      if (k < 6 ? options.fit_place : options.fit_time) free_.push_back(k);
    }
  }

  [[nodiscard]] double agreement(const Parameters& p, double reach_px, int without = -1,
                                 std::size_t stride = 1,
                                 const glm::dvec2& shift_px = {}) const;
  /// The best of shifts (and times) of the whole picture, refined.
  [[nodiscard]] Parameters search() const;
  /// @param without  This fold of the views has no say; -1: all have.
  [[nodiscard]] Parameters refine(Parameters p, std::initializer_list<double> reaches_px,
                                  int without = -1) const;
  /// Of contours, the middle one [px of the reduced picture].
  [[nodiscard]] double displacement_px(const Parameters& a, const Parameters& b) const;
  /// What chance gives: pictures shifted by much more than any offset.
  [[nodiscard]] double chance(const Parameters& p) const;

 private:
  using Transforms = std::vector<CameraToCamera>;

  /// From depth camera to colour image, for each view.
  [[nodiscard]] Transforms transforms(const Parameters& p) const {
    const RigOffset offset = offset_of(p, options_.start);
    Transforms result;
    result.reserve(views_.size());
    for (const RigView::Impl* view : views_) {
      CameraToCamera T = offset.T_color_depth;
      if (options_.use_times && view->time_s && view->depth_time_s) {
        const auto now = track_.at(*view->time_s);
        const auto then = track_.at(*view->depth_time_s + offset.depth_time_s);
        if (now && then) T = now->inverse() * *then * T;
      }
      result.push_back(T);
    }
    return result;
  }
  [[nodiscard]] glm::dvec2 project(const CameraToCamera& T, const ContourPoint& point) const {
    return camera_.project(
        (T * core::Point<core::frame::Camera>{glm::dvec3(point.p_camera_m)}).xyz_m);
  }
  /// Normal equations of one step; returns the agreement.
  double linearise(const Parameters& p, double reach_px, int without, Eigen::MatrixXd& normal,
                   Eigen::VectorXd& right) const;

  std::vector<const RigView::Impl*> views_;
  const PoseTrack& track_;
  const RigFitOptions& options_;
  core::CameraIntrinsics camera_;
  std::vector<int> free_;
};

double Fitter::agreement(const Parameters& p, double reach_px, int without, std::size_t stride,
                         const glm::dvec2& shift_px) const {
  const Transforms T = transforms(p);
  const double falloff = -0.5 / (reach_px * reach_px);
  double sum = 0.0, points = 0.0;
  for (std::size_t v = 0; v < views_.size(); ++v) {
    if (static_cast<int>(v % kFolds) == without) continue;
    const RigView::Impl& view = *views_[v];
    for (std::size_t i = v % stride; i < view.points.size(); i += stride) {
      const auto sample =
          view.edges.at(view.points[i].direction, project(T[v], view.points[i]) + shift_px);
      if (sample.distance_px < 0.0F) continue;
      sum += std::exp(falloff * sample.distance_px * sample.distance_px);
      points += 1.0;
    }
  }
  return points > 0.0 ? sum / points : 0.0;
}

double Fitter::linearise(const Parameters& p, double reach_px, int without,
                         Eigen::MatrixXd& normal, Eigen::VectorXd& right) const {
  const auto n = static_cast<Eigen::Index>(free_.size());
  normal.setZero(n, n);
  right.setZero(n);
  const Transforms T = transforms(p);
  std::vector<Transforms> moved;
  for (const int k : free_) {
    Parameters q = p;
    q[k] += kSteps[static_cast<std::size_t>(k)];
    moved.push_back(transforms(q));
  }
  const double falloff = -0.5 / (reach_px * reach_px);
  double sum = 0.0, points = 0.0;
  Eigen::VectorXd row(n);
  for (std::size_t v = 0; v < views_.size(); ++v) {
    if (static_cast<int>(v % kFolds) == without) continue;
    for (const ContourPoint& point : views_[v]->points) {
      const glm::dvec2 px = project(T[v], point);
      const auto sample = views_[v]->edges.at(point.direction, px);
      if (sample.distance_px < 0.0F) continue;
      const double d = sample.distance_px, weight = std::exp(falloff * d * d);
      sum += weight, points += 1.0;
      if (weight < 1e-4) continue;
      for (Eigen::Index k = 0; k < n; ++k) {
        const auto at = static_cast<std::size_t>(k);
        const glm::dvec2 moved_px = project(moved[at][v], point) - px;
        row[k] = glm::dot(glm::dvec2(sample.gradient), moved_px) /
                 kSteps[static_cast<std::size_t>(free_[at])];
      }
      normal.noalias() += weight * row * row.transpose();
      right.noalias() -= weight * d * row;
    }
  }
  for (Eigen::Index k = 0; k < n; ++k) {
    const int of = free_[static_cast<std::size_t>(k)];
    const double sigma = of < 3 ? kPrior_rad : of < 6 ? kPrior_m : kPrior_s;
    const double weight = kCorrelated * kNoise_px * kNoise_px / (sigma * sigma);
    normal(k, k) += weight;
    right[k] -= weight * p[of];
  }
  return points > 0.0 ? sum / points : 0.0;
}

Parameters Fitter::refine(Parameters p, std::initializer_list<double> reaches_px,
                          int without) const {
  constexpr int kIterations = 12;
  Eigen::MatrixXd normal;
  Eigen::VectorXd right;
  for (const double reach_px : reaches_px) {
    double damping = 1e-3;
    double now = linearise(p, reach_px, without, normal, right);
    for (int i = 0; i < kIterations && damping < 1e3; ++i) {
      Eigen::MatrixXd damped = normal;
      damped.diagonal() *= 1.0 + damping;
      const Eigen::VectorXd step = damped.ldlt().solve(right);
      Parameters next = p;
      for (std::size_t k = 0; k < free_.size(); ++k) {
        next[free_[k]] += step[static_cast<Eigen::Index>(k)];
      }
      const double then = agreement(next, reach_px, without);
      if (!(then > now)) {
        damping *= 10.0;
        continue;
      }
      const bool done = then - now < 1e-6;
      p = next, damping = std::max(1e-6, 0.1 * damping);
      if (done) break;
      now = linearise(p, reach_px, without, normal, right);
    }
  }
  return p;
}

Parameters Fitter::search() const {
  constexpr std::size_t kBegins = 4, kStride = 4;
  constexpr double kReach = 4.0;
  constexpr int kShifts = 4;
  constexpr double kShift_px = 3.5, kTimeStep_s = 0.02;
  constexpr int kTimes = 6;
  std::vector<std::pair<double, Parameters>> tried;
  for (int t = -kTimes; t <= kTimes; ++t) {
    if (t != 0 && !options_.fit_time) continue;
    for (int y = -kShifts; y <= kShifts; ++y) {
      for (int x = -kShifts; x <= kShifts; ++x) {
        // With time alone the picture cannot be shifted.
        if ((x != 0 || y != 0) && (!options_.fit_place || t % 2 != 0)) continue;
        Parameters p = Parameters::Zero();
        p[0] = -y * kShift_px / camera_.fy_px, p[1] = x * kShift_px / camera_.fx_px;
        p[6] = t * kTimeStep_s;
        tried.emplace_back(agreement(p, kReach, -1, kStride), p);
      }
    }
  }
  std::stable_sort(tried.begin(), tried.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  tried.resize(std::min(tried.size(), kBegins));
  tried.emplace_back(0.0, Parameters::Zero());
  Parameters best = Parameters::Zero();
  double most = -1.0;
  for (const auto& [score, begin] : tried) {
    const Parameters p = refine(begin, {6.0, 4.0, 2.5});
    const double found = agreement(p, kReach_px);
    if (found > most) most = found, best = p;
  }
  return refine(best, {2.0, 1.5, 1.0});
}

double Fitter::displacement_px(const Parameters& a, const Parameters& b) const {
  const Transforms of_a = transforms(a), of_b = transforms(b);
  std::vector<double> moved_px;
  for (std::size_t v = 0; v < views_.size(); ++v) {
    for (const ContourPoint& point : views_[v]->points) {
      moved_px.push_back(glm::distance(project(of_a[v], point), project(of_b[v], point)));
    }
  }
  return internal::median(std::move(moved_px));
}

double Fitter::chance(const Parameters& p) const {
  constexpr double kFar_px = 14.0;
  std::vector<double> all;
  for (int k = 0; k < 12; ++k) {
    const double angle_rad = k * std::numbers::pi / 6.0;
    all.push_back(agreement(p, kReach_px, -1, 1,
                            kFar_px * (1.0 + 0.5 * (k % 3)) *
                                glm::dvec2(std::cos(angle_rad), std::sin(angle_rad))));
  }
  return internal::median(std::move(all));
}

std::string doubt_of(const RigFit& fit, const Parameters& p, double error_px) {
  using core::print;
  if (fit.best - fit.chance < kSmallestContrast) {
    return print(
               "contours of depth lie on edges of colour hardly better than by chance (%.2f, ",
               fit.best) +
           print("by chance %.2f)", fit.chance);
  }
  if (error_px > kLargestError_px) {
    return print("parts of the recording disagree by %.1f px", fit.error_px);
  }
  if (p.head<3>().norm() > kFarthest_rad || p.segment<3>(3).norm() > kFarthest_m ||
      std::abs(p[6]) > kFarthest_s) {
    return print("the best offset is too large to be one (%.1f deg, ",
                 internal::degrees(p.head<3>().norm())) +
           print("%.0f cm, ", 100.0 * p.segment<3>(3).norm()) + print("%.0f ms)", 1e3 * p[6]);
  }
  return {};
}

/// Which views are looked at.
std::vector<std::size_t> choose_frames(const RgbdSequence& sequence, bool moving,
                                       std::size_t most) {
  std::vector<std::size_t> chosen;
  const std::size_t count = std::min(sequence.frame_count(), most);
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t begin = k * sequence.frame_count() / count;
    std::size_t best = begin;
    double most_motion = -1.0;
    for (std::size_t i = begin; moving && i < (k + 1) * sequence.frame_count() / count; ++i) {
      if (i == 0 || i + 1 == sequence.frame_count()) continue;
      const double motion = internal::turn_rad(sequence.pose(i - 1), sequence.pose(i + 1)) +
                            0.5 * internal::way_m(sequence.pose(i - 1), sequence.pose(i + 1));
      if (motion > most_motion) most_motion = motion, best = i;
    }
    chosen.push_back(best);
  }
  return chosen;
}

}  // namespace

RigView::RigView(const RgbdSequence& sequence, std::size_t i, const RgbdFrame& frame) {
  cv::Mat grey = internal::grey_image(frame.rgb);
  const double reduction = std::min(1.0, static_cast<double>(kWidth_px) / grey.cols);
  cv::resize(grey, grey, {}, reduction, reduction, cv::INTER_AREA);
  std::vector<ContourPoint> all = internal::find_contours(
      frame.depth_m,
      sequence.intrinsics().resized(frame.depth_m.width_px(), frame.depth_m.height_px()));
  std::vector<ContourPoint> points;
  const std::size_t count = std::min(all.size(), kMostPoints);
  for (std::size_t k = 0; k < count; ++k) points.push_back(all[k * all.size() / count]);
  impl_ = std::make_unique<Impl>(Impl{DirectedEdges(grey), std::move(points),
                                      sequence.time_s(i), sequence.depth_time_s(i)});
}
RigView::~RigView() = default;
RigView::RigView(RigView&&) noexcept = default;
RigView& RigView::operator=(RigView&&) noexcept = default;

RigFit fit_rig(const std::vector<const RigView*>& views, const core::CameraIntrinsics& camera,
               const PoseTrack& track, const RigFitOptions& options) {
  SEGSIM_CHECK(options.fit_place || options.fit_time, "nothing to fit");
  SEGSIM_CHECK(!options.fit_time || options.use_times, "a fit of time without times");
  RigFit fit;
  fit.offset = options.start;
  std::vector<const RigView::Impl*> used;
  for (const RigView* view : views) {
    if (view->impl().points.empty()) continue;
    used.push_back(&view->impl());
    fit.contour_points += view->impl().points.size();
  }
  fit.views = used.size();
  if (fit.views < kFewestViews || fit.contour_points < kFewestPoints) {
    fit.doubt = core::print("too little to go by: %zu contour points in %zu views",
                            fit.contour_points, fit.views);
    return fit;
  }
  const double per_px = static_cast<double>(camera.width_px) / used[0]->edges.width_px();
  const Fitter fitter(used, camera, track, options);
  const Parameters start = Parameters::Zero();
  const Parameters best = fitter.search();
  fit.offset = offset_of(best, options.start);
  fit.given = fitter.agreement(start, kReach_px);
  fit.best = fitter.agreement(best, kReach_px);
  fit.chance = fitter.chance(best);

  // Jackknife: (n - 1) / n times the sum of squares about the whole.
  double squares_px = 0.0;
  Parameters squares = Parameters::Zero();
  for (int fold = 0; fold < kFolds; ++fold) {
    const Parameters p = fitter.refine(best, {2.5, 1.5, 1.0}, fold);
    squares_px += std::pow(fitter.displacement_px(best, p), 2);
    squares += (p - best).cwiseAbs2();
  }
  constexpr double kShare = (kFolds - 1.0) / kFolds;
  const double error_px = std::sqrt(kShare * squares_px);
  squares *= kShare;
  fit.rotation_error_deg = internal::degrees(std::sqrt(squares.head<3>().sum()));
  fit.translation_error_m = std::sqrt(squares.segment<3>(3).sum());
  fit.time_error_s = std::sqrt(squares[6]);
  fit.displacement_px = per_px * fitter.displacement_px(start, best);
  fit.error_px = per_px * error_px;
  fit.doubt = doubt_of(fit, best, error_px);
  return fit;
}

RigFit fit_rig(const RgbdSequence& sequence, const RigFitOptions& options,
               std::size_t most_views) {
  const std::vector<std::size_t> frames =
      choose_frames(sequence, options.fit_time, most_views);
  std::vector<std::optional<RigView>> views(frames.size());
  internal::load_each(frames.size(), [&](std::size_t k) {
    const RgbdFrame frame = sequence.load(frames[k]);
    if (!frame.depth_m.empty()) views[k].emplace(sequence, frames[k], frame);
  });
  std::vector<const RigView*> seen;
  for (const std::optional<RigView>& view : views) {
    if (view) seen.push_back(&*view);
  }
  return fit_rig(seen, sequence.intrinsics(), sequence.pose_track(), options);
}

}  // namespace segsim::reconstruction
