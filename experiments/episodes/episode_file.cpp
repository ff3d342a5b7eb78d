// JSON Lines form of an EpisodeSet.
#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/episodes/episodes.h"

namespace segsim::experiments::episodes {
namespace {

using Json = nlohmann::ordered_json;

Json json_of(const EpisodeRejections& r) {
  return {{"goals_without_instance", r.goals_without_instance},
          {"instances_not_visible", r.instances_not_visible},
          {"view_points_tested", r.view_points_tested},
          {"view_points_kept", r.view_points_kept},
          {"starts_goal_visible", r.starts_goal_visible},
          {"starts_too_near", r.starts.too_near},
          {"starts_too_far", r.starts.too_far},
          {"starts_unreachable", r.starts.unreachable},
          {"starts_too_tight", r.starts.too_tight},
          {"starts_too_straight", r.starts.too_straight}};
}

EpisodeRejections rejections_from(const Json& json) {
  EpisodeRejections r;
  r.goals_without_instance = json.at("goals_without_instance");
  r.instances_not_visible = json.at("instances_not_visible");
  r.view_points_tested = json.at("view_points_tested");
  r.view_points_kept = json.at("view_points_kept");
  r.starts_goal_visible = json.at("starts_goal_visible");
  r.starts.too_near = json.at("starts_too_near");
  r.starts.too_far = json.at("starts_too_far");
  r.starts.unreachable = json.at("starts_unreachable");
  r.starts.too_tight = json.at("starts_too_tight");
  r.starts.too_straight = json.at("starts_too_straight");
  return r;
}

Json json_of(const sim::Episode& episode) {
  Json json{{"id", episode.id},
            {"class", episode.class_name},
            {"start", {episode.start.x_m, episode.start.y_m, episode.start.yaw_rad}},
            {"shortest_path_m", nullptr},  // Null: no way to the goal.
            {"seed", episode.seed}};
  if (std::isfinite(episode.shortest_path_m)) {
    json["shortest_path_m"] = episode.shortest_path_m;
  }
  json["view_points"] = Json::array();
  for (const glm::dvec2& p : episode.view_points_m) json["view_points"].push_back({p.x, p.y});
  if (!episode.view_point_instance.empty()) {
    json["view_point_instances"] = episode.view_point_instance;
  }
  if (!episode.view_point_iou.empty()) json["view_point_ious"] = episode.view_point_iou;
  if (!episode.source.empty()) json["source"] = episode.source;
  return json;
}

sim::Episode episode_from(const Json& json) {
  sim::Episode episode;
  episode.id = json.at("id");
  episode.class_name = json.at("class");
  const Json& start = json.at("start");
  if (start.size() != 3) throw std::runtime_error("\"start\" must have 3 numbers");
  episode.start = {start[0], start[1], start[2]};
  const Json& shortest = json.at("shortest_path_m");
  episode.shortest_path_m =
      shortest.is_null() ? std::numeric_limits<double>::infinity() : shortest.get<double>();
  if (!(episode.shortest_path_m >= 0.0)) {
    throw std::runtime_error("\"shortest_path_m\" must be null or >= 0");
  }
  episode.seed = json.at("seed");
  for (const Json& p : json.at("view_points")) {
    if (p.size() != 2) throw std::runtime_error("a view point must have 2 numbers");
    episode.view_points_m.emplace_back(p[0].get<double>(), p[1].get<double>());
  }
  const std::size_t places = episode.view_points_m.size();
  if (places == 0 && !shortest.is_null()) throw std::runtime_error("no view points");
  if (json.contains("view_point_instances")) {
    json["view_point_instances"].get_to(episode.view_point_instance);
  }
  if (json.contains("view_point_ious")) {
    json["view_point_ious"].get_to(episode.view_point_iou);
  }
  for (const std::size_t n :
       {episode.view_point_instance.size(), episode.view_point_iou.size()}) {
    if (n != 0 && n != places) {
      throw std::runtime_error("one value for each of " + std::to_string(places) +
                               " view points, or none, not " + std::to_string(n));
    }
  }
  episode.source = json.value("source", std::string());
  return episode;
}

Json json_of(const EpisodeViewer& viewer) {
  const core::CameraIntrinsics& c = viewer.camera;
  return {{"width", c.width_px},
          {"height", c.height_px},
          {"f", {c.fx_px, c.fy_px}},
          {"c", {c.cx_px, c.cy_px}},
          {"camera_height_m", viewer.camera_height_m},
          {"pitch_down_rad", viewer.camera_pitch_down_rad}};
}

EpisodeViewer viewer_from(const Json& json) {
  EpisodeViewer viewer;
  viewer.camera = {json.at("width"),   json.at("height"),  json.at("f").at(0),
                   json.at("f").at(1), json.at("c").at(0), json.at("c").at(1)};
  viewer.camera_height_m = json.at("camera_height_m");
  viewer.camera_pitch_down_rad = json.at("pitch_down_rad");
  return viewer;
}

Json json_of(const OracleRecord& oracle) {
  return {{"successes", oracle.successes},
          {"episodes", oracle.episodes},
          {"spl", oracle.spl},
          {"profile", oracle.profile},
          {"flagged", oracle.rate() < OracleRecord::kExpected}};
}

OracleRecord oracle_from(const Json& json) {
  return {json.at("successes"), json.at("episodes"), json.at("spl"), json.at("profile")};
}

Json header_of(const EpisodeSet& set) {
  Json header{{"schema", EpisodeSet::kSchema},
              {"scene", set.scene},
              {"scene_sha256", set.scene_sha256},
              {"robot", set.robot},
              {"rules_sha256", set.rules_sha256},
              {"generator", set.generator},
              {"seed", set.seed},
              {"navmesh_sha256", set.navmesh_sha256},
              {"count", set.episodes.size()},
              {"rejections", json_of(set.rejections)}};
  if (set.viewer) header["viewer"] = json_of(*set.viewer);
  if (set.oracle) header["oracle"] = json_of(*set.oracle);
  return header;
}

/// Everything but the episodes. @param announced  How many there should be.
EpisodeSet read_header(const Json& json, std::size_t& announced) {
  const std::string schema = json.at("schema");
  if (schema != EpisodeSet::kSchema && schema != EpisodeSet::kFirstSchema) {
    throw std::runtime_error("schema \"" + schema + "\"");
  }
  EpisodeSet set;
  set.scene = json.at("scene");
  set.scene_sha256 = json.at("scene_sha256");
  set.robot = json.at("robot");
  set.rules_sha256 = json.at("rules_sha256");
  set.generator = json.value("generator", std::string());
  set.seed = json.value("seed", std::uint64_t{0});
  set.navmesh_sha256 = json.value("navmesh_sha256", std::string());
  if (json.contains("viewer")) set.viewer = viewer_from(json["viewer"]);
  if (json.contains("oracle")) set.oracle = oracle_from(json["oracle"]);
  announced = json.at("count");
  set.rejections = rejections_from(json.at("rejections"));
  return set;
}

}  // namespace

void write_episodes(const std::filesystem::path& file, const EpisodeSet& set) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << header_of(set).dump() << '\n';
    for (const sim::Episode& episode : set.episodes) out << json_of(episode).dump() << '\n';
  });
}

EpisodeSet read_episodes(const std::filesystem::path& file) {
  const std::string text = core::read_file(file);
  EpisodeSet set;
  std::size_t start = 0, announced = 0;
  for (int line = 1; start < text.size(); ++line) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    try {
      const Json json = Json::parse(text.substr(start, end - start));
      if (line == 1) {
        set = read_header(json, announced);
      } else {
        set.episodes.push_back(episode_from(json));
      }
    } catch (const std::exception& error) {
      throw core::InputError::expected(
          file.string() + ":" + std::to_string(line),
          line == 1 ? std::string("a header of schema ") + EpisodeSet::kSchema : "an episode",
          error.what());
    }
    start = end + 1;
  }
  if (set.scene.empty() || set.episodes.size() != announced) {
    throw core::InputError::expected(file.string(), std::to_string(announced) + " episodes",
                                     std::to_string(set.episodes.size()));
  }
  return set;
}

}  // namespace segsim::experiments::episodes
