#include "experiments/benchmarks/bench_curves.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/check.h"
#include "core/formatted.h"
#include "experiments/benchmarks/render_bench.h"

namespace segsim::experiments::benchmarks {
namespace {

using core::print;

constexpr int kWidth_px = 640, kHeight_px = 480;
constexpr std::array<std::array<int, 2>, 6> kSizes_px{
    {{320, 240}, {480, 360}, {640, 480}, {800, 600}, {960, 720}, {1280, 960}}};
constexpr std::array<int, 5> kRooms{1, 2, 3, 5, 9};
constexpr std::array<int, 8> kTopK{1, 2, 3, 4, 8, 12, 16, 24};

BenchCase case_of(const CurveOptions& options, int width_px, int height_px) {
  BenchCase setup;
  setup.width_px = width_px;
  setup.height_px = height_px;
  setup.options.threads = options.threads;
  return setup;
}

Curve pixels_curve(const BenchScene& scene, const CurveOptions& options) {
  Curve curve{
      "Time against pixels", "image [Mpx]", "frame, median [ms]", {}, {}, {}, {}, true};
  std::vector<BenchCase> cases;
  for (const auto& [width_px, height_px] : kSizes_px) {
    cases.push_back(case_of(options, width_px, height_px));
    curve.x.push_back(1e-6 * width_px * height_px);
  }
  for (const BenchResult& result : run_cases(scene, cases, options.repeat)) {
    curve.y.push_back(result.times.median_ms);
  }
  const LineFit fit = fit_line(curve.x, curve.y);
  curve.note = print("%.1f ms + %.1f ms/Mpx, R2 = %.4f", fit.offset, fit.slope, fit.r2);
  return curve;
}

Curve top_k_curve(const BenchScene& scene, const CurveOptions& options) {
  Curve curve{"Labels against K", "K", "agreement with K = all [%]", {}, {}, {}, {}, false};
  std::vector<BenchCase> cases{case_of(options, kWidth_px, kHeight_px)};
  cases[0].options.top_k = renderer::kAllSurfels;
  for (const int k : kTopK) {
    cases.push_back(cases[0]);
    cases.back().options.top_k = k;
    curve.x.push_back(k);
  }
  const std::vector<BenchResult> results = run_cases(scene, cases, 1);
  for (std::size_t i = 1; i < results.size(); ++i) {
    curve.y.push_back(100.0 * results[i].agreement);
  }
  curve.note = "panoptic ids, K heaviest surfels of each pixel";
  return curve;
}

}  // namespace

LineFit fit_line(const std::vector<double>& x, const std::vector<double>& y) {
  SEGSIM_CHECK(x.size() == y.size() && x.size() >= 2, "points of a line");
  const double n = static_cast<double>(x.size());
  double mean_x = 0, mean_y = 0, xx = 0, xy = 0, yy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    mean_x += x[i] / n;
    mean_y += y[i] / n;
  }
  for (std::size_t i = 0; i < x.size(); ++i) {
    xx += (x[i] - mean_x) * (x[i] - mean_x);
    xy += (x[i] - mean_x) * (y[i] - mean_y);
    yy += (y[i] - mean_y) * (y[i] - mean_y);
  }
  SEGSIM_CHECK(xx > 0.0, "all points of a line have the same x");
  const double slope = xy / xx;
  return {slope, mean_y - slope * mean_x, yy > 0.0 ? xy * xy / (xx * yy) : 1.0};
}

double growth_exponent(const std::vector<double>& x, const std::vector<double>& y) {
  std::vector<double> log_x, log_y;
  for (std::size_t i = 0; i < x.size(); ++i) {
    log_x.push_back(std::log(x[i]));
    log_y.push_back(std::log(y[i]));
  }
  return fit_line(log_x, log_y).slope;
}

std::vector<Curve> measure_curves(const CurveOptions& options) {
  const int steps = 2 + static_cast<int>(kRooms.size());
  int done = 0;
  const auto step = [&](const std::string& what) {
    if (options.on_step) options.on_step(what, done, steps);
    ++done;
  };
  Curve hidden{"Time against hidden surfels",
               "surfels in the scene [M]",
               "frame, median [ms]",
               {},
               {},
               {},
               {},
               true};
  std::vector<Curve> curves;
  for (const int rooms : kRooms) {
    step(std::to_string(rooms) + " rooms");
    BenchSceneOptions wanted = options.scene;
    wanted.scene = "room";
    wanted.rooms = rooms;
    const BenchScene scene = load_bench_scene(wanted);
    const std::vector<BenchCase> cases{case_of(options, kWidth_px, kHeight_px)};
    const BenchResult result = run_cases(scene, cases, options.repeat).front();
    hidden.x.push_back(1e-6 * static_cast<double>(scene.surfels->size()));
    hidden.y.push_back(result.times.median_ms);
    hidden.proportional.push_back(hidden.y[0] * hidden.x.back() / hidden.x[0]);
    if (rooms != 1) continue;
    step("image sizes");
    curves.push_back(pixels_curve(scene, options));
    step("values of K");
    curves.push_back(top_k_curve(scene, options));
  }
  hidden.note = print("%dx%d; time ~ surfels^%.2f; dashed: proportional", kWidth_px,
                      kHeight_px, growth_exponent(hidden.x, hidden.y));
  curves.insert(curves.begin() + 1, std::move(hidden));
  if (options.on_step) options.on_step("drawing", steps, steps);
  return curves;
}

}  // namespace segsim::experiments::benchmarks
