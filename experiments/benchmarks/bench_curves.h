#pragma once

/// @file
/// How a renderer's cost and labels depend on the load: time against pixels, time against
/// hidden surfels, label agreement against K. Measured here, drawn as one picture.

#include <functional>
#include <string>
#include <vector>

#include "core/image.h"
#include "experiments/benchmarks/bench_scene.h"

namespace segsim::experiments::benchmarks {

/// Points of one panel. `proportional` is what strict proportionality to x would give, from
/// the first point on; empty if it is not drawn.
struct Curve {
  std::string title, x_label, y_label;
  std::vector<double> x, y, proportional;
  std::string note;  ///< One line below the panel's title.
  bool y_from_zero = true;
};

struct CurveOptions {
  BenchSceneOptions scene;  ///< Of one room; `rooms` is set by the second panel.
  int repeat = 3;
  int threads = 0;
  /// Called with a word about the step, steps done and of all.
  std::function<void(const std::string&, int, int)> on_step;
};

/// Slope and R^2 of the least-squares line through (x, y) with an offset.
struct LineFit {
  double slope = 0, offset = 0, r2 = 0;
};
[[nodiscard]] LineFit fit_line(const std::vector<double>& x, const std::vector<double>& y);

/// The exponent p of y ~ x^p, by least squares of logarithms: 1 is proportional, 0 constant.
[[nodiscard]] double growth_exponent(const std::vector<double>& x,
                                     const std::vector<double>& y);

/// Three panels: pixels (with the options' scene), hidden surfels (1 ... 9 rooms), K.
[[nodiscard]] std::vector<Curve> measure_curves(const CurveOptions& options);

/// Panels side by side. @param footer  One line below: machine, version.
[[nodiscard]] core::Image<core::Rgb8> draw_curves(const std::vector<Curve>& curves,
                                                  const std::string& footer);

}  // namespace segsim::experiments::benchmarks
