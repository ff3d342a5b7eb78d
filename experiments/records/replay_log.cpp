#include "experiments/records/replay_log.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <sstream>
#include <utility>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "perception/data/checked_json.h"
#include "renderer/files/exr_io.h"
#include "renderer/files/frame_writer.h"

namespace segsim::experiments::records {
namespace {

namespace fs = std::filesystem;
using Json = perception::OrderedCheckedJson;

std::uint64_t from_hex(const std::string& text) {
  std::uint64_t value = 0;
  const char* end = text.data() + text.size();
  if (text.size() != 16 || std::from_chars(text.data(), end, value, 16).ptr != end) {
    throw core::InputError("\"" + text + "\" is no hash");
  }
  return value;
}

Json to_json(const sim::TickRecord& tick, std::size_t number) {
  return {{"tick", number},
          {"time_ns", tick.time_ns},
          {"pose", {tick.pose.x_m, tick.pose.y_m, tick.pose.yaw_rad}},
          {"command", {tick.command.forward_mps, tick.command.turn_radps}},
          {"mode", static_cast<int>(tick.mode)},
          {"contact", tick.in_contact},
          {"image", tick.capture_index},
          {"age_ns", tick.age_ns},
          {"fresh", tick.fresh},
          {"goal_pixels", tick.goal_pixels},
          {"goal_detections", tick.detections_of_goal},
          {"detections", core::hex(tick.detections_hash)},
          {"hash", core::hex(tick.state_hash)}};
}

sim::TickRecord tick_from(const Json& json) {
  sim::TickRecord tick;
  tick.time_ns = json.at("time_ns").get<core::TimeNs>();
  const auto pose = json.at("pose").get<std::array<double, 3>>();
  tick.pose = {pose[0], pose[1], pose[2]};
  const auto command = json.at("command").get<std::array<double, 2>>();
  tick.command = {command[0], command[1]};
  const int mode = json.at("mode").get<int>();
  if (mode < 0 || mode > static_cast<int>(core::PolicyMode::kStop)) {
    throw core::InputError("mode " + std::to_string(mode));
  }
  tick.mode = static_cast<core::PolicyMode>(mode);
  tick.in_contact = json.at("contact").get<bool>();
  tick.capture_index = json.at("image").get<std::int64_t>();
  tick.age_ns = json.at("age_ns").get<core::TimeNs>();
  tick.fresh = json.at("fresh").get<bool>();
  tick.goal_pixels = json.at("goal_pixels").get<int>();
  tick.detections_of_goal = json.at("goal_detections").get<int>();
  tick.detections_hash = from_hex(json.at("detections").get<std::string>());
  tick.state_hash = from_hex(json.at("hash").get<std::string>());
  return tick;
}

Json to_json(const std::vector<core::Detection>& detections) {
  Json list = Json::array();
  for (const core::Detection& d : detections) {
    // A float is exact as a double, and a double as shortest decimal text.
    list.push_back({d.class_index, d.score, d.box.x0, d.box.y0, d.box.x1, d.box.y1});
  }
  return list;
}

std::vector<core::Detection> detections_from(const Json& json) {
  std::vector<core::Detection> detections;
  for (const Json& d : json) {
    const auto number = [&d](std::size_t k) {
      return static_cast<float>(d.at(k).get<double>());
    };
    detections.push_back(
        {d.at(0).get<int>(), number(1), {number(2), number(3), number(4), number(5)}});
  }
  return detections;
}

Json to_json(const sim::StageTiming& stage) {
  return {{"name", stage.name},     {"deadline_ns", stage.deadline_ns},
          {"misses", stage.misses}, {"longest_miss_run", stage.longest_miss_run},
          {"drops", stage.drops},   {"response_ns", stage.response.values_ns()}};
}

sim::DurationSamples samples_from(const Json& json) {
  sim::DurationSamples samples;
  for (const Json& value : json) samples.add(value.get<core::TimeNs>());
  return samples;
}

sim::StageTiming stage_from(const Json& json) {
  sim::StageTiming stage;
  stage.name = json.at("name").get<std::string>();
  stage.deadline_ns = json.at("deadline_ns").get<core::TimeNs>();
  stage.response = samples_from(json.at("response_ns"));
  stage.misses = json.at("misses").get<int>();
  stage.longest_miss_run = json.at("longest_miss_run").get<int>();
  stage.drops = json.at("drops").get<int>();
  return stage;
}

Json to_json(const sim::TimingReport& timing) {
  Json stages = Json::array(), resources = Json::object();
  for (const sim::StageTiming& stage : timing.stages) stages.push_back(to_json(stage));
  for (const auto& [name, used] : timing.resources) {
    resources[name] = {{"servers", used.servers}, {"busy_ns", used.busy_ns}};
  }
  return {{"stages", stages},
          {"end_to_end", to_json(timing.end_to_end)},
          {"age_ns", timing.age.values_ns()},
          {"resources", resources},
          {"span_ns", timing.span_ns},
          {"ticks_without_image", timing.ticks_without_image},
          {"ticks_without_news", timing.ticks_without_news},
          {"overruns", timing.overruns}};
}

sim::TimingReport timing_from(const Json& json) {
  sim::TimingReport timing;
  for (const Json& stage : json.at("stages")) timing.stages.push_back(stage_from(stage));
  timing.end_to_end = stage_from(json.at("end_to_end"));
  timing.age = samples_from(json.at("age_ns"));
  for (const auto& [name, used] : json.at("resources").items()) {
    timing.resources[name] = {used.at("servers").get<int>(),
                              used.at("busy_ns").get<core::TimeNs>()};
  }
  timing.span_ns = json.at("span_ns").get<core::TimeNs>();
  timing.ticks_without_image = json.at("ticks_without_image").get<int>();
  timing.ticks_without_news = json.at("ticks_without_news").get<int>();
  timing.overruns = json.at("overruns").get<int>();
  return timing;
}

Json to_json(const std::vector<sim::SensorLog::Digest>& sensors) {
  Json json = Json::object();
  for (const sim::SensorLog::Digest& digest : sensors) {
    json[digest.sensor] = {digest.readings, core::hex(digest.hash)};
  }
  return json;
}

std::vector<sim::SensorLog::Digest> sensors_from(const Json& json) {
  std::vector<sim::SensorLog::Digest> sensors;
  for (const auto& [name, digest] : json.items()) {
    sensors.push_back(
        {name, digest.at(0).get<std::size_t>(), from_hex(digest.at(1).get<std::string>())});
  }
  return sensors;
}

Json header_of(const ReplayLog& log) {
  return {{"schema", ReplayLog::kSchema},
          {"spec", log.spec_text},
          {"spec_file", log.spec_file},
          {"scene", log.scene},
          {"arm", log.arm},
          {"episode", log.episode},
          {"repetition", log.repetition},
          {"scene_sha256", log.scene_sha256},
          {"code_version", log.code_version},
          {"clock", log.clock_mode},
          {"classes", log.class_names},
          {"images", log.images}};
}

void read_header(const Json& json, ReplayLog& log) {
  log.spec_text = json.at("spec").get<std::string>();
  log.spec_file = json.at("spec_file").get<std::string>();
  log.scene = json.at("scene").get<std::string>();
  log.arm = json.at("arm").get<std::string>();
  log.episode = json.at("episode").get<std::string>();
  log.repetition = json.at("repetition").get<int>();
  log.scene_sha256 = json.at("scene_sha256").get<std::string>();
  log.code_version = json.at("code_version").get<std::string>();
  log.clock_mode = json.at("clock").get<std::string>();
  log.class_names = json.at("classes").get<std::vector<std::string>>();
  log.images = json.at("images").get<bool>();
}

void read_line(const Json& json, ReplayLog& log) {
  if (json.contains("tick")) {
    if (json.at("tick").get<std::size_t>() != log.ticks.size()) {
      throw core::InputError("tick " + json.at("tick").dump() + " out of order");
    }
    log.ticks.push_back(tick_from(json));
  } else if (json.contains("image")) {
    log.detections[json.at("image").get<std::uint64_t>()] =
        detections_from(json.at("detections"));
  } else if (json.contains("trace")) {
    for (const auto& [stage, entries] : json.at("trace").items()) {
      for (const Json& entry : entries) {
        log.trace.add(stage, entry.at(0).get<std::uint64_t>(),
                      entry.at(1).get<core::TimeNs>());
      }
    }
  } else if (json.contains("timing")) {
    log.timing = timing_from(json.at("timing"));
  } else if (json.contains("sensors")) {
    log.sensors = sensors_from(json.at("sensors"));
  } else if (json.contains("result")) {
    log.outcome =
        sim::outcome_from(json.at("result").at("outcome").get<std::string>(), "outcome");
    log.state_hash = from_hex(json.at("result").at("hash").get<std::string>());
  } else {
    throw core::InputError("a line of an unknown kind");
  }
}

std::string exact(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", value);
  return text;
}

std::string exact(const core::Pose2& pose) {
  return "(" + exact(pose.x_m) + ", " + exact(pose.y_m) + ", " + exact(pose.yaw_rad) + ")";
}

std::string exact(const core::VelocityCommand& command) {
  return "(" + exact(command.forward_mps) + ", " + exact(command.turn_radps) + ")";
}

/// Fields in the order in which one follows from the other.
std::vector<std::pair<const char*, std::string>> fields_of(const sim::TickRecord& tick) {
  return {{"time_ns", std::to_string(tick.time_ns)},
          {"pose", exact(tick.pose)},
          {"contact", tick.in_contact ? "yes" : "no"},
          {"image", std::to_string(tick.capture_index)},
          {"age_ns", std::to_string(tick.age_ns)},
          {"detections", core::hex(tick.detections_hash)},
          {"command", exact(tick.command)},
          {"mode", core::to_string(tick.mode)},
          {"goal_pixels", std::to_string(tick.goal_pixels)},
          {"hash", core::hex(tick.state_hash)}};
}

}  // namespace

ReplayLog with_result(ReplayLog log, const sim::TrialResult& result) {
  log.ticks = result.track;
  log.trace = result.trace;
  log.timing = result.timing;
  log.sensors = result.sensors.digests();
  log.outcome = result.outcome;
  log.state_hash = result.state_hash;
  return log;
}

void write_replay_log(const fs::path& file, const ReplayLog& log) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << header_of(log).dump() << '\n';
    for (const auto& [image, detections] : log.detections) {
      out << Json{{"image", image}, {"detections", to_json(detections)}}.dump() << '\n';
    }
    for (std::size_t k = 0; k < log.ticks.size(); ++k) {
      out << to_json(log.ticks[k], k).dump() << '\n';
    }
    Json trace = Json::object();
    for (const auto& [stage, entries] : log.trace.stages()) trace[stage] = entries;
    out << Json{{"trace", trace}}.dump() << '\n';
    out << Json{{"timing", to_json(log.timing)}}.dump() << '\n';
    if (!log.sensors.empty()) {
      out << Json{{"sensors", to_json(log.sensors)}}.dump() << '\n';
    }
    out << Json{{"result",
                 {{"outcome", sim::to_string(log.outcome)},
                  {"hash", core::hex(log.state_hash)}}}}
               .dump()
        << '\n';
  });
}

ReplayLog read_replay_log(const fs::path& file) {
  std::istringstream in(core::read_file(file));
  ReplayLog log;
  std::string line;
  int number = 0;
  bool complete = false;
  while (std::getline(in, line)) {
    ++number;
    try {
      const Json json = Json::parse(line);
      if (number == 1) {
        if (json.value("schema", "") != ReplayLog::kSchema) {
          throw core::InputError("another schema");
        }
        read_header(json, log);
      } else {
        read_line(json, log);
        complete = json.contains("result");
      }
    } catch (const std::exception& error) {
      throw core::InputError::expected(file.string() + ":" + std::to_string(number),
                                       std::string("a line of ") + ReplayLog::kSchema,
                                       error.what());
    }
  }
  if (!complete) {
    throw core::InputError::expected(file.string(), "a whole log", "no line with the result");
  }
  return log;
}

fs::path replay_log_of(const fs::path& work, const TrialRow& trial) {
  // Files of one trial have the same name in different folders.
  if (trial.log.empty()) return {};
  fs::path stem = fs::path(trial.log).lexically_relative("logs");
  while (stem.has_extension() && (stem.extension() == ".gz" || stem.extension() == ".json")) {
    stem.replace_extension();
  }
  return work / "replays" / (stem.string() + ".jsonl");
}

fs::path replay_images(const fs::path& log_file) {
  return fs::path(log_file).replace_extension(".images");
}

Divergence first_divergence(const std::vector<sim::TickRecord>& recorded,
                            const std::vector<sim::TickRecord>& replayed) {
  for (std::size_t k = 0; k < std::min(recorded.size(), replayed.size()); ++k) {
    const auto a = fields_of(recorded[k]), b = fields_of(replayed[k]);
    for (std::size_t f = 0; f < a.size(); ++f) {
      if (a[f].second != b[f].second) {
        return {static_cast<int>(k), a[f].first, a[f].second, b[f].second};
      }
    }
  }
  if (recorded.size() != replayed.size()) {
    return {static_cast<int>(std::min(recorded.size(), replayed.size())), "ticks",
            std::to_string(recorded.size()), std::to_string(replayed.size())};
  }
  return {};
}

std::string first_differing_sensor(const std::vector<sim::SensorLog::Digest>& recorded,
                                   const std::vector<sim::SensorLog::Digest>& replayed) {
  for (std::size_t k = 0; k < std::max(recorded.size(), replayed.size()); ++k) {
    if (k >= recorded.size()) return replayed[k].sensor;
    if (k >= replayed.size() || recorded[k] != replayed[k]) return recorded[k].sensor;
  }
  return {};
}

std::vector<core::Detection> RecordingDetector::detect(const core::Observation& seen) {
  std::vector<core::Detection> detections = inner_.detect(seen);
  log_.detections[seen.capture_index] = detections;
  return detections;
}

std::vector<core::Detection> ReplayDetector::detect(const core::Observation& seen) {
  const auto found = log_.detections.find(seen.capture_index);
  if (found == log_.detections.end()) {
    throw core::InputError::expected(
        "replay log", "detections of image " + std::to_string(seen.capture_index),
        "none: the replay has left the recorded trial");
  }
  return found->second;
}

RecordingRenderer::RecordingRenderer(core::Renderer& inner, fs::path folder)
    : inner_(inner), folder_(std::move(folder)) {
  std::error_code ignored;  // Writing the first image reports a folder that cannot be made.
  fs::remove_all(folder_, ignored);
  fs::create_directories(folder_, ignored);
}

void RecordingRenderer::render(const core::CameraPose& T_world_camera,
                               const core::CameraIntrinsics& intrinsics,
                               core::Channels channels, core::Frame& frame) {
  inner_.render(T_world_camera, intrinsics, channels, frame);
  core::Frame kept;
  kept.intrinsics = frame.intrinsics;
  kept.T_world_camera = frame.T_world_camera;
  kept.depth_m = frame.depth_m;
  kept.alpha = frame.alpha;
  kept.semantic = frame.semantic;
  kept.instance = frame.instance;
  kept.confidence = frame.confidence;
  kept.instance_confidence = frame.instance_confidence;
  renderer::write_frame_exr(folder_ / renderer::sequence_file_name(calls_++), kept);
}

void ReplayRenderer::render(const core::CameraPose& T_world_camera,
                            const core::CameraIntrinsics& intrinsics,
                            core::Channels /*channels*/, core::Frame& frame) {
  const fs::path file = folder_ / renderer::sequence_file_name(calls_++);
  if (!fs::exists(file)) {
    throw core::InputError::expected(file.string(), "a recorded image",
                                     "none: the replay has left the recorded trial");
  }
  frame = renderer::read_frame_exr(file);
  frame.T_world_camera = T_world_camera;
  frame.intrinsics = intrinsics;
  frame.rgb = core::Image<core::Rgb8>(intrinsics.width_px, intrinsics.height_px);
}

}  // namespace segsim::experiments::records
