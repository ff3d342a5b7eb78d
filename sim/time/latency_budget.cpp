#include "sim/time/latency_budget.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {
namespace {

constexpr double kNormal95 = 1.6448536269514722;  // 95 % quantile of the standard normal.

double draw_ms(const DurationModel& model, core::RandomStream& random) {
  switch (model.kind) {
    case DurationModel::Kind::kLognormal:
      return model.a_ms *
             std::exp(std::log(model.b_ms / model.a_ms) / kNormal95 * random.normal());
    case DurationModel::Kind::kNormal:
      return model.a_ms + model.b_ms * random.normal();
    case DurationModel::Kind::kUniform:
      return random.uniform(model.a_ms, model.b_ms);
    default:
      return model.a_ms;
  }
}

bool is_fixed_place(StageRole role) {
  return role == StageRole::kCapture || role == StageRole::kPolicy ||
         role == StageRole::kActuate;
}

/// What is wrong with one stage on its own.
std::string problem_of(const StageBudget& stage, const LatencyBudget& budget) {
  if (!stage.on.empty() && !budget.resources.contains(stage.on)) {
    return "stage " + stage.name + " runs on the unknown resource " + stage.on;
  }
  // Exposures overlap, and so do commands on the wire.
  const StageRole role = stage.role();
  if ((role == StageRole::kCapture || role == StageRole::kActuate) && !stage.on.empty()) {
    return "stage " + stage.name + " runs on no resource";
  }
  if (stage.queue_depth < 1) return "stage " + stage.name + " has a queue without room";
  const bool after_policy =
      stage.after == std::vector<std::string>{to_string(StageRole::kPolicy)};
  if (is_fixed_place(role) && !stage.after.empty() &&
      !(role == StageRole::kActuate && after_policy)) {
    return "stage " + stage.name + " has a fixed place, it comes after nothing else";
  }
  if (is_fixed_place(role) && stage.charge == Charge::kSim) {
    return "stage " + stage.name + " is the robot's, it cannot be charged to sim";
  }
  return "";
}

}  // namespace

const char* to_string(Charge charge) { return charge == Charge::kRobot ? "robot" : "sim"; }

const char* to_string(QueueRule rule) {
  constexpr const char* kNames[] = {"newest", "fifo", "drop_new"};
  return kNames[static_cast<std::size_t>(rule)];
}

const char* to_string(OnMiss rule) {
  constexpr const char* kNames[] = {"use_stale", "drop", "hold", "zero_command", "abort"};
  return kNames[static_cast<std::size_t>(rule)];
}

void LatencyTrace::add(const std::string& stage, std::uint64_t index,
                       core::TimeNs duration_ns) {
  Entries& entries = stages_[stage];
  const auto at = std::lower_bound(
      entries.begin(), entries.end(), index,
      [](const auto& entry, std::uint64_t wanted) { return entry.first < wanted; });
  entries.insert(at, {index, duration_ns});
}

core::TimeNs LatencyTrace::at(const std::string& stage, std::uint64_t index) const {
  const auto found = stages_.find(stage);
  SEGSIM_CHECK(found != stages_.end(), stage);
  const Entries& entries = found->second;
  const auto at = std::lower_bound(
      entries.begin(), entries.end(), index,
      [](const auto& entry, std::uint64_t wanted) { return entry.first < wanted; });
  if (at != entries.end() && at->first == index) return at->second;
  return entries[index % entries.size()].second;
}

core::TimeNs DurationModel::draw(const std::string& stage, std::uint64_t episode_seed,
                                 std::uint64_t index, int items,
                                 core::TimeNs measured_ns) const {
  core::TimeNs base_ns = 0;
  if (kind == Kind::kMeasured) {
    base_ns = measured_ns;
  } else if (kind == Kind::kTrace) {
    base_ns = trace->at(stage, index);
  } else {
    core::RandomStream random(episode_seed, "latency/" + stage, index);
    base_ns = ns_from_ms(draw_ms(*this, random));
  }
  return std::max<core::TimeNs>(0, base_ns + ns_from_ms(per_item_ms * items + added_ms));
}

const StageBudget* LatencyBudget::find(const std::string& stage) const {
  const auto found = std::find_if(stages.begin(), stages.end(),
                                  [&](const StageBudget& s) { return s.name == stage; });
  return found == stages.end() ? nullptr : &*found;
}

StageBudget* LatencyBudget::find(const std::string& stage) {
  return const_cast<StageBudget*>(std::as_const(*this).find(stage));
}

std::string LatencyBudget::problem() const {
  std::set<std::string> names;
  for (const StageBudget& stage : stages) {
    if (!names.insert(stage.name).second) return "stage " + stage.name + " twice";
    std::string found = problem_of(stage, *this);
    if (!found.empty()) return found;
  }
  // Stages become ready as their predecessors do; what never becomes ready is on a cycle.
  std::set<std::string> ready{to_string(StageRole::kCapture)};
  for (const StageBudget& stage : stages) {
    for (const std::string& before : stage.after) {
      const StageRole before_role = stage_role(before);
      if (before_role == StageRole::kCapture || is_fixed_place(stage.role())) continue;
      const StageBudget* other = find(before);
      if (other == nullptr) return "stage " + stage.name + " comes after unknown " + before;
      if (is_fixed_place(before_role)) {
        return "stage " + stage.name + " comes after " + before + ", which is not possible";
      }
      if (other->charge == Charge::kSim && stage.charge == Charge::kRobot) {
        return "stage " + stage.name + " of the robot comes after " + before +
               ", which is charged to sim";
      }
    }
  }
  for (std::size_t round = 0; round <= stages.size(); ++round) {
    for (const StageBudget& stage : stages) {
      const bool all = std::all_of(stage.after.begin(), stage.after.end(),
                                   [&](const std::string& s) { return ready.contains(s); });
      if (all || is_fixed_place(stage.role())) ready.insert(stage.name);
    }
  }
  for (const StageBudget& stage : stages) {
    if (!ready.contains(stage.name)) return "stage " + stage.name + " waits for itself";
  }
  return "";
}

LatencyBudget with_trace(LatencyBudget budget,
                         const std::shared_ptr<const LatencyTrace>& trace) {
  for (StageBudget& stage : budget.stages) {
    if (!trace->has(stage.name)) continue;
    stage.duration = {};
    stage.duration.kind = DurationModel::Kind::kTrace;
    stage.duration.trace = trace;
  }
  return budget;
}

}  // namespace segsim::sim
