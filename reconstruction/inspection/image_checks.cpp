#include "reconstruction/inspection/image_checks.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>

#include "core/formatted.h"
#include "reconstruction/inspection/internal/median.h"
#include "reconstruction/inspection/internal/pose_steps.h"

namespace segsim::reconstruction {
namespace {

using core::print;

/// Of the medians of the recording. Both must be low: a bare wall has no sharp edges, either.
constexpr double kBlurredSharpness = 0.4, kBlurredFineShare = 0.5;
/// Nor is it blur if what else looks there is no sharper: so many samples before and behind,
/// within this turn, and so many times as sharp.
constexpr std::size_t kNeighbours = 5;
constexpr double kSameView_rad = 15.0 * std::numbers::pi / 180.0, kSharper = 2.0;
constexpr std::size_t kFewestForMedian = 8;

constexpr double kHoleShare = 0.6;        ///< Of the pixels of one frame.
constexpr double kUsualHoleShare = 0.35;  ///< Of the pixels of the middle frame.

constexpr std::size_t kFewestEdges = 2000;
constexpr double kSmallestContrast = 0.015;  ///< Of the best agreement against chance.
constexpr double kGivenContrast = 0.7;       ///< What is given reaches less of the best ...
constexpr double kSmallestDisplacement_px = 2.0;  ///< ... which lies so far away.
constexpr double kHalvesDiffer_px = 2.0;          ///< Even and odd views must agree about it.

/// Frames of the sequence by their places in the sample.
std::vector<std::size_t> frames_at(const RecordingSample& sample,
                                   const std::vector<std::size_t>& places) {
  std::vector<std::size_t> frames;
  for (const std::size_t k : places) frames.push_back(sample.frames[k].frame);
  return frames;
}

ImageDetail median_detail(const RecordingSample& sample) {
  std::vector<double> sharpness, fine_share;
  for (const FrameSample& frame : sample.frames) {
    sharpness.push_back(frame.detail.sharpness);
    fine_share.push_back(frame.detail.fine_share);
  }
  return {internal::median(std::move(sharpness)), internal::median(std::move(fine_share))};
}

/// Whether a neighbour that looks the same way is clearly sharper.
bool is_seen_sharper(const RecordingSample& sample, std::size_t k) {
  const std::size_t end = std::min(sample.frames.size(), k + kNeighbours + 1);
  for (std::size_t j = k > kNeighbours ? k - kNeighbours : 0; j < end; ++j) {
    const FrameSample &frame = sample.frames[k], &other = sample.frames[j];
    if (other.detail.sharpness > kSharper * frame.detail.sharpness &&
        internal::turn_rad(sample.path[frame.frame], sample.path[other.frame]) <
            kSameView_rad) {
      return true;
    }
  }
  return false;
}

std::string count_of(std::size_t count, const RecordingSample& sample) {
  return std::to_string(count) + " of " + std::to_string(sample.frames.size()) +
         " frames looked at";
}

std::vector<const EdgeView*> edge_views(const RecordingSample& sample) {
  std::vector<const EdgeView*> views;
  for (const FrameSample& frame : sample.frames) {
    if (frame.edges) views.push_back(&*frame.edges);
  }
  return views;
}

bool halves_agree(const std::vector<const EdgeView*>& views, const EdgeShift& best,
                  int width_px) {
  for (const std::size_t first : {0U, 1U}) {
    std::vector<const EdgeView*> half;
    for (std::size_t i = first; i < views.size(); i += 2) half.push_back(views[i]);
    const EdgeShift own = fit_edges(half).best;
    const EdgeShift difference{own.shift_px - best.shift_px, 1.0 + own.scale - best.scale,
                               0.0};
    if (difference.displacement_px(width_px) > kHalvesDiffer_px) return false;
  }
  return true;
}

/// "shifted by (7, -2) px and scaled by 0.98" in pixels of the colour image.
std::string shift_text(const EdgeShift& shift, double reduction) {
  std::string text;
  if (glm::length(shift.shift_px) > 0.0) {
    text = "shifted by (" + core::print("%.0f", shift.shift_px.x / reduction) + ", " +
           core::print("%.0f", shift.shift_px.y / reduction) + ") px";
  }
  if (shift.scale != 1.0) {
    text += (text.empty() ? "" : " and ") + core::print("scaled by %.2f", shift.scale);
  }
  return text;
}

}  // namespace

std::vector<std::size_t> blurred_samples(const RecordingSample& sample) {
  std::vector<std::size_t> blurred;
  if (sample.frames.size() < kFewestForMedian) return blurred;
  const ImageDetail usual = median_detail(sample);
  for (std::size_t k = 0; k < sample.frames.size(); ++k) {
    const ImageDetail& detail = sample.frames[k].detail;
    if (detail.sharpness < kBlurredSharpness * usual.sharpness &&
        detail.fine_share < kBlurredFineShare * usual.fine_share &&
        is_seen_sharper(sample, k)) {
      blurred.push_back(k);
    }
  }
  return blurred;
}

std::vector<Finding> find_blur(const RgbdSequence& sequence, const RecordingSample& sample) {
  const std::vector<std::size_t> blurred = blurred_samples(sample);
  if (blurred.empty()) return {};
  const std::size_t worst =
      *std::min_element(blurred.begin(), blurred.end(), [&](std::size_t a, std::size_t b) {
        return sample.frames[a].detail.sharpness < sample.frames[b].detail.sharpness;
      });
  const double share = sample.frames[worst].detail.sharpness / median_detail(sample).sharpness;
  return {{FindingKind::kBlur, frames_text(sequence, frames_at(sample, blurred)),
           count_of(blurred.size(), sample) + "; the variance of the Laplacian falls to " +
               core::print("%.2f", share) + " of its median (frame " +
               sequence.frame_name(sample.frames[worst].frame) + ")",
           "leave these frames out, or record them again with more light or more slowly",
           false}};
}

std::vector<Finding> find_depth_holes(const RgbdSequence& sequence,
                                      const RecordingSample& sample) {
  std::vector<std::size_t> empty;
  std::vector<double> shares;
  for (std::size_t k = 0; k < sample.frames.size(); ++k) {
    if (sample.frames[k].depth.depth_m.empty()) continue;
    shares.push_back(sample.frames[k].hole_share);
    if (shares.back() > kHoleShare) empty.push_back(k);
  }
  if (shares.empty()) return {};
  const double usual = internal::median(shares);
  const double most = *std::max_element(shares.begin(), shares.end());
  if (empty.empty() && usual <= kUsualHoleShare) return {};
  return {
      {FindingKind::kDepthHoles,
       empty.empty() ? std::string() : frames_text(sequence, frames_at(sample, empty)),
       core::print("the middle frame has no depth at %.0f %% of its pixels, ", 100.0 * usual) +
           core::print("the worst at %.0f %%", 100.0 * most),
       "record glass, mirrors, black and far surfaces from nearer and from other sides",
       false}};
}

std::vector<Finding> find_wrong_calibration(const RgbdSequence& sequence,
                                            const RecordingSample& sample) {
  const std::vector<const EdgeView*> views = edge_views(sample);
  std::size_t edges = 0;
  for (const EdgeView* view : views) edges += view->depth_edges_px.size();
  if (views.size() < 4 || edges < kFewestEdges) return {};
  const int width_px = views.front()->color_edge_nearness.width_px();
  const EdgeFit fit = fit_edges(views);
  const double best = fit.best.agreement - fit.elsewhere;
  const double given = fit.given.agreement - fit.elsewhere;
  if (best < kSmallestContrast || given > kGivenContrast * best ||
      fit.best.displacement_px(width_px) < kSmallestDisplacement_px ||
      !halves_agree(views, fit.best, width_px)) {
    return {};
  }
  const double reduction = static_cast<double>(width_px) / sequence.intrinsics().width_px;
  return {{FindingKind::kCalibration,
           {},
           "edges of depth lie on edges of colour best if depth is " +
               shift_text(fit.best, reduction) +
               core::print(": agreement %.2f", fit.best.agreement) +
               core::print(" instead of %.2f", fit.given.agreement) +
               core::print(" (%.2f by chance)", fit.elsewhere),
           "check the camera matrix, and that depth is registered to colour",
           false}};
}

}  // namespace segsim::reconstruction
