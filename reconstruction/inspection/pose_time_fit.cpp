#include "reconstruction/inspection/pose_time_fit.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>
#include <opencv2/imgproc.hpp>

#include "core/formatted.h"
#include "reconstruction/inspection/internal/grey_image.h"
#include "reconstruction/inspection/internal/median.h"
#include "reconstruction/lifting/parallel_loading.h"

namespace segsim::reconstruction {
namespace {

constexpr int kWidth_px = 160;
constexpr std::size_t kRuns = 24, kRunFrames = 13;
constexpr double kWidestStep_s = 0.25;  ///< Between two pictures of a pair.
constexpr double kFarthest_s = 0.25, kStep_s = 0.01;
constexpr double kCap_px = 3.0;          ///< A difference beyond says no more.
constexpr double kWithoutDepth_m = 3.0;  ///< Distance that is assumed.
constexpr int kGrid = 10;                ///< Points of a picture in each direction.
constexpr double kSmallestPeak = 0.1;    ///< Of the correlation of two pictures.
constexpr std::size_t kFewestPairs = 24;
constexpr double kSmallestMotion_px = 0.7;
constexpr double kLargestShare = 0.7;  ///< Of the usual difference, at the best offset.
constexpr double kLargestError_s = 0.008;
constexpr double kSmallestOffset_s = 0.003, kSmallestOffset_errors = 3.0;
constexpr double kSmallestGain = 0.05;             ///< Of the difference as stamped.
constexpr std::size_t kFolds = 4, kTogether = 15;  ///< Neighbours err alike.

/// Two pictures that follow each other, or a quarter of them.
struct Pair {
  double from_s = 0.0, to_s = 0.0;
  glm::dvec2 seen_px{0.0};           ///< By which the picture moved.
  std::vector<glm::dvec3> points_m;  ///< Surfaces, camera frame of the first.
  std::size_t fold = 0;              ///< Of the jackknife.
};

class Run {
 public:
  explicit Run(const RgbdSequence& sequence) : sequence_(sequence) {}

  void look(std::size_t begin, std::size_t end, std::vector<Pair>& pairs) const {
    cv::Mat before;
    std::vector<glm::dvec3> points_m;
    for (std::size_t i = begin; i < end; ++i) {
      const RgbdFrame frame = sequence_.load(i);
      cv::Mat now = small_grey(frame.rgb);
      if (i > begin) {
        const double step_s = *sequence_.time_s(i) - *sequence_.time_s(i - 1);
        if (step_s > 0.0 && step_s < kWidestStep_s) compare(i, before, now, points_m, pairs);
      }
      before = std::move(now);
      points_m = grid(frame.depth_m);
    }
  }

 private:
  /// The whole pictures, and their quarters: near and far surfaces move apart.
  void compare(std::size_t i, const cv::Mat& before, const cv::Mat& now,
               const std::vector<glm::dvec3>& points_m, std::vector<Pair>& pairs) const {
    const int w = now.cols, h = now.rows;
    for (const cv::Rect& part :
         {cv::Rect(0, 0, w, h), cv::Rect(0, 0, w / 2, h / 2), cv::Rect(w / 2, 0, w / 2, h / 2),
          cv::Rect(0, h / 2, w / 2, h / 2), cv::Rect(w / 2, h / 2, w / 2, h / 2)}) {
      Pair pair{*sequence_.time_s(i - 1), *sequence_.time_s(i), {}, {}, 0};
      for (const glm::dvec3& p_m : points_m) {
        const glm::dvec2 px = static_cast<double>(w) / sequence_.intrinsics().width_px *
                              sequence_.intrinsics().project(p_m);
        if (part.contains(cv::Point(static_cast<int>(px.x), static_cast<int>(px.y)))) {
          pair.points_m.push_back(p_m);
        }
      }
      cv::Mat window;
      cv::createHanningWindow(window, part.size(), CV_32F);
      double peak = 0.0;
      const cv::Point2d shift =
          cv::phaseCorrelate(before(part).clone(), now(part).clone(), window, &peak);
      pair.seen_px = {shift.x, shift.y};
      if (peak > kSmallestPeak) pairs.push_back(std::move(pair));
    }
  }
  [[nodiscard]] cv::Mat small_grey(const core::Image<core::Rgb8>& rgb) const {
    cv::Mat grey = internal::grey_image(rgb);
    const double reduction = static_cast<double>(kWidth_px) / grey.cols;
    cv::resize(grey, grey, {}, reduction, reduction, cv::INTER_AREA);
    grey.convertTo(grey, CV_32F);
    return grey;
  }
  [[nodiscard]] std::vector<glm::dvec3> grid(const core::Image<float>& depth_m) const {
    const core::CameraIntrinsics& camera = sequence_.intrinsics();
    std::vector<glm::dvec3> points_m;
    for (int k = 0; k < kGrid * kGrid; ++k) {
      const glm::dvec2 share((k % kGrid + 0.5) / kGrid, (k / kGrid + 0.5) / kGrid);
      double z_m = kWithoutDepth_m;
      if (!depth_m.empty()) {
        z_m = depth_m(static_cast<int>(share.x * depth_m.width_px()),
                      static_cast<int>(share.y * depth_m.height_px()));
        if (!(z_m > 0.0)) continue;
      }
      points_m.push_back(
          camera.back_project(share * glm::dvec2(camera.width_px, camera.height_px), z_m));
    }
    return points_m;
  }

  const RgbdSequence& sequence_;
};

/// What poses predict for a pair; nothing if there is no pose at these times.
std::optional<glm::dvec2> predicted_px(const Pair& pair, double offset_s,
                                       const PoseTrack& track,
                                       const core::CameraIntrinsics& camera) {
  const auto from = track.at(pair.from_s - offset_s), to = track.at(pair.to_s - offset_s);
  if (!from || !to) return std::nullopt;
  const auto T_to_from = to->inverse() * *from;
  std::vector<double> x_px, y_px;
  for (const glm::dvec3& p_m : pair.points_m) {
    const glm::dvec3 moved_m = (T_to_from * core::Point<core::frame::Camera>{p_m}).xyz_m;
    if (!(moved_m.z > 0.05)) continue;
    const glm::dvec2 step_px = camera.project(moved_m) - camera.project(p_m);
    x_px.push_back(step_px.x), y_px.push_back(step_px.y);
  }
  if (x_px.empty()) return std::nullopt;
  const double reduction = static_cast<double>(kWidth_px) / camera.width_px;
  return reduction *
         glm::dvec2(internal::median(std::move(x_px)), internal::median(std::move(y_px)));
}

class Fitter {
 public:
  Fitter(const std::vector<Pair>& pairs, const PoseTrack& track,
         const core::CameraIntrinsics& camera)
      : pairs_(pairs), track_(track), camera_(camera) {}

  /// Mean difference of predicted and seen motion.
  [[nodiscard]] double difference_px(double offset_s, int without = -1) const {
    double sum = 0.0, count = 0.0;
    for (const Pair& pair : pairs_) {
      if (static_cast<int>(pair.fold) == without) continue;
      const auto predicted = predicted_px(pair, offset_s, track_, camera_);
      if (!predicted) continue;
      sum += std::min(kCap_px, glm::distance(*predicted, pair.seen_px));
      count += 1.0;
    }
    return count > 0.0 ? sum / count : kCap_px;
  }
  /// The lowest place, between two places to the left and right of it.
  [[nodiscard]] double refine(double around_s, int without = -1) const {
    double low_s = around_s - kStep_s, high_s = around_s + kStep_s;
    for (int i = 0; i < 18; ++i) {
      const double a_s = low_s + 0.382 * (high_s - low_s);
      const double b_s = low_s + 0.618 * (high_s - low_s);
      if (difference_px(a_s, without) < difference_px(b_s, without)) {
        high_s = b_s;
      } else {
        low_s = a_s;
      }
    }
    return 0.5 * (low_s + high_s);
  }

 private:
  const std::vector<Pair>& pairs_;
  const PoseTrack& track_;
  const core::CameraIntrinsics& camera_;
};

std::string doubt_of(const PoseTimeFit& fit, double motion_px) {
  using core::print;
  if (motion_px < kSmallestMotion_px) {
    return print("the camera hardly moves from picture to picture (%.1f px of 160)",
                 motion_px);
  }
  if (fit.best_px > kLargestShare * fit.usual_px) {
    return print("no offset predicts clearly better what pictures show (%.2f px at best, ",
                 fit.best_px) +
           print("%.2f px at a usual one)", fit.usual_px);
  }
  if (fit.error_s > kLargestError_s) {
    return print("parts of the recording disagree by %.0f ms", 1e3 * fit.error_s);
  }
  if (std::abs(fit.offset_s) > kFarthest_s - kStep_s) {
    return print("the best offset is the largest that was tried (%.0f ms)",
                 1e3 * fit.offset_s);
  }
  return {};
}

std::vector<Pair> look_at(const RgbdSequence& sequence) {
  const std::size_t frames = sequence.frame_count();
  const std::size_t runs = std::max<std::size_t>(1, std::min(kRuns, frames / kRunFrames));
  std::vector<std::vector<Pair>> of_run(runs);
  internal::load_each(runs, [&](std::size_t r) {
    const std::size_t begin = r * frames / runs;
    Run(sequence).look(begin, std::min(frames, begin + kRunFrames), of_run[r]);
  });
  std::vector<Pair> pairs;
  for (std::vector<Pair>& some : of_run) {
    // Where the track ends, offsets would be compared on different pairs.
    for (Pair& pair : some) {
      if (predicted_px(pair, kFarthest_s, sequence.pose_track(), sequence.intrinsics()) &&
          predicted_px(pair, -kFarthest_s, sequence.pose_track(), sequence.intrinsics())) {
        pair.fold = pairs.size() / kTogether % kFolds;
        pairs.push_back(std::move(pair));
      }
    }
  }
  return pairs;
}

}  // namespace

bool PoseTimeFit::is_off() const {
  return doubt.empty() && std::abs(offset_s) > kSmallestOffset_s &&
         std::abs(offset_s) > kSmallestOffset_errors * error_s &&
         best_px < (1.0 - kSmallestGain) * given_px;
}

std::string PoseTimeFit::text() const {
  using core::print;
  return print("poses are of %.1f ms after their stamps ", 1e3 * offset_s) +
         print("(+- %.1f ms): then predicted and seen motion differ by ", 1e3 * error_s) +
         print("%.2f px from picture to picture, ", best_px) +
         print("as stamped by %.2f px", given_px);
}

PoseTimeFit fit_pose_time(const RgbdSequence& sequence) {
  PoseTimeFit fit;
  const bool timed =
      sequence.frame_count() > 0 && sequence.time_s(0) && !sequence.pose_track().empty();
  const std::vector<Pair> pairs = timed ? look_at(sequence) : std::vector<Pair>{};
  fit.pairs = pairs.size();
  if (pairs.size() < kFewestPairs) {
    fit.doubt = timed ? core::print("too little to go by: %zu pairs of pictures", fit.pairs)
                      : std::string("the recording has no time stamps");
    return fit;
  }
  const Fitter fitter(pairs, sequence.pose_track(), sequence.intrinsics());
  std::vector<double> all;
  double best_s = 0.0, least = kCap_px + 1.0;
  for (double offset_s = -kFarthest_s; offset_s <= kFarthest_s + 1e-9; offset_s += kStep_s) {
    all.push_back(fitter.difference_px(offset_s));
    if (all.back() < least) least = all.back(), best_s = offset_s;
  }
  fit.offset_s = fitter.refine(best_s);
  fit.given_px = fitter.difference_px(0.0);
  fit.best_px = fitter.difference_px(fit.offset_s);
  fit.usual_px = internal::median(std::move(all));
  double squares = 0.0;
  for (int fold = 0; fold < static_cast<int>(kFolds); ++fold) {
    squares += std::pow(fitter.refine(fit.offset_s, fold) - fit.offset_s, 2);
  }
  fit.error_s = std::sqrt((kFolds - 1.0) / kFolds * squares);
  double motion_px = 0.0;
  for (const Pair& pair : pairs) motion_px += glm::length(pair.seen_px);
  fit.doubt = doubt_of(fit, motion_px / static_cast<double>(pairs.size()));
  return fit;
}

}  // namespace segsim::reconstruction
