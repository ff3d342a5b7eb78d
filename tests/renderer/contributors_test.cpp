/// @file
/// Three kinds of scenes from eight sides each against double precision: who contributes to a
/// pixel and how much, then every channel.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>

#include "renderer/cpu_renderer.h"
#include "renderer/internal/reference_resolve.h"
#include "tests/renderer/blending_oracle.h"
#include "tests/renderer/surfel_weights.h"

namespace segsim::renderer {
namespace {

using core::Channels;
using core::Frame;
using testing::kOddCamera;
using testing::SceneKind;
using testing::View;
using testing::view_of;
using testing::Weights;

struct Tally {
  int pixels = 0, certain_pixels = 0;
  std::size_t contributors = 0, uncertain = 0;
  double weight = 0.0, colour = 0.0, alpha = 0.0, depth = 0.0, normal = 0.0;
};

/// The set must be the oracle's but for what it is not certain of.
void compare_sets(const testing::OraclePixel& expected, Weights weights, Tally& tally) {
  for (const testing::Contributor& c : expected.contributors) {
    ++tally.contributors;
    tally.uncertain += c.certain ? 0 : 1;
    const float weight = std::exchange(weights[c.surfel], 0.0F);
    if (!c.certain) continue;
    EXPECT_GT(weight, 0.0F) << "surfel " << c.surfel << " is missing";
    if (!expected.certain) continue;
    tally.weight = std::max(tally.weight, std::abs(static_cast<double>(weight) - c.weight));
  }
  for (std::size_t s = 0; s < weights.size(); ++s) {
    EXPECT_EQ(weights[s], 0.0F) << "surfel " << s << " must not contribute";
  }
}

/// RGB has 8 bits: a byte must be the rounding of a colour within 1e-3 of the exact one.
void compare_colour(const core::Rgb8& rgb, const glm::dvec3& expected, Tally& tally) {
  const glm::dvec3 exact = 255.0 * glm::clamp(expected, 0.0, 1.0);
  const glm::dvec3 off = glm::abs(glm::dvec3(rgb.r, rgb.g, rgb.b) - exact);
  const double beyond_rounding = std::max({off.r, off.g, off.b}) - 0.5;
  tally.colour = std::max(tally.colour, beyond_rounding / 255.0);
}

void compare_view(const View& view, Tally& tally) {
  const testing::BlendingOracle oracle(view.scene, view.pose, kOddCamera);
  const std::vector<Weights> weights = testing::weights_of(view);
  const Frame frame = make_cpu_renderer(view.scene, {.threads = 1})
                          ->render(view.pose, kOddCamera, Channels::kAll);
  for (int y = 0; y < kOddCamera.height_px; ++y) {
    for (int x = 0; x < kOddCamera.width_px; ++x) {
      SCOPED_TRACE(std::to_string(x) + " " + std::to_string(y));
      const testing::OraclePixel expected = oracle.pixel(x, y);
      compare_sets(expected, weights[static_cast<std::size_t>(y * kOddCamera.width_px + x)],
                   tally);
      ++tally.pixels;
      if (!expected.certain) continue;
      ++tally.certain_pixels;
      compare_colour(frame.rgb(x, y), expected.colour, tally);
      const double alpha = static_cast<double>(frame.alpha(x, y));
      tally.alpha = std::max(tally.alpha, std::abs(alpha - 1.0 + expected.transmittance));
      if (expected.depth_certain) {
        const double depth_m = static_cast<double>(frame.depth_m(x, y));
        tally.depth = std::max(tally.depth, std::abs(depth_m / expected.median_depth_m - 1.0));
      }
      const glm::dvec3 normal = glm::normalize(expected.normal);
      tally.normal =
          std::max(tally.normal, glm::length(glm::dvec3(frame.normal(x, y)) - normal));
    }
  }
}

class Contributors : public ::testing::TestWithParam<SceneKind> {};

TEST_P(Contributors, AreThoseOfDoublePrecisionFromEightSides) {
  Tally tally;
  for (int i = 0; i < 8; ++i) {
    SCOPED_TRACE("view " + std::to_string(i));
    compare_view(view_of(GetParam(), i), tally);
  }
  EXPECT_GT(tally.contributors, 50000U);
  EXPECT_GT(tally.certain_pixels, 0.98 * tally.pixels);
  EXPECT_LT(static_cast<double>(tally.uncertain),
            1e-3 * static_cast<double>(tally.contributors));
  EXPECT_LT(tally.colour, 1e-3);
  EXPECT_LT(tally.weight, 5e-4);
  EXPECT_LT(tally.alpha, 1e-4);
  EXPECT_LT(tally.depth, 1e-4);
  EXPECT_LT(tally.normal, 1e-3);
  RecordProperty("contributors", std::to_string(tally.contributors));
  RecordProperty("worst_weight_1e-6", std::to_string(1e6 * tally.weight));
  RecordProperty("worst_colour_1e-6", std::to_string(1e6 * tally.colour));
}

/// A pixel's classes and instances by the oracle's weights.
struct Election {
  std::vector<double> votes = std::vector<double>(64, 0.0);
  double total = 0.0;
  bool selection_certain = true;  ///< No surfel outside weighs as much as one inside.

  [[nodiscard]] std::size_t winner() const {
    return static_cast<std::size_t>(std::max_element(votes.begin(), votes.end()) -
                                    votes.begin());
  }
  /// By how much of the total `label` loses.
  [[nodiscard]] double loses_by(std::size_t label) const {
    return (votes[winner()] - votes[label]) / total;
  }
};

Election elect(const std::vector<testing::Contributor>& contributors,
               const std::vector<std::uint16_t>& labels, const RenderOptions& options) {
  std::vector<internal::ReferenceWeight> met;
  for (const testing::Contributor& c : contributors) met.push_back({c.weight, c.surfel});
  Election election;
  const auto selected = internal::select_top_k(met, options);
  for (const internal::ReferenceWeight& w : selected) {
    election.votes[labels[w.surfel]] += w.weight;
    election.total += w.weight;
  }
  if (options.top_k_rule == TopKRule::kHeaviest && selected.size() < met.size()) {
    std::sort(met.begin(), met.end(),
              [](const auto& a, const auto& b) { return a.weight > b.weight; });
    const double last = met[selected.size() - 1].weight;
    election.selection_certain = met[selected.size()].weight < (1.0 - 4e-4) * last;
  }
  return election;
}

/// Differences of labels from the oracle's.
struct LabelTally {
  int labels = 0;
  int ties = 0;      ///< Scores within 1e-5 of each other.
  int rounding = 0;  ///< Within what a key keeps of a weight; see selection_key.h.
  int wrong = 0;
};

void compare_label(const Election& election, std::size_t label, LabelTally& tally) {
  constexpr double kKeyResolution = 4e-5;
  ++tally.labels;
  if (label == election.winner()) return;
  const double gap = election.loses_by(label);
  if (gap < 1e-5) {
    ++tally.ties;
  } else if (gap < kKeyResolution || !election.selection_certain) {
    ++tally.rounding;
  } else {
    ++tally.wrong;
  }
}

/// The oracle's pixels of a view, row by row.
std::vector<testing::OraclePixel> oracle_pixels(const View& view) {
  const testing::BlendingOracle oracle(view.scene, view.pose, kOddCamera);
  std::vector<testing::OraclePixel> pixels;
  for (int y = 0; y < kOddCamera.height_px; ++y) {
    for (int x = 0; x < kOddCamera.width_px; ++x) pixels.push_back(oracle.pixel(x, y));
  }
  return pixels;
}

TEST_P(Contributors, LabelsOfEveryKAreThoseOfDoublePrecision) {
  LabelTally all, few;
  for (int i = 0; i < 8; ++i) {
    const View view = view_of(GetParam(), i);
    const std::vector<testing::OraclePixel> expected = oracle_pixels(view);
    for (const TopKRule rule : {TopKRule::kHeaviest, TopKRule::kFirst}) {
      for (const int top_k : {1, 3, 4, 8, 16, 24, kAllSurfels}) {
        const RenderOptions options{.top_k = top_k, .top_k_rule = rule, .threads = 1};
        const Frame frame = make_cpu_renderer(view.scene, options)
                                ->render(view.pose, kOddCamera, Channels::kAll);
        LabelTally& tally = top_k == kAllSurfels ? all : few;
        for (std::size_t p = 0; p < expected.size(); ++p) {
          if (!expected[p].certain) continue;
          const auto& met = expected[p].contributors;
          compare_label(elect(met, view.scene->semantic_id, options),
                        frame.semantic.pixels()[p], tally);
          compare_label(elect(met, view.scene->instance_id, options),
                        frame.instance.pixels()[p], tally);
        }
      }
    }
  }
  EXPECT_GT(all.labels, 50000);
  EXPECT_EQ(all.wrong + all.rounding, 0);
  EXPECT_LE(all.ties, 5);
  EXPECT_EQ(few.wrong, 0);
  EXPECT_LE(few.ties + few.rounding, 3e-4 * few.labels);
  RecordProperty("labels", few.labels);
  RecordProperty("within_rounding_of_keys", few.rounding);
}

INSTANTIATE_TEST_SUITE_P(Scenes, Contributors,
                         ::testing::Values(SceneKind::kOutside, SceneKind::kInside,
                                           SceneKind::kRoom),
                         [](const auto& kind) { return testing::name_of(kind.param); });

}  // namespace
}  // namespace segsim::renderer
