#include "experiments/records/trial_log.h"

#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "experiments/support/gzip_file.h"
#include "perception/data/checked_json.h"

namespace segsim::experiments::records {
namespace {

using Json = perception::OrderedCheckedJson;

/// A tenth of a millimetre, and about as fine in angle: enough for a story and its pictures.
double rounded(double value) { return std::round(value * 1e4) / 1e4; }

Json json_point(const glm::dvec2& p_m) { return {rounded(p_m.x), rounded(p_m.y)}; }
glm::dvec2 point_from(const Json& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>()};
}

Json json_points(const std::vector<glm::dvec2>& points_m) {
  Json json = Json::array();
  for (const glm::dvec2& p_m : points_m) json.push_back(json_point(p_m));
  return json;
}
std::vector<glm::dvec2> points_from(const Json& json) {
  std::vector<glm::dvec2> points_m;
  for (const Json& p : json) points_m.push_back(point_from(p));
  return points_m;
}

Json json_tick(const TrialLog& log, std::size_t k) {
  const sim::TickRecord& t = log.track[k];
  const TickEvidence& e = log.evidence[k];
  Json json{t.time_ns / 1000,
            rounded(t.pose.x_m),
            rounded(t.pose.y_m),
            rounded(t.pose.yaw_rad),
            rounded(t.command.forward_mps),
            rounded(t.command.turn_radps),
            static_cast<int>(t.mode),
            t.in_contact ? 1 : 0,
            e.largest_px,
            e.instance,
            e.true_detections,
            e.false_detections,
            nullptr};
  if (std::isfinite(log.distance_m[k])) json.back() = rounded(log.distance_m[k]);
  return json;
}

void add_tick(const Json& json, TrialLog& log) {
  if (json.size() != 13) throw std::runtime_error("a tick must have 13 numbers");
  sim::TickRecord t;
  const auto time_us = json[0].get<std::int64_t>();
  constexpr std::int64_t kLatest_us = std::numeric_limits<std::int64_t>::max() / 1000;
  if (time_us < 0 || time_us > kLatest_us) {
    throw std::runtime_error("time " + std::to_string(time_us));
  }
  t.time_ns = time_us * 1000;
  t.pose = {json[1], json[2], json[3]};
  t.command = {json[4], json[5]};
  const int mode = json[6];
  if (mode < 0 || mode > static_cast<int>(core::PolicyMode::kStop)) {
    throw std::runtime_error("mode " + std::to_string(mode));
  }
  t.mode = static_cast<core::PolicyMode>(mode);
  t.in_contact = json[7].get<int>() != 0;
  const TickEvidence e{json[8], json[9], json[10], json[11]};
  constexpr int kMostDetections = 1 << 20;
  for (const int count : {e.true_detections, e.false_detections}) {
    if (count < 0 || count > kMostDetections) {
      throw std::runtime_error(std::to_string(count) + " detections");
    }
  }
  t.goal_pixels = e.largest_px;
  t.detections_of_goal = e.true_detections + e.false_detections;
  log.track.push_back(t);
  log.evidence.push_back(e);
  log.distance_m.push_back(json[12].is_null() ? std::numeric_limits<double>::infinity()
                                              : json[12].get<double>());
}

Json json_detection(const JudgedDetection& d) {
  return {d.tick,           d.box.x0, d.box.y0,
          d.box.x1,         d.box.y1, std::round(d.score * 1e4F) / 1e4F,
          d.is_goal ? 1 : 0};
}

JudgedDetection detection_from(const Json& json) {
  return {json.at(0),
          {json.at(1), json.at(2), json.at(3), json.at(4)},
          json.at(5),
          json.at(6).get<int>() != 0};
}

Json json_of(const TrialLog& log) {
  const core::CameraIntrinsics& c = log.camera;
  Json json{
      {"schema", TrialLog::kSchema},
      {"scene_title", log.scene_title},
      {"arm", log.arm},
      {"bundle", log.bundle.generic_string()},
      {"camera", {c.width_px, c.height_px, c.fx_px, c.fy_px, c.cx_px, c.cy_px}},
      {"camera_height_m", log.camera_height_m},
      {"camera_pitch_down_rad", log.camera_pitch_down_rad},
      {"visible_px", log.visible_px},
      {"control_period_s", log.control_period_s},
      {"time_limit_s", log.time_limit_s},
      {"stop_reason", core::to_string(log.stop_reason)},
      {"episode", log.episode.id},
      {"class", log.episode.class_name},
      {"start", {log.episode.start.x_m, log.episode.start.y_m, log.episode.start.yaw_rad}},
      {"shortest_path_m", log.episode.shortest_path_m},
      {"view_points", json_points(log.episode.view_points_m)},
      {"way", json_points(log.shortest_path_m)},
      {"ticks", Json::array()},
      {"detections", Json::array()},
      {"objects", Json::array()}};
  for (std::size_t k = 0; k < log.track.size(); ++k)
    json["ticks"].push_back(json_tick(log, k));
  for (const JudgedDetection& d : log.detections) {
    json["detections"].push_back(json_detection(d));
  }
  for (const core::PolicyView::Object& o : log.objects) {
    json["objects"].push_back({rounded(o.position_m.x), rounded(o.position_m.y), o.score});
  }
  if (!log.episode.phrase.empty()) {
    json["phrase"] = log.episode.phrase;
    json["goal_instances"] = log.episode.goal_instances;
  }
  if (log.target_m) json["target"] = json_point(*log.target_m);
  return json;
}

TrialLog log_from(const Json& json, const std::string& file) {
  const std::string schema = json.at("schema");
  if (schema != TrialLog::kSchema) throw std::runtime_error("schema \"" + schema + "\"");
  TrialLog log;
  log.scene_title = json.at("scene_title");
  log.arm = json.at("arm");
  log.bundle = json.at("bundle").get<std::string>();
  const Json& c = json.at("camera");
  log.camera = {c.at(0), c.at(1), c.at(2), c.at(3), c.at(4), c.at(5)};
  log.camera_height_m = json.at("camera_height_m");
  log.camera_pitch_down_rad = json.at("camera_pitch_down_rad");
  log.visible_px = json.at("visible_px");
  log.control_period_s = json.at("control_period_s");
  log.time_limit_s = json.at("time_limit_s");
  log.stop_reason = core::stop_reason_from(json.at("stop_reason").get<std::string>(),
                                           file + ": stop_reason");
  log.episode.id = json.at("episode");
  log.episode.class_name = json.at("class");
  if (json.contains("phrase")) {
    log.episode.phrase = json["phrase"];
    log.episode.goal_instances = json.at("goal_instances").get<std::vector<std::uint16_t>>();
  }
  const Json& start = json.at("start");
  log.episode.start = {start.at(0), start.at(1), start.at(2)};
  log.episode.shortest_path_m = json.at("shortest_path_m");
  log.episode.view_points_m = points_from(json.at("view_points"));
  log.shortest_path_m = points_from(json.at("way"));
  for (const Json& tick : json.at("ticks")) add_tick(tick, log);
  for (const Json& d : json.at("detections")) {
    log.detections.push_back(detection_from(d));
    if (log.detections.back().tick < 0 ||
        static_cast<std::size_t>(log.detections.back().tick) >= log.track.size()) {
      throw std::runtime_error("a detection at a tick that is not there");
    }
  }
  for (const Json& o : json.at("objects")) {
    log.objects.push_back({point_from(o), 0, o.at(2)});
  }
  if (json.contains("target")) log.target_m = point_from(json["target"]);
  if (log.track.empty()) throw std::runtime_error("no ticks");
  return log;
}

}  // namespace

void write_trial_log(const std::filesystem::path& file, const TrialLog& log) {
  support::write_gzip(file, json_of(log).dump());
}

TrialLog read_trial_log(const std::filesystem::path& file) {
  const std::string text = support::read_gzip(file);
  try {
    return log_from(Json::parse(text), file.string());
  } catch (const core::InputError&) {
    throw;
  } catch (const std::exception& error) {
    throw core::InputError::expected(file.string(),
                                     std::string("a trial log of schema ") + TrialLog::kSchema,
                                     error.what());
  }
}

}  // namespace segsim::experiments::records
