// JSON Lines form of an EpisodeSet.
#include <cmath>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/episodes.h"

namespace segsim::experiments {
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
            {"shortest_path_m", episode.shortest_path_m},
            {"seed", episode.seed}};
  json["view_points"] = Json::array();
  for (const glm::dvec2& p : episode.view_points_m) json["view_points"].push_back({p.x, p.y});
  return json;
}

sim::Episode episode_from(const Json& json) {
  sim::Episode episode;
  episode.id = json.at("id");
  episode.class_name = json.at("class");
  const Json& start = json.at("start");
  if (start.size() != 3) throw std::runtime_error("\"start\" must have 3 numbers");
  episode.start = {start[0], start[1], start[2]};
  episode.shortest_path_m = json.at("shortest_path_m");
  episode.seed = json.at("seed");
  for (const Json& p : json.at("view_points")) {
    if (p.size() != 2) throw std::runtime_error("a view point must have 2 numbers");
    episode.view_points_m.emplace_back(p[0].get<double>(), p[1].get<double>());
  }
  if (episode.view_points_m.empty()) throw std::runtime_error("no view points");
  if (!(episode.shortest_path_m >= 0.0) || !std::isfinite(episode.shortest_path_m)) {
    throw std::runtime_error("\"shortest_path_m\" must be finite and >= 0");
  }
  return episode;
}

}  // namespace

void write_episodes(const std::filesystem::path& file, const EpisodeSet& set) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    const Json header{{"schema", EpisodeSet::kSchema},        {"scene", set.scene},
                      {"scene_sha256", set.scene_sha256},     {"robot", set.robot},
                      {"rules_sha256", set.rules_sha256},     {"count", set.episodes.size()},
                      {"rejections", json_of(set.rejections)}};
    out << header.dump() << '\n';
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
        const std::string schema = json.at("schema");
        if (schema != EpisodeSet::kSchema) {
          throw std::runtime_error("schema \"" + schema + "\"");
        }
        set.scene = json.at("scene");
        set.scene_sha256 = json.at("scene_sha256");
        set.robot = json.at("robot");
        set.rules_sha256 = json.at("rules_sha256");
        announced = json.at("count");
        set.rejections = rejections_from(json.at("rejections"));
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

}  // namespace segsim::experiments
