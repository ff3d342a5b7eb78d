// JSON Lines form of an EpisodeSet.
#include <algorithm>
#include <cmath>
#include <limits>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/bounds.h"
#include "core/input/json_depth.h"
#include "experiments/episodes/episodes.h"
#include "perception/data/json_node.h"

namespace segsim::experiments::episodes {
namespace {

using perception::Json;
using perception::JsonNode;

// What stands in the file is taken as it is or not at all: conversions would make 1 of `true`
// and any number of 1e23.

int count_of(const JsonNode& node) { return static_cast<int>(node.integer(0, 1'000'000'000)); }

double coordinate_of(const JsonNode& node) {
  return node.number(-core::kFarthest_m, core::kFarthest_m,
                     "a coordinate or angle within 1e7");
}

std::uint64_t seed_of(const JsonNode& node) {
  if (!node.json().is_number_unsigned()) node.fail("an integer from 0");
  return node.json().get<std::uint64_t>();
}

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

EpisodeRejections rejections_from(const JsonNode& json) {
  EpisodeRejections r;
  r.goals_without_instance = count_of(json.at("goals_without_instance"));
  r.instances_not_visible = count_of(json.at("instances_not_visible"));
  r.view_points_tested = count_of(json.at("view_points_tested"));
  r.view_points_kept = count_of(json.at("view_points_kept"));
  r.starts_goal_visible = count_of(json.at("starts_goal_visible"));
  r.starts.too_near = count_of(json.at("starts_too_near"));
  r.starts.too_far = count_of(json.at("starts_too_far"));
  r.starts.unreachable = count_of(json.at("starts_unreachable"));
  r.starts.too_tight = count_of(json.at("starts_too_tight"));
  r.starts.too_straight = count_of(json.at("starts_too_straight"));
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
  if (!episode.phrase.empty()) {
    json["phrase"] = episode.phrase;
    json["goal_instances"] = episode.goal_instances;
  }
  if (!episode.source.empty()) json["source"] = episode.source;
  return json;
}

/// Both keys or neither: a phrase alone does not say what success is judged by.
void read_phrase(const JsonNode& node, sim::Episode& episode) {
  if (!node.json().contains("phrase") && !node.json().contains("goal_instances")) return;
  episode.phrase = node.at("phrase").text();
  for (const JsonNode& id : node.at("goal_instances").items()) {
    episode.goal_instances.push_back(static_cast<std::uint16_t>(id.integer(1, 65535)));
  }
  if (episode.phrase.empty() || episode.goal_instances.empty()) {
    throw std::runtime_error("\"phrase\" must have words and \"goal_instances\" ids");
  }
}

sim::Episode episode_from(const Json& json) {
  const JsonNode node(json, "episode");
  sim::Episode episode;
  episode.id = json.at("id");
  episode.class_name = json.at("class");
  const std::vector<JsonNode> start = node.at("start").items();
  if (start.size() != 3) throw std::runtime_error("\"start\" must have 3 numbers");
  episode.start = {coordinate_of(start[0]), coordinate_of(start[1]), coordinate_of(start[2])};
  const Json& shortest = json.at("shortest_path_m");
  episode.shortest_path_m = shortest.is_null() ? std::numeric_limits<double>::infinity()
                                               : coordinate_of(node.at("shortest_path_m"));
  if (!(episode.shortest_path_m >= 0.0)) {
    throw std::runtime_error("\"shortest_path_m\" must be null or >= 0");
  }
  episode.seed = seed_of(node.at("seed"));
  for (const JsonNode& point : node.at("view_points").items()) {
    const std::vector<JsonNode> p = point.items();
    if (p.size() != 2) throw std::runtime_error("a view point must have 2 numbers");
    episode.view_points_m.emplace_back(coordinate_of(p[0]), coordinate_of(p[1]));
  }
  const std::size_t places = episode.view_points_m.size();
  if (places == 0 && !shortest.is_null()) throw std::runtime_error("no view points");
  if (json.contains("view_point_instances")) {
    for (const JsonNode& id : node.at("view_point_instances").items()) {
      episode.view_point_instance.push_back(static_cast<std::uint16_t>(id.integer(0, 65535)));
    }
  }
  if (json.contains("view_point_ious")) {
    for (const JsonNode& iou : node.at("view_point_ious").items()) {
      episode.view_point_iou.push_back(
          static_cast<float>(iou.number(0.0, 1.0, "a share in [0, 1]")));
    }
  }
  for (const std::size_t n :
       {episode.view_point_instance.size(), episode.view_point_iou.size()}) {
    if (n != 0 && n != places) {
      throw std::runtime_error("one value for each of " + std::to_string(places) +
                               " view points, or none, not " + std::to_string(n));
    }
  }
  read_phrase(node, episode);
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

EpisodeViewer viewer_from(const JsonNode& node) {
  const auto pair = [&](const char* key) {
    const std::vector<JsonNode> items = node.at(key).items();
    if (items.size() != 2) node.at(key).fail("2 numbers");
    return std::pair(coordinate_of(items[0]), coordinate_of(items[1]));
  };
  const auto [fx_px, fy_px] = pair("f");
  const auto [cx_px, cy_px] = pair("c");
  if (!(fx_px > 0.0 && fy_px > 0.0)) node.at("f").fail("focal lengths above 0");
  constexpr int kLongestSide_px = 8192;
  EpisodeViewer viewer;
  viewer.camera = {static_cast<int>(node.at("width").integer(1, kLongestSide_px)),
                   static_cast<int>(node.at("height").integer(1, kLongestSide_px)),
                   fx_px,
                   fy_px,
                   cx_px,
                   cy_px};
  viewer.camera_height_m = coordinate_of(node.at("camera_height_m"));
  viewer.camera_pitch_down_rad = coordinate_of(node.at("pitch_down_rad"));
  return viewer;
}

Json json_of(const OracleRecord& oracle) {
  return {{"successes", oracle.successes},
          {"episodes", oracle.episodes},
          {"spl", oracle.spl},
          {"profile", oracle.profile},
          {"flagged", oracle.rate() < OracleRecord::kExpected}};
}

OracleRecord oracle_from(const JsonNode& node) {
  return {count_of(node.at("successes")), count_of(node.at("episodes")),
          node.at("spl").number(0.0, 1.0, "a share in [0, 1]"), node.at("profile").text()};
}

Json header_of(const EpisodeSet& set) {
  const bool phrases =
      std::any_of(set.episodes.begin(), set.episodes.end(),
                  [](const sim::Episode& episode) { return !episode.phrase.empty(); });
  Json header{{"schema", phrases ? EpisodeSet::kPhraseSchema : EpisodeSet::kSchema},
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
  if (schema != EpisodeSet::kSchema && schema != EpisodeSet::kFirstSchema &&
      schema != EpisodeSet::kPhraseSchema) {
    throw std::runtime_error("schema \"" + schema + "\"");
  }
  EpisodeSet set;
  set.scene = json.at("scene");
  set.scene_sha256 = json.at("scene_sha256");
  set.robot = json.at("robot");
  set.rules_sha256 = json.at("rules_sha256");
  set.generator = json.value("generator", std::string());
  const JsonNode node(json, "header");
  set.seed = json.contains("seed") ? seed_of(node.at("seed")) : 0;
  set.navmesh_sha256 = json.value("navmesh_sha256", std::string());
  if (json.contains("viewer")) set.viewer = viewer_from(node.at("viewer"));
  if (json.contains("oracle")) set.oracle = oracle_from(node.at("oracle"));
  announced = static_cast<std::size_t>(count_of(node.at("count")));
  set.rejections = rejections_from(node.at("rejections"));
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
      const std::string document = text.substr(start, end - start);
      if (core::is_too_deep(document)) throw std::runtime_error("brackets without end");
      const Json json = Json::parse(document);
      if (line == 1) {
        set = read_header(json, announced);
      } else {
        set.episodes.push_back(episode_from(json));
      }
    } catch (const std::exception& error) {
      throw core::InputError::expected(file.string() + ":" + std::to_string(line),
                                       line == 1 ? std::string("a header of schema ") +
                                                       EpisodeSet::kSchema + " or " +
                                                       EpisodeSet::kPhraseSchema
                                                 : "an episode",
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
