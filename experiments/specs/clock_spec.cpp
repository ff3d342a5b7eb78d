#include "experiments/specs/clock_spec.h"

#include <algorithm>
#include <vector>

#include "experiments/support/numbers_in_range.h"

namespace segsim::experiments::specs {
namespace {

using core::ConfigNode;

sim::SensorRate read_rate(const ConfigNode& node) {
  sim::SensorRate rate;
  rate.period_ns =
      sim::ns_from_ms(support::number_within(node, "period_ms", 0.0, 1.0, 60000.0));
  rate.phase_ns = sim::ns_from_ms(support::number_within(node, "phase_ms", 0.0, 0.0, 60000.0));
  rate.jitter_ns =
      sim::ns_from_ms(support::number_within(node, "jitter_ms", 0.0, 0.0, 30000.0));
  if (2 * rate.jitter_ns >= rate.period_ns) {
    node.child("jitter_ms").fail("less than half of period_ms", node.text("jitter_ms"));
  }
  node.finish();
  return rate;
}

const sim::LatencyBudget* budget_of(const ClockSpec& clock, const ArmClockSpec& arm) {
  if (arm.budget) return &arm.budget->budget;
  return clock.budget ? &clock.budget->budget : nullptr;
}

}  // namespace

ClockSpec read_clock_spec(const ConfigNode& root, const ExpandPath& expand) {
  ClockSpec clock;
  const auto node = root.optional_child("clock");
  if (!node) return clock;
  clock.mode = static_cast<sim::ClockMode>(
      core::choice(*node, "mode", {"lockstep", "virtual", "measured", "realtime"}));
  if (node->has("budget")) clock.budget = read_budget_file(expand(node->child("budget")));
  if (node->has("camera")) clock.camera = read_rate(node->child("camera"));
  if (node->has("registration")) {
    clock.registration = static_cast<sim::Registration>(
        core::choice(*node, "registration", {"capture", "use"}));
  }
  clock.measured_scale = support::number_within(*node, "scale", 1.0, 1e-3, 1e3);
  node->finish();
  return clock;
}

ArmClockSpec read_arm_clock(const ConfigNode& arm, const ExpandPath& expand) {
  ArmClockSpec clock;
  if (arm.has("budget")) clock.budget = read_budget_file(expand(arm.child("budget")));
  if (const auto added = arm.optional_child("add_ms")) {
    for (const std::string& stage : added->keys()) {
      clock.add_ms[stage] = support::number_within(*added, stage, 0.0, -60000.0, 60000.0);
    }
  }
  return clock;
}

void check_arm_clock(const ClockSpec& clock, const ArmClockSpec& arm_clock,
                     const ConfigNode& arm) {
  const bool lockstep = clock.mode == sim::ClockMode::kLockstep;
  if (lockstep && (arm_clock.given() || clock.budget)) {
    arm.fail(
        "no budget and no add_ms (the clock's mode is lockstep: everything takes no time)",
        "one");
  }
  const sim::LatencyBudget* budget = budget_of(clock, arm_clock);
  if (clock.mode == sim::ClockMode::kVirtual && budget == nullptr) {
    arm.fail("a budget, here or under clock: (its mode is virtual)", "none");
  }
  for (const auto& [stage, ms] : arm_clock.add_ms) {
    if (budget != nullptr && budget->find(stage) != nullptr) continue;
    std::vector<std::string> stages;
    if (budget != nullptr) {
      for (const sim::StageBudget& known : budget->stages) stages.push_back(known.name);
    }
    const std::string near = core::nearest_word(stage, stages);
    arm.child("add_ms").fail(
        "stages of the budget",
        "\"" + stage + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
  }
}

sim::TrialClock trial_clock(const ClockSpec& clock, const ArmClockSpec& arm) {
  sim::TrialClock made;
  made.mode = clock.mode;
  made.camera = clock.camera;
  made.registration = clock.registration;
  made.measured_scale = clock.measured_scale;
  if (const sim::LatencyBudget* budget = budget_of(clock, arm); budget != nullptr) {
    made.budget = *budget;
  }
  for (const auto& [stage, ms] : arm.add_ms) {
    if (sim::StageBudget* found = made.budget.find(stage); found != nullptr) {
      found->duration.added_ms += ms;
    }
  }
  return made;
}

std::string clock_in_words(const ClockSpec& clock) {
  if (clock.mode == sim::ClockMode::kLockstep) return "";
  std::string text = std::string(sim::to_string(clock.mode)) + " time";
  if (clock.budget) text += ", budget " + clock.budget->budget.id;
  return text;
}

}  // namespace segsim::experiments::specs
