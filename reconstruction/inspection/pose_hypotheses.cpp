#include "reconstruction/inspection/pose_hypotheses.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/formatted.h"
#include "reconstruction/inspection/internal/median.h"
#include "reconstruction/lifting/parallel_loading.h"

namespace segsim::reconstruction {
namespace {

using core::print;
using RelativePose = core::Transform<core::frame::Camera, core::frame::Camera>;

constexpr double kScaleStep = 1.08;
constexpr int kGiven = 102;   ///< Index of scale 1.
constexpr int kScales = 201;  ///< From 1 / 2500 to 1900.
constexpr int kStep_px = 5;   ///< Of thumbnails: a few hundred points a pair.
constexpr std::size_t kFewestPairs = 5;
constexpr double kSmallestSpread = 0.2;  ///< Between hypotheses, for a pair to tell anything.
constexpr double kTrusted = 0.15;        ///< Agreement of a hypothesis that may be right.
constexpr double kClearly = 0.8;         ///< What is given agrees so much less than the best.
constexpr double kDisagree = 0.25;    ///< Of what lies in both views; noise alone leaves more.
constexpr double kLandedShare = 0.1;  ///< Of points in both views, for that to be counted.
constexpr double kTolerated = 1.1;    ///< A factor nearer to 1 is none.

double scale_at(int k) { return std::pow(kScaleStep, k - kGiven); }

/// Agreement of one pair under all hypotheses.
struct PairScores {
  std::array<std::array<double, kScales>, 2> score{};  ///< [inverted][scale]
  double given_of_landed = -1.0;                       ///< Negative: too little lies in both.
};

RelativePose relative(const core::CameraPose& T_source_a, const core::CameraPose& T_source_b,
                      bool inverted) {
  if (!inverted) return T_source_b.inverse() * T_source_a;
  // What was read as T_source_camera is T_camera_source.
  const glm::dquat R = T_source_b.rotation() * glm::conjugate(T_source_a.rotation());
  return {R, T_source_b.translation_m() - R * T_source_a.translation_m()};
}

/// Whether the pair tells hypotheses apart: under one it agrees well, under most it does not.
bool tells(const PairScores& scores) {
  std::vector<double> all(scores.score[0].begin(), scores.score[0].end());
  all.insert(all.end(), scores.score[1].begin(), scores.score[1].end());
  const double best = *std::max_element(all.begin(), all.end());
  return best - internal::median(std::move(all)) >= kSmallestSpread;
}

/// The number that somebody would have multiplied with, if one is near.
double round_factor(double factor) {
  constexpr std::array kUsual{0.001,  0.01, 0.0254, 0.1,  0.2,     0.25,  0.3048, 1.0,
                              3.2808, 4.0,  5.0,    10.0, 39.3701, 100.0, 1000.0};
  for (const double usual : kUsual) {
    if (std::abs(std::log(factor / usual)) < 0.1) return usual;
  }
  return factor;
}

/// How unlike a room: natural logarithm of depth over 2 m.
double oddness(double median_depth_m) { return std::abs(std::log(median_depth_m / 2.0)); }

std::string percent(double share) { return core::print("%.0f %%", 100.0 * share); }

std::string as_agreement(const PoseEvidence& evidence, const std::string& then) {
  return percent(evidence.given.agreement) +
         " of depth fits the views nearby as the recording is read, " +
         percent(evidence.best.agreement) + " " + then;
}

Finding unit_finding(const PoseEvidence& evidence, double median_depth_m) {
  const double scale = round_factor(evidence.best.scale);
  // Multiplying poses with a factor is for this purpose dividing depth by it.
  const bool depth_is_wrong = oddness(median_depth_m / scale) < oddness(median_depth_m);
  Finding finding{FindingKind::kUnits, {}, {}, {}, true};
  if (depth_is_wrong) {
    const std::string factor = core::print("%.4g", 1.0 / scale);
    finding.how_bad =
        as_agreement(evidence, "if depth is multiplied with " + factor) +
        core::print(", which puts the middle of the depth at %.2g m", median_depth_m / scale);
    finding.help = "depth is in another unit: --depth-scale " + factor;
  } else {
    const std::string factor = core::print("%.4g", scale);
    finding.how_bad =
        as_agreement(evidence, "if positions of the poses are multiplied with " + factor);
    finding.help = scale == 0.001 ? "poses are in millimetres: --pose-scale 0.001"
                                  : "poses are in another unit: --pose-scale " + factor;
  }
  return finding;
}

/// Depth and poses may be wrong together, or the poses may tell nothing.
std::optional<Finding> odd_depth(double median_depth_m, bool poses_agree) {
  constexpr double kNearest_m = 0.1, kFarthest_m = 50.0;
  if (median_depth_m >= kNearest_m && median_depth_m <= kFarthest_m) return std::nullopt;
  double factor = 1.0;
  while (median_depth_m * factor > 10.0) factor /= 10.0;
  while (median_depth_m * factor < 0.3) factor *= 10.0;
  const std::string flag = core::print("%g", factor);
  Finding finding{FindingKind::kUnits, {}, {}, {}, false};
  finding.how_bad =
      core::print("the middle of the depth is %.3g m, which is no room", median_depth_m);
  finding.help = "is depth in another unit? --depth-scale " + flag +
                 (poses_agree ? " --pose-scale " + flag + " (the poses agree with it)" : "");
  return finding;
}

}  // namespace

std::optional<PoseEvidence> weigh_poses(
    const RecordingSample& sample,
    const core::Transform<core::frame::World, core::frame::World>& T_world_source) {
  const auto T_source_world = T_world_source.inverse();
  std::vector<PairScores> scores(sample.pairs.size());
  internal::load_each(scores.size(), [&](std::size_t p) {
    const FrameSample& a = sample.frames[sample.pairs[p].first];
    const FrameSample& b = sample.frames[sample.pairs[p].second];
    for (const bool inverted : {false, true}) {
      const RelativePose T_b_a = relative(T_source_world * sample.path[a.frame],
                                          T_source_world * sample.path[b.frame], inverted);
      for (int k = 0; k < kScales; ++k) {
        const DepthAgreement agreement =
            compare_depth(a.depth, b.depth, T_b_a, scale_at(k), kStep_px);
        scores[p].score[inverted ? 1 : 0][static_cast<std::size_t>(k)] =
            agreement.matched_share();
        if (!inverted && k == kGiven && agreement.landed > kLandedShare * agreement.points) {
          scores[p].given_of_landed = agreement.matched_of_landed();
        }
      }
    }
  });
  std::erase_if(scores, [](const PairScores& s) { return !tells(s); });
  if (scores.size() < kFewestPairs) return std::nullopt;
  PoseEvidence evidence;
  evidence.pairs = scores.size();
  std::vector<double> of_landed;
  for (const PairScores& s : scores) {
    if (s.given_of_landed >= 0.0) of_landed.push_back(s.given_of_landed);
  }
  if (!of_landed.empty()) evidence.given_of_landed = internal::median(std::move(of_landed));
  for (const bool inverted : {false, true}) {
    for (int k = 0; k < kScales; ++k) {
      PoseHypothesis hypothesis{inverted, scale_at(k), 0.0};
      for (const PairScores& s : scores) {
        hypothesis.agreement += s.score[inverted ? 1 : 0][static_cast<std::size_t>(k)] /
                                static_cast<double>(scores.size());
      }
      if (!inverted && k == kGiven) evidence.given = hypothesis;
      if (hypothesis.agreement > evidence.best.agreement) evidence.best = hypothesis;
    }
  }
  return evidence;
}

std::vector<Finding> find_wrong_poses(const RgbdSequence& sequence,
                                      const RecordingSample& sample) {
  if (sample.median_depth_m <= 0.0) return {};
  std::vector<Finding> findings;
  const auto evidence = weigh_poses(sample, sequence.T_world_source());
  const bool wrong = evidence && evidence->best.agreement >= kTrusted &&
                     evidence->given.agreement < kClearly * evidence->best.agreement;
  if (wrong && evidence->best.inverted) {
    findings.push_back({FindingKind::kInvertedPoses,
                        {},
                        as_agreement(*evidence, "if every pose is inverted"),
                        "poses are world-to-camera: --invert-poses",
                        true});
  }
  const bool scaled = wrong && std::abs(std::log(evidence->best.scale)) > std::log(kTolerated);
  if (scaled) findings.push_back(unit_finding(*evidence, sample.median_depth_m));
  const bool disagree = evidence && !wrong && evidence->given_of_landed < kDisagree;
  if (disagree) {
    findings.push_back({FindingKind::kPosesDisagree,
                        {},
                        percent(evidence->given_of_landed) +
                            " of what two views nearby both show fits, and no other " +
                            "unit or direction of the poses does clearly better",
                        "check poses and camera matrix; is --layout right?",
                        false});
  }
  if (!scaled) {
    const bool poses_agree = evidence && !wrong && !disagree;
    if (auto odd = odd_depth(sample.median_depth_m, poses_agree)) {
      findings.push_back(std::move(*odd));
    }
  }
  return findings;
}

}  // namespace segsim::reconstruction
