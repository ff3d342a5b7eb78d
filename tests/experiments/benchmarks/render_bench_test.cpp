#include "experiments/benchmarks/render_bench.h"

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/check.h"
#include "core/error.h"
#include "experiments/benchmarks/bench_curves.h"
#include "experiments/benchmarks/render_record.h"
#include "experiments/benchmarks/render_report.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;
using testing::Not;

benchmarks::BenchScene small_scene(int views = 2) {
  benchmarks::BenchSceneOptions options;
  options.surfels = 4000;
  options.views = views;
  return benchmarks::load_bench_scene(options);
}

benchmarks::BenchCase small_case(int top_k = 4) {
  benchmarks::BenchCase setup;
  setup.width_px = 80;
  setup.height_px = 56;
  setup.options.top_k = top_k;
  setup.options.threads = 1;
  return setup;
}

/// Machine figures that are not measured, so that expectations can be computed by hand.
benchmarks::BenchProvenance made_up_machine() {
  benchmarks::BenchProvenance provenance;
  provenance.version = "0.0 (test)";
  provenance.cpu = "a processor";
  provenance.simd = "AVX2";
  provenance.date = "2026-01-31T12:00:00Z";
  provenance.scene = "made up";
  provenance.views = 2;
  provenance.repeat = 1;
  provenance.peaks = {{1, "AVX2", 100.0, 10.0}};
  return provenance;
}

benchmarks::BenchResult made_up_result() {
  benchmarks::BenchResult result;
  result.setup = small_case();
  result.times = {20.0, 30.0, 40.0, 10.0, 12};
  result.stats = {1000, 4000, 2500, 1e6, 5e5, 2e4};
  result.agreement = 0.75;
  return result;
}

TEST(RenderBench, FrameTimesAreQuantiles) {
  std::vector<double> values;
  for (int i = 0; i <= 100; ++i) values.push_back(100 - i);
  const benchmarks::FrameTimes times = benchmarks::summarise_times(values);
  EXPECT_DOUBLE_EQ(times.median_ms, 50);
  EXPECT_DOUBLE_EQ(times.p95_ms, 95);
  EXPECT_DOUBLE_EQ(times.p99_ms, 99);
  EXPECT_DOUBLE_EQ(times.min_ms, 0);
  EXPECT_EQ(times.frames, 101);
}

TEST(RenderBench, AgreementCountsLabelledPixels) {
  core::Frame a, b;
  a.semantic = core::Image<std::uint16_t>(5, 1);
  a.instance = core::Image<std::uint16_t>(5, 1);
  b.semantic = a.semantic;
  b.instance = a.instance;
  EXPECT_DOUBLE_EQ(benchmarks::label_agreement(a, b), 1.0);
  a.semantic.pixels() = {1, 1, 1, 0, 0};
  b.semantic.pixels() = {1, 1, 2, 1, 0};
  a.instance.pixels() = {3, 4, 0, 0, 0};
  b.instance.pixels() = {3, 5, 0, 0, 0};
  EXPECT_DOUBLE_EQ(benchmarks::label_agreement(a, b), 0.25);  // One of four labelled pixels.
}

TEST(RenderBench, RunsEveryCaseOnEveryView) {
  const benchmarks::BenchScene scene = small_scene();
  const std::vector<benchmarks::BenchCase> cases{
      small_case(renderer::kAllSurfels), small_case(1), small_case(renderer::kAllSurfels)};
  int last = 0, total = 0;
  const auto results = benchmarks::run_cases(scene, cases, 3, [&](int done, int all) {
    EXPECT_EQ(done, last + 1);
    last = done;
    total = all;
  });
  EXPECT_EQ(last, total);
  EXPECT_EQ(total, 2 * 3 * 4);
  ASSERT_EQ(results.size(), 3U);
  for (const benchmarks::BenchResult& result : results) {
    EXPECT_EQ(result.times.frames, 6);
    EXPECT_GT(result.times.min_ms, 0.0);
    EXPECT_LE(result.times.min_ms, result.times.median_ms);
    EXPECT_LE(result.times.median_ms, result.times.p95_ms);
    EXPECT_GT(result.stats.surfels_projected, 0.0);
    EXPECT_GE(result.stats.pairs_binned, result.stats.surfels_projected);
    EXPECT_LE(result.stats.contributions, result.stats.evaluations);
    EXPECT_DOUBLE_EQ(result.tiles(), 5 * 4);
    EXPECT_DOUBLE_EQ(result.pairs_per_tile(), result.stats.pairs_binned / 20.0);
  }
  EXPECT_DOUBLE_EQ(results[2].agreement, 1.0);  // The same options as the first.
  EXPECT_LT(results[1].agreement, 1.0);
  EXPECT_GT(results[1].agreement, 0.3);
}

TEST(RenderBench, RooflineIsCountersTimesUnitCosts) {
  const benchmarks::BenchResult result = made_up_result();
  const benchmarks::Roofline roof = benchmarks::roofline(result, {1, "AVX2", 100.0, 10.0});
  EXPECT_DOUBLE_EQ(roof.work.flops, 1000 * 250.0 + 1e6 * 18.0 + 5e5 * 26.0);
  const double pixel_bytes = 4 + 3 + 4 + 12 + 12;
  EXPECT_DOUBLE_EQ(roof.work.bytes, 1000 * 96.0 + 4000 * 16.0 + 2500 * 64.0 + 2e4 * 4.0 +
                                        pixel_bytes * 80 * 56);
  EXPECT_NEAR(roof.compute_ms, 31.25e6 / 100e9 * 1e3, 1e-12);
  EXPECT_STREQ(roof.bound(), "compute");
  EXPECT_NEAR(roof.share, 0.3125 / 20.0, 1e-12);
}

TEST(RenderBench, ReportsHaveFiguresAndProvenance) {
  const benchmarks::BenchProvenance provenance = made_up_machine();
  const std::vector<benchmarks::BenchResult> results{made_up_result()};
  const std::string text = benchmarks::bench_text(provenance, results);
  for (const char* part : {"80x56", "20.00", "30.00", "50.0", "100 GFLOP/s", "10.0 GB/s",
                           "a processor", "0.0 (test)", "made up"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  const auto json = nlohmann::json::parse(benchmarks::bench_json(provenance, results));
  EXPECT_EQ(json["provenance"]["simd"], "AVX2");
  EXPECT_EQ(json["results"][0]["median_ms"], 20.0);
  EXPECT_EQ(json["results"][0]["fps"], 50.0);
  EXPECT_EQ(json["results"][0]["pairs_per_s"], 4000 * 50.0);
  EXPECT_EQ(json["results"][0]["channels"], "rgb+depth+normal+labels");

  const std::string csv = benchmarks::bench_csv(provenance, results);
  const std::string header = csv.substr(0, csv.find('\n'));
  const std::string line = csv.substr(csv.find('\n') + 1);
  EXPECT_EQ(std::count(header.begin(), header.end(), ','),
            std::count(line.begin(), line.end(), ','));
  EXPECT_THROW(static_cast<void>(provenance.peaks_for(3)), core::ContractViolation);
}

TEST(Ablation, StandsBesideThePapersFigures) {
  const std::vector<benchmarks::AblationRow> rows = benchmarks::ablation_rows(small_case());
  ASSERT_EQ(rows.size(), 14U);
  EXPECT_EQ(rows[0].setup.options.bounds, renderer::TileBounds::kAabb);
  EXPECT_EQ(rows[0].setup.options.top_k, renderer::kAllSurfels);
  EXPECT_EQ(rows[4].setup.options.bounds, renderer::TileBounds::kAccuTile);
  EXPECT_EQ(rows[4].setup.options.top_k, 3);
  EXPECT_EQ(rows[6].setup.options.top_k_rule, renderer::TopKRule::kFirst);
  for (std::size_t i = 0; i < rows.size(); ++i) {  // They differ in one thing.
    EXPECT_EQ(rows[i].setup.options.skip_hidden, i >= 7) << rows[i].name;
  }
  EXPECT_EQ(rows.back().setup.options.top_k, renderer::kMaxTopK);

  std::vector<benchmarks::BenchResult> results(rows.size(), made_up_result());
  results[1].quality.emplace().panoptic.pq = 0.4321;
  const benchmarks::BenchProvenance provenance = made_up_machine();
  const std::string text =
      benchmarks::ablation_table(provenance, rows, results, support::TableFormat::kText);
  for (const char* part : {"74.75", "74.12", "6.1 M", "1230", "(D')", "75.00", "43.21"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  const std::string markdown =
      benchmarks::ablation_table(provenance, rows, results, support::TableFormat::kMarkdown);
  EXPECT_THAT(markdown, HasSubstr("| (A) | aabb, all surfels |"));
  const auto json = nlohmann::json::parse(
      benchmarks::ablation_table(provenance, rows, results, support::TableFormat::kJson));
  EXPECT_EQ(json["rows"][4]["paper"]["fps"], 45.0);
  EXPECT_FALSE(json["rows"][5].contains("paper"));
  EXPECT_EQ(json["rows"][1]["quality"]["pq"], 0.4321);
  EXPECT_FALSE(json["rows"][0].contains("quality"));
  const std::string csv =
      benchmarks::ablation_table(provenance, rows, results, support::TableFormat::kCsv);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 15);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), ','), 15 * 20);

  std::vector<benchmarks::BenchResult> unlabelled = results;
  for (benchmarks::BenchResult& r : unlabelled) r.agreement = std::nan("");
  EXPECT_THAT(
      benchmarks::ablation_table(provenance, rows, unlabelled, support::TableFormat::kJson),
      Not(HasSubstr("nan")));
}

TEST(Ablation, HasNoRowsOfAllSurfelsOnAGpu) {
  benchmarks::BenchCase base = small_case();
  base.backend = renderer::Backend::kCuda;
  const std::vector<benchmarks::AblationRow> rows = benchmarks::ablation_rows(base);
  ASSERT_EQ(rows.size(), 11U);
  for (const benchmarks::AblationRow& row : rows) {
    EXPECT_NE(row.setup.options.top_k, renderer::kAllSurfels) << row.name;
    EXPECT_EQ(row.setup.backend, renderer::Backend::kCuda);
  }
}

TEST(MachinePeaks, AreThoseOfARealMachine) {
  const reproducibility::MachinePeaks one = reproducibility::measure_machine_peaks(1, 0.005);
  EXPECT_GT(one.gflops, 0.1);
  EXPECT_LT(one.gflops, 1000.0);
  EXPECT_GT(one.read_gbps, 0.05);
  EXPECT_LT(one.read_gbps, 1000.0);
  EXPECT_EQ(reproducibility::measure_machine_peaks(2, 0.005).threads, 2);
  EXPECT_THROW(static_cast<void>(reproducibility::measure_machine_peaks(0)),
               core::ContractViolation);
}

std::map<std::string, double> values_of(const core::MeasurementRecord& record,
                                        const std::string& case_name) {
  std::map<std::string, double> values;
  for (const core::MeasuredValue& value : record.values) {
    if (value.case_name == case_name) values[value.name] = value.value;
  }
  return values;
}

TEST(RenderRecord, HasACaseForEachResult) {
  benchmarks::BenchResult other = made_up_result();
  other.setup.options.top_k = 8;
  other.setup.channels = core::Channels::kRgbd;
  const core::MeasurementRecord record =
      benchmarks::bench_record(made_up_machine(), std::vector{made_up_result(), other});
  EXPECT_FALSE(record.on_gpu);
  const auto usual = values_of(record, "made up; 80x56, 1 thread");
  EXPECT_EQ(usual.at("median"), 20.0);
  EXPECT_EQ(usual.at("frames/s"), 50.0);
  EXPECT_DOUBLE_EQ(usual.at("evaluations per pixel"), 1e6 / (80 * 56));
  EXPECT_EQ(values_of(record, "made up; 80x56, 1 thread, rgb+depth, top-k 8").at("p95"), 30.0);
}

TEST(RenderRecord, OfTable2HasThePapersFiguresWhereItHasTheRow) {
  const std::vector<benchmarks::AblationRow> rows = benchmarks::ablation_rows(small_case());
  std::vector<benchmarks::BenchResult> results(rows.size(), made_up_result());
  results[2].agreement = std::nan("");
  const core::MeasurementRecord record = benchmarks::ablation_record(rows, results);
  const auto first = values_of(record, "(A) aabb, all surfels");
  EXPECT_EQ(first.at("agreement"), 75.0);
  EXPECT_EQ(first.at("paper: PQ"), 74.75);
  EXPECT_DOUBLE_EQ(first.at("pairs"), 0.004);
  const auto second = values_of(record, "(B) accutile, all surfels");
  EXPECT_EQ(second.count("agreement"), 0U);  // Not a number, so nobody measured it.
  EXPECT_EQ(values_of(record, "(C') aabb, first 3 met").count("paper: PQ"), 0U);
  EXPECT_EQ(values_of(record, "(C') aabb, first 3 met").count("time"), 1U);
}

TEST(Curves, FitsOfKnownFunctions) {
  const std::vector<double> x{1, 2, 4, 8};
  const benchmarks::LineFit line = benchmarks::fit_line(x, {5, 8, 14, 26});  // 3 x + 2
  EXPECT_NEAR(line.slope, 3.0, 1e-12);
  EXPECT_NEAR(line.offset, 2.0, 1e-12);
  EXPECT_NEAR(line.r2, 1.0, 1e-12);
  EXPECT_LT(benchmarks::fit_line(x, {5, 8, 4, 26}).r2, 0.95);
  EXPECT_NEAR(benchmarks::growth_exponent(x, {3, 3 * std::sqrt(2.0), 6, 3 * std::sqrt(8.0)}),
              0.5, 1e-12);
  EXPECT_THROW(static_cast<void>(benchmarks::fit_line({1, 1}, {1, 2})),
               core::ContractViolation);
}

TEST(Curves, ArePicturedAtTheirPlaces) {
  const std::vector<benchmarks::Curve> curves{
      {"One", "x", "y", {0.0, 10.0}, {0.0, 10.0}, {}, "note", true},
      {"Two", "x", "y", {1.0, 2.0, 9.0}, {5.0, 5.5, 6.0}, {5.0, 10.0, 45.0}, "", true}};
  const core::Image<core::Rgb8> image = benchmarks::draw_curves(curves, "footer");
  EXPECT_EQ(image.width_px(), 2 * 460);
  // The straight line of the first panel passes through the middle of its axes, not through
  // the corner above.
  const auto blue = [&](int x, int y) {
    const core::Rgb8& p = image(x, y);
    return p.b > p.r + 60;
  };
  EXPECT_TRUE(blue(74 + (460 - 74 - 22) / 2, 74 + (400 - 74 - 62) / 2));
  EXPECT_FALSE(blue(74 + 60, 74 + 30));
  EXPECT_THROW(static_cast<void>(benchmarks::draw_curves({}, "")), core::ContractViolation);
}

TEST(BenchScene, RefusesWhatIsNoScene) {
  benchmarks::BenchSceneOptions options;
  options.scene = "no/such/folder";
  EXPECT_THROW(static_cast<void>(benchmarks::load_bench_scene(options)), core::InputError);
  options.scene = "no_such_file.ply";
  EXPECT_THROW(static_cast<void>(benchmarks::load_bench_scene(options)), core::InputError);
}

TEST(BenchScene, TheRoomHasItsCamera) {
  const benchmarks::BenchScene scene = small_scene(5);
  EXPECT_EQ(scene.path.size(), 5U);
  EXPECT_NEAR(scene.camera(1296, 968).fx_px, 1165.7, 1e-9);
  EXPECT_EQ(scene.surfels->size(), 4000U);
}

}  // namespace
}  // namespace segsim::experiments
