#include "experiments/specs/budget_file.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "experiments/specs/clock_spec.h"
#include "tests/error_message.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;
using tests::input_error_of;
using Kind = sim::DurationModel::Kind;

/// The example of docs/simulation.md, in other numbers.
const char* const kExample = R"(schema: segsim.budget/1
id: example-edge
resources: {gpu: 1, cpu: 2}
stages:
  capture: {charge: robot, ms: 33}
  render:  {charge: sim,   ms: measured}
  detect:  {charge: robot, on: gpu, after: capture, dist: {lognormal: {p50: 28, p95: 41}}, deadline_ms: 60, queue: newest}
  segment: {charge: robot, on: gpu, after: detect,  per_item_ms: 6, deadline_ms: 30}
  map:     {charge: robot, on: cpu, after: segment, ms: 6}
  policy:  {charge: robot, on: cpu, ms: 4, deadline_ms: 20}
  actuate: {charge: robot, ms: 8}
end_to_end: {from: capture, to: actuate, deadline_ms: 150, on_miss: use_stale}
max_age_ms: {value: 400, on_exceed: zero_command}
)";

TEST(BudgetFile, TheExampleOfTheDesignIsRead) {
  const sim::LatencyBudget budget = specs::parse_budget(kExample, "edge.yaml").budget;
  EXPECT_EQ(budget.id, "example-edge");
  EXPECT_EQ(budget.resources.at("cpu"), 2);
  ASSERT_EQ(budget.stages.size(), 7U);
  EXPECT_EQ(budget.find("render")->charge, sim::Charge::kSim);
  EXPECT_EQ(budget.find("render")->duration.kind, Kind::kMeasured);
  const sim::StageBudget& detect = *budget.find("detect");
  EXPECT_EQ(detect.duration.kind, Kind::kLognormal);
  EXPECT_EQ(detect.duration.b_ms, 41.0);
  EXPECT_EQ(detect.deadline_ns, 60'000'000);
  EXPECT_EQ(detect.on, "gpu");
  EXPECT_EQ(budget.find("segment")->duration.per_item_ms, 6.0);
  EXPECT_EQ(budget.end_to_end_deadline_ns, 150'000'000);
  EXPECT_EQ(budget.max_age_ns, 400'000'000);
  EXPECT_EQ(budget.on_max_age, sim::OnMiss::kZeroCommand);
}

TEST(BudgetFile, TheShippedBudgetsAreRead) {
  int read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(SEGSIM_BUDGETS)) {
    EXPECT_EQ(specs::read_budget_file(entry.path()).budget.id, entry.path().stem().string());
    ++read;
  }
  EXPECT_GE(read, 3);
}

/// The example with one thing replaced; the message.
std::string error_after(const std::string& from, const std::string& to) {
  std::string text = kExample;
  text.replace(text.find(from), from.size(), to);
  return input_error_of([&] { (void)specs::parse_budget(text, "edge.yaml"); });
}

TEST(BudgetFile, ErrorsNameLineAndKey) {
  EXPECT_THAT(error_after("deadline_ms: 60", "dedline_ms: 60"),
              testing::AllOf(HasSubstr("edge.yaml:7"), HasSubstr("dedline_ms"),
                             HasSubstr("did you mean \"deadline_ms\"")));
  EXPECT_THAT(error_after("ms: 33", "ms: -33"),
              testing::AllOf(HasSubstr("edge.yaml:5"), HasSubstr("-33")));
  EXPECT_THAT(error_after("ms: 33", "ms: soon"), HasSubstr("edge.yaml:5"));
  EXPECT_THAT(error_after("on_miss: use_stale", "on_miss: use_stail"),
              testing::AllOf(HasSubstr("edge.yaml:12"), HasSubstr("near: use_stale")));
  EXPECT_THAT(error_after("queue: newest", "queue: oldest"), HasSubstr("drop_new"));
  EXPECT_THAT(error_after("p50: 28, p95: 41", "p50: 41, p95: 28"), HasSubstr("at least p50"));
  EXPECT_THAT(error_after("lognormal", "lognormel"), HasSubstr("lognormel"));
  EXPECT_THAT(error_after("ms: 4,", "ms: measured,"),
              testing::AllOf(HasSubstr("edge.yaml:10"), HasSubstr("measured")));
  EXPECT_THAT(error_after("after: detect", "after: detekt"), HasSubstr("detekt"));
  EXPECT_THAT(error_after("on: gpu, after: capture", "on: npu, after: capture"),
              HasSubstr("npu"));
  EXPECT_THAT(error_after("{gpu: 1, cpu: 2}", "{gpu: 0, cpu: 2}"), HasSubstr("edge.yaml:3"));
  EXPECT_THAT(error_after("segsim.budget/1", "segsim.budget/9"), HasSubstr("edge.yaml:1"));
  EXPECT_THAT(error_after("ms: 8", "trace: nowhere.csv"), HasSubstr("nowhere.csv"));
  EXPECT_THAT(error_after("{charge: robot, ms: 8}", "{charge: robot}"),
              HasSubstr("edge.yaml:11"));
}

TEST(TraceFile, RoundTripAndBadLines) {
  const TemporaryFolder folder("trace");
  sim::LatencyTrace trace;
  trace.add("detect", 3, 1234567890123);
  trace.add("detect", 1, 5);
  trace.add("policy", 0, 0);
  const auto file = folder.path() / "trace.csv";
  specs::write_trace_csv(file, trace);
  EXPECT_EQ(specs::read_trace_csv(file), trace);

  const auto error = [&](const std::string& text) {
    std::ofstream(file) << text;
    return input_error_of([&] { (void)specs::read_trace_csv(file); });
  };
  EXPECT_THAT(error("stage,ms\n"), HasSubstr("trace.csv:1"));
  EXPECT_THAT(error("stage,index,duration_ns\ndetect,1,5\ndetect,x,5\n"),
              HasSubstr("trace.csv:3"));
  EXPECT_THAT(error("stage,index,duration_ns\ndetect,1,-5\n"), HasSubstr("trace.csv:2"));
  EXPECT_THAT(error("stage,index,duration_ns\ndetect,1\n"), HasSubstr("trace.csv:2"));
  EXPECT_THAT(error("stage,index,duration_ns\n"), HasSubstr("durations"));

  // A budget that plays it; the file lies beside the budget.
  specs::write_trace_csv(file, trace);
  const std::string text =
      "schema: segsim.budget/1\nid: t\nstages:\n  detect: {trace: trace.csv}\n";
  const specs::BudgetFile budget = specs::parse_budget(text, folder.path() / "t.yaml");
  EXPECT_EQ(budget.budget.find("detect")->duration.draw("detect", 0, 3, 0), 1234567890123);
  EXPECT_THAT(input_error_of([&] {
                (void)specs::parse_budget(
                    "schema: segsim.budget/1\nid: t\nstages:\n  map: {trace: trace.csv}\n",
                    folder.path() / "t.yaml");
              }),
              HasSubstr("a trace with the stage map"));
}

TEST(ClockSpec, ReadsAndRefuses) {
  const TemporaryFolder folder("clock_spec");
  std::ofstream(folder.path() / "edge.yaml") << kExample;
  const auto expand = [&](const core::ConfigNode& node) {
    return folder.path() / node.as_text();
  };
  const auto read = [&](const std::string& text) {
    return specs::read_clock_spec(core::ConfigNode::parse(text, "spec.yaml"), expand);
  };
  EXPECT_EQ(read("name: x\n").mode, sim::ClockMode::kLockstep);
  const specs::ClockSpec clock = read(
      "clock:\n  mode: virtual\n  budget: edge.yaml\n  camera: {period_ms: 50, jitter_ms: 2}\n"
      "  registration: use\n");
  EXPECT_EQ(clock.mode, sim::ClockMode::kVirtual);
  EXPECT_EQ(clock.camera.period_ns, 50'000'000);
  EXPECT_EQ(clock.registration, sim::Registration::kUse);
  EXPECT_EQ(specs::clock_in_words(clock), "virtual time, budget example-edge");
  EXPECT_THAT(input_error_of([&] { (void)read("clock:\n  mode: virtuel\n"); }),
              testing::AllOf(HasSubstr("spec.yaml:2"), HasSubstr("near: virtual")));
  EXPECT_THAT(
      input_error_of([&] {
        (void)read("clock: {mode: lockstep, camera: {period_ms: 50, jitter_ms: 25}}\n");
      }),
      HasSubstr("less than half"));

  const auto arm = [&](const std::string& text) {
    const auto node = core::ConfigNode::parse(text, "spec.yaml");
    const specs::ArmClockSpec arm_clock = specs::read_arm_clock(node, expand);
    specs::check_arm_clock(clock, arm_clock, node);
    return specs::trial_clock(clock, arm_clock);
  };
  EXPECT_EQ(arm("add_ms: {detect: 200}").budget.find("detect")->duration.added_ms, 200.0);
  EXPECT_THAT(input_error_of([&] { (void)arm("add_ms: {detekt: 200}"); }),
              HasSubstr("near: detect"));
  EXPECT_THAT(input_error_of([&] {
                const auto node = core::ConfigNode::parse("name: a", "spec.yaml");
                specs::ClockSpec without;
                without.mode = sim::ClockMode::kVirtual;
                specs::check_arm_clock(without, {}, node);
              }),
              HasSubstr("a budget"));
}

}  // namespace
}  // namespace segsim::experiments
