#pragma once

/// @file
/// How far simulated masks are from exact ones. mask_simulator.h explains the operators.

#include <string>
#include <utility>
#include <vector>

namespace segsim::worlds {

/// Probabilities, and lengths in pixels of an image 320 px wide (other widths scale them). The
/// values are level 1: the published quality.
struct MaskNoise {
  double smallest_px = 25.0;  ///< True segments with a smaller area are never masked.

  double merge = 0.14;        ///< Touching things of one class become one mask, per pair.
  double merge_reach_px = 2;  ///< "Touching": not farther apart.

  double miss_always = 0.03;  ///< Of any segment,
  double miss_small = 0.25;   ///< plus this times exp(-area share / miss_area),
  double miss_area = 0.004;
  double miss_border = 0.06;  ///< plus this for things cut off by the image border.
  /// An object missed in one view tends to be missed in the next: correlation of the
  /// underlying normal variable over `miss_step` frames. [0, 1)
  double miss_correlation = 0.8;
  double miss_step = 3.0;

  double border_shift_px = 0.6;   ///< Sigma: grows or shrinks a mask as a whole.
  double border_wobble_px = 0.8;  ///< Sigma of a smooth field that moves the border.
  double wobble_length_px = 12.0;

  double leak = 0.10;  ///< A blob is added to a mask, or bitten out of it,
  double leak_share_min = 0.2, leak_share_max = 1.5;  ///< of this share of its area;
  double leak_outward = 0.6;                          ///< added with this probability.

  double confuse = 0.10;  ///< Another class is named.
  double confuse_systematic =
      0.5;                      ///< Share of it drawn once per object and 60-degree sector.
  double confuse_listed = 0.7;  ///< With a look-alike, if the scene has one.

  double split = 0.10;        ///< A thing is cut in two.
  double duplicate = 0.60;    ///< A part of a thing is found again, as another thing.
  double hallucinate = 0.25;  ///< Made-up masks per true segment in view (Poisson).
  double hallucinated_area = 0.006, hallucinated_spread = 1.1;  ///< Log-normal, of the image.

  double score_correlation = 0.3;  ///< Of a mask's score with its true IoU.

  /// Level 0 is exact masks with random ids, 0.5 half of all rates and lengths.
  [[nodiscard]] MaskNoise at_level(double level) const;
  /// Scales what costs recall, precision and shape (SQ), to fit the noise to other scenes.
  [[nodiscard]] MaskNoise scaled(double misses, double false_positives, double shapes) const;
  /// Names and values of all fields, for records.
  [[nodiscard]] std::vector<std::pair<std::string, double>> listing() const;
};

}  // namespace segsim::worlds
