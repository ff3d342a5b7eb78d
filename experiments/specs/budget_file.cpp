#include "experiments/specs/budget_file.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <memory>
#include <sstream>
#include <vector>

#include "core/config.h"
#include "core/error.h"
#include "core/file_io.h"

namespace segsim::experiments::specs {
namespace {

namespace fs = std::filesystem;
using core::ConfigNode;
using sim::DurationModel;

constexpr double kMost_ms = 3.6e6;  // An hour: beyond that a unit was mistaken.
constexpr const char* kTraceHeader = "stage,index,duration_ns";

double milliseconds(const ConfigNode& node, const std::string& key) {
  const double value = node.number(key);
  if (!(value >= 0.0 && value <= kMost_ms)) {
    node.child(key).fail("milliseconds in [0, 3600000]", node.text(key));
  }
  return value;
}

sim::OnMiss read_on_miss(const ConfigNode& node, const std::string& key,
                         sim::OnMiss fallback) {
  if (!node.has(key)) return fallback;
  return static_cast<sim::OnMiss>(
      core::choice(node, key, {"use_stale", "drop", "hold", "zero_command", "abort"}));
}

/// Two numbers of a distribution, in order of their keys' meaning.
void read_pair(const ConfigNode& node, DurationModel::Kind kind, const char* a, const char* b,
               DurationModel& duration) {
  duration.kind = kind;
  duration.a_ms = milliseconds(node, a);
  duration.b_ms = milliseconds(node, b);
  if (kind != DurationModel::Kind::kNormal && duration.b_ms < duration.a_ms) {
    node.child(b).fail(std::string("at least ") + a, node.text(b));
  }
  if (kind == DurationModel::Kind::kLognormal && duration.a_ms <= 0.0) {
    node.child(a).fail("more than 0", node.text(a));
  }
  node.finish();
}

/// `dist: {lognormal: {p50, p95}} | {normal: {mean, sd}} | {uniform: {low, high}}`
void read_distribution(const ConfigNode& node, DurationModel& duration) {
  if (const auto lognormal = node.optional_child("lognormal")) {
    read_pair(*lognormal, DurationModel::Kind::kLognormal, "p50", "p95", duration);
  } else if (const auto normal = node.optional_child("normal")) {
    read_pair(*normal, DurationModel::Kind::kNormal, "mean", "sd", duration);
  } else if (const auto uniform = node.optional_child("uniform")) {
    read_pair(*uniform, DurationModel::Kind::kUniform, "low", "high", duration);
  } else {
    node.finish();  // Names a misspelt one.
    node.fail("lognormal, normal or uniform", "none");
  }
  node.finish();
}

DurationModel read_duration(const ConfigNode& node, const std::string& stage,
                            const fs::path& folder) {
  DurationModel duration;
  const int given = static_cast<int>(node.has("ms")) + static_cast<int>(node.has("dist")) +
                    static_cast<int>(node.has("trace"));
  if (given > 1) node.fail("one of ms, dist and trace", "several");
  if (node.has("per_item_ms")) duration.per_item_ms = milliseconds(node, "per_item_ms");
  if (given == 0 && duration.per_item_ms == 0.0) {
    node.fail("ms, dist, trace or per_item_ms", "none");
  }
  if (node.has("ms") && node.text("ms") == "measured") {
    duration.kind = DurationModel::Kind::kMeasured;
  } else if (node.has("ms")) {
    duration.a_ms = milliseconds(node, "ms");
  } else if (const auto dist = node.optional_child("dist")) {
    read_distribution(*dist, duration);
  } else if (node.has("trace")) {
    const fs::path file = folder / node.text("trace");
    duration.kind = DurationModel::Kind::kTrace;
    duration.trace = std::make_shared<const sim::LatencyTrace>(read_trace_csv(file));
    if (!duration.trace->has(stage)) {
      node.child("trace").fail("a trace with the stage " + stage, file.string());
    }
  }
  return duration;
}

sim::StageBudget read_stage(const ConfigNode& node, const std::string& name,
                            const fs::path& folder) {
  sim::StageBudget stage;
  stage.name = name;
  if (node.has("charge")) {
    stage.charge = static_cast<sim::Charge>(core::choice(node, "charge", {"robot", "sim"}));
  }
  stage.on = node.text_or("on", "");
  if (node.has("after")) {
    if (node.child("after").is_list()) {
      stage.after = node.texts("after");
    } else {
      stage.after = {node.text("after")};
    }
  }
  stage.duration = read_duration(node, name, folder);
  const bool measured = stage.duration.kind == DurationModel::Kind::kMeasured;
  if (measured && stage.charge == sim::Charge::kRobot) {
    node.child("ms").fail(
        "milliseconds (\"measured\" is for charge: sim; clock: {mode: measured} times the "
        "robot's stages)",
        "\"measured\"");
  }
  if (node.has("deadline_ms")) {
    stage.deadline_ns = sim::ns_from_ms(milliseconds(node, "deadline_ms"));
  }
  if (node.has("queue")) {
    stage.queue = static_cast<sim::QueueRule>(
        core::choice(node, "queue", {"newest", "fifo", "drop_new"}));
  }
  stage.queue_depth = stage.queue == sim::QueueRule::kFifo ? 64 : 1;
  if (node.has("depth")) {
    const std::int64_t depth = node.integer("depth");
    if (depth < 1 || depth > 1024) {
      node.child("depth").fail("an integer in [1, 1024]", node.text("depth"));
    }
    stage.queue_depth = static_cast<int>(depth);
  }
  node.finish();
  return stage;
}

void read_rules(const ConfigNode& root, BudgetFile& file) {
  sim::LatencyBudget& budget = file.budget;
  if (const auto node = root.optional_child("end_to_end")) {
    // The two ends are fixed; a file may say them.
    if (node->has("from")) (void)core::choice(*node, "from", {"capture"});
    if (node->has("to")) (void)core::choice(*node, "to", {"actuate"});
    budget.end_to_end_deadline_ns = sim::ns_from_ms(milliseconds(*node, "deadline_ms"));
    budget.on_miss = read_on_miss(*node, "on_miss", budget.on_miss);
    node->finish();
  }
  if (const auto node = root.optional_child("max_age_ms")) {
    budget.max_age_ns = sim::ns_from_ms(milliseconds(*node, "value"));
    budget.on_max_age = read_on_miss(*node, "on_exceed", budget.on_max_age);
    node->finish();
  }
  if (root.has("max_miss_rate")) {
    file.max_miss_rate = root.number("max_miss_rate");
    if (!(*file.max_miss_rate >= 0.0 && *file.max_miss_rate <= 1.0)) {
      root.child("max_miss_rate").fail("a share in [0, 1]", root.text("max_miss_rate"));
    }
  }
}

}  // namespace

BudgetFile read_budget_file(const fs::path& file) {
  return parse_budget(core::read_file(file), file);
}

BudgetFile parse_budget(const std::string& text, const fs::path& origin) {
  const ConfigNode root = ConfigNode::parse(text, origin.string());
  BudgetFile file;
  file.text = text;
  file.sha256 = core::sha256_hex(text);
  (void)core::choice(root, "schema", {kBudgetSchema});
  file.budget.id = root.text("id");
  if (const auto resources = root.optional_child("resources")) {
    for (const std::string& name : resources->keys()) {
      const std::int64_t count = resources->integer(name);
      if (count < 1 || count > 1024) {
        resources->child(name).fail("a number of servers in [1, 1024]", resources->text(name));
      }
      file.budget.resources[name] = static_cast<int>(count);
    }
  }
  const ConfigNode stages = root.child("stages");
  for (const std::string& name : stages.keys()) {
    const ConfigNode stage = stages.child(name);
    file.budget.stages.push_back(read_stage(stage, name, origin.parent_path()));
    if (stage.has("trace")) {  // What the trace says decides the trials, too.
      const fs::path trace = origin.parent_path() / stage.text("trace");
      file.sha256 = core::sha256_hex(file.sha256 + core::sha256_of_file(trace));
    }
  }
  read_rules(root, file);
  root.finish();
  const std::string problem = file.budget.problem();
  if (!problem.empty()) stages.fail("stages that fit together", problem);
  return file;
}

sim::LatencyTrace read_trace_csv(const fs::path& file) {
  std::istringstream in(core::read_file(file));
  sim::LatencyTrace trace;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::string place = file.string() + ":" + std::to_string(number);
    if (number == 1) {
      if (line != kTraceHeader) {
        throw core::InputError::expected(place, kTraceHeader, "\"" + line + "\"");
      }
      continue;
    }
    if (line.empty()) continue;
    const std::size_t first = line.find(','), second = line.find(',', first + 1);
    std::uint64_t index = 0;
    std::int64_t duration_ns = -1;
    const auto parse = [](const char* begin, const char* end, auto& value) {
      return std::from_chars(begin, end, value).ptr == end && begin != end;
    };
    const bool good = first != std::string::npos && second != std::string::npos && first > 0 &&
                      parse(line.data() + first + 1, line.data() + second, index) &&
                      parse(line.data() + second + 1, line.data() + line.size(), duration_ns);
    if (!good || duration_ns < 0) {
      throw core::InputError::expected(place, "stage,index,nanoseconds", "\"" + line + "\"");
    }
    trace.add(line.substr(0, first), index, duration_ns);
  }
  if (trace.empty()) throw core::InputError::expected(file.string(), "durations", "none");
  return trace;
}

void write_trace_csv(const fs::path& file, const sim::LatencyTrace& trace) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << kTraceHeader << '\n';
    for (const auto& [stage, entries] : trace.stages()) {
      for (const auto& [index, duration_ns] : entries) {
        out << stage << ',' << index << ',' << duration_ns << '\n';
      }
    }
  });
}

}  // namespace segsim::experiments::specs
