// Habitat's files into structs, as they are.
#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/episodes/habitat_episodes.h"
#include "experiments/support/gzip_file.h"
#include "perception/data/checked_json.h"

namespace segsim::experiments::episodes {
namespace {

namespace fs = std::filesystem;
using Json = perception::CheckedJson;

glm::dvec3 vector_from(const Json& json) {
  if (json.size() != 3) throw std::runtime_error("a position must have 3 numbers");
  const glm::dvec3 p_m{json[0].get<double>(), json[1].get<double>(), json[2].get<double>()};
  if (!std::isfinite(p_m.x + p_m.y + p_m.z))
    throw std::runtime_error("a position is infinite");
  return p_m;
}

/// Files have x, y, z, w. The numbers are rounded, so the length is made 1 again.
glm::dquat rotation_from(const Json& json) {
  if (json.size() != 4) throw std::runtime_error("a rotation must have 4 numbers");
  const glm::dquat R{json[3].get<double>(), json[0].get<double>(), json[1].get<double>(),
                     json[2].get<double>()};
  const double length = glm::length(R);
  if (!(std::abs(length - 1.0) < 0.01))
    throw std::runtime_error("a rotation is no unit quaternion");
  return R / length;
}

std::optional<double> optional_number(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number()) return std::nullopt;
  return found->get<double>();
}

/// Numbers in HM3D, text in some older sets, and names that end in the number in OVON's and
/// GOAT-Bench's ("chair_12").
int object_id_from(const Json& json) {
  if (!json.is_string()) return json.get<int>();
  const std::string text = json.get<std::string>();
  const std::size_t digits = text.find_last_not_of("0123456789") + 1;
  if (digits == text.size()) throw std::runtime_error("an object_id has no number");
  return std::stoi(text.substr(digits));
}

HabitatGoal goal_from(const Json& json) {
  HabitatGoal goal;
  goal.object_id = object_id_from(json.at("object_id"));
  if (json.contains("object_name") && json["object_name"].is_string()) {
    goal.object_name = json["object_name"];
  }
  goal.p_habitat_m = vector_from(json.at("position"));
  for (const Json& point : json.at("view_points")) {
    const Json& state = point.at("agent_state");
    goal.view_points.push_back({vector_from(state.at("position")),
                                rotation_from(state.at("rotation")),
                                optional_number(point, "iou").value_or(0.0)});
  }
  return goal;
}

std::vector<HabitatGoal> goals_from(const Json& json) {
  std::vector<HabitatGoal> goals;
  for (const Json& goal : json) goals.push_back(goal_from(goal));
  return goals;
}

std::string scene_file_name(const std::string& scene_id) {
  return fs::path(scene_id).filename().string();
}

/// @param category  What is searched for.
HabitatEpisode episode_from(const Json& json, const std::string& category, int index) {
  HabitatEpisode episode;
  const Json& id = json.at("episode_id");
  episode.episode_id = id.is_string() ? id.get<std::string>() : id.dump();
  episode.index = index;
  episode.sha256 = core::sha256_hex(json.dump());
  episode.scene_id = json.at("scene_id");
  episode.category = category;
  episode.start_habitat_m = vector_from(json.at("start_position"));
  episode.R_habitat_start = rotation_from(json.at("start_rotation"));
  if (json.contains("info") && json["info"].is_object()) {
    episode.geodesic_m = optional_number(json["info"], "geodesic_distance");
    episode.euclidean_m = optional_number(json["info"], "euclidean_distance");
  }
  return episode;
}

/// Adds the scenes of one file, whose root is `root`.
class FileReader {
 public:
  FileReader(const fs::path& file, std::map<std::string, HabitatScene>& scenes)
      : file_(file), scenes_(scenes) {}

  void read(const Json& root) {
    const Json& episodes = at("the top", root, "episodes");
    const Json& by_category = root.contains("goals_by_category") ? root["goals_by_category"]
                              : root.contains("goals") ? root["goals"]  // GOAT-Bench.
                                                       : none_;
    int k = 0;
    for (const Json& json : episodes) {
      guarded("episodes[" + std::to_string(k++) + "]", [&] {
        if (json.contains("tasks")) {
          add_tasks(json, by_category);
        } else {
          add(episode_from(json, json.at("object_category"), index_++), json, by_category);
        }
      });
    }
  }

 private:
  template <class Work>
  void guarded(const std::string& place, const Work& work) {
    try {
      work();
    } catch (const std::exception& error) {
      throw core::InputError::expected(file_.string() + ": " + place,
                                       "an ObjectNav episode of Habitat", error.what());
    }
  }
  const Json& at(const std::string& place, const Json& json, const char* key) {
    if (json.is_object() && json.contains(key)) return json[key];
    throw core::InputError::expected(file_.string() + ": " + place,
                                     std::string("the key \"") + key + "\"", "none");
  }

  /// An episode of GOAT-Bench: [category, "object" | "description" | "image", object id, ...].
  void add_tasks(const Json& json, const Json& by_category) {
    int k = 0;
    for (const Json& task : json.at("tasks")) {
      const std::string number = std::to_string(k++);
      HabitatEpisode episode = episode_from(json, task.at(0), index_);
      if (task.at(1) != "object") {
        ++scene_of(episode).other_tasks;
        continue;
      }
      ++index_;
      episode.episode_id += "/" + number;
      // Lengths in the file are those of its whole list.
      episode.geodesic_m = episode.euclidean_m = std::nullopt;
      add(std::move(episode), json, by_category);
    }
  }

  void add(HabitatEpisode episode, const Json& json, const Json& by_category) {
    HabitatScene& scene = scene_of(episode);
    if (!scene.goals.contains(episode.category)) {
      scene.goals[episode.category] = goals_of(episode, json, by_category);
    }
    scene.episodes.push_back(std::move(episode));
  }

  HabitatScene& scene_of(const HabitatEpisode& episode) {
    const std::string scene_file = scene_file_name(episode.scene_id);
    HabitatScene& scene = scenes_[scene_file];
    if (scene.name.empty()) {
      scene.name = scene_file.substr(0, scene_file.find('.'));
      scene.scene_id = episode.scene_id;
      scene.file = file_;
    }
    return scene;
  }

  std::vector<HabitatGoal> goals_of(const HabitatEpisode& episode, const Json& json,
                                    const Json& by_category) {
    const auto key_of = [&](const std::string& category) {
      return scene_file_name(episode.scene_id) + "_" + category;
    };
    const std::string key = key_of(episode.category);
    // Older files keep the goals inside the episodes; the first of a category has them.
    const bool inside = !by_category.contains(key);
    const Json own = inside ? json.value("goals", Json::array()) : by_category[key];
    std::vector<HabitatGoal> goals = goals_from(own);
    if (goals.empty()) throw std::runtime_error("no goal under \"" + key + "\"");
    // "chair" of OVON is satisfied by an "armchair" as well.
    const Json& with_children = json.contains("children_object_categories") ? json : own[0];
    const Json children = with_children.value("children_object_categories", Json::array());
    for (const Json& child : children) {
      const auto found = by_category.find(key_of(child));
      if (found == by_category.end()) continue;
      for (HabitatGoal& goal : goals_from(*found)) goals.push_back(std::move(goal));
    }
    return goals;
  }

  const fs::path& file_;
  std::map<std::string, HabitatScene>& scenes_;
  const Json none_ = Json::object();
  int index_ = 0;  ///< Of the next episode.
};

Json parse_gzip(const fs::path& file) {
  const std::string text = support::read_gzip(file);
  try {
    return Json::parse(text);
  } catch (const std::exception& error) {
    throw core::InputError::expected(file.string(), "JSON", error.what());
  }
}

std::string stem_of(const fs::path& file) {
  const std::string name = file.filename().string();
  return name.substr(0, name.find('.'));
}

/// The content files that belong to a split's file, in the order of their names.
std::vector<fs::path> content_files(const fs::path& file) {
  std::vector<fs::path> files;
  const fs::path folder = file.parent_path() / "content";
  if (!fs::is_directory(folder)) return files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (entry.path().string().ends_with(".json.gz")) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

HabitatDataset read_habitat(const fs::path& file) {
  std::map<std::string, HabitatScene> scenes;
  FileReader(file, scenes).read(parse_gzip(file));
  for (const fs::path& content : content_files(file)) {
    FileReader(content, scenes).read(parse_gzip(content));
  }
  HabitatDataset dataset;
  dataset.split = stem_of(file);
  for (auto& [name, scene] : scenes) dataset.scenes.push_back(std::move(scene));
  if (dataset.scenes.empty()) {
    throw core::InputError::expected(
        file.string(), "episodes in it or in " + (file.parent_path() / "content").string(),
        "none");
  }
  return dataset;
}

}  // namespace segsim::experiments::episodes
