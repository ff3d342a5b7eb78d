// Habitat's files into structs, as they are.
#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/episodes/habitat_episodes.h"
#include "experiments/support/gzip_file.h"

namespace segsim::experiments::episodes {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

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

HabitatGoal goal_from(const Json& json) {
  HabitatGoal goal;
  // Object ids are numbers in HM3D and text in some older sets.
  const Json& id = json.at("object_id");
  goal.object_id = id.is_string() ? std::stoi(id.get<std::string>()) : id.get<int>();
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

HabitatEpisode episode_from(const Json& json, int index) {
  HabitatEpisode episode;
  const Json& id = json.at("episode_id");
  episode.episode_id = id.is_string() ? id.get<std::string>() : id.dump();
  episode.index = index;
  episode.sha256 = core::sha256_hex(json.dump());
  episode.scene_id = json.at("scene_id");
  episode.category = json.at("object_category");
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
    const Json& by_category =
        root.contains("goals_by_category") ? root["goals_by_category"] : none_;
    int index = 0;
    for (const Json& json : episodes) {
      const std::string place = "episodes[" + std::to_string(index) + "]";
      guarded(place, [&] { add(json, index, by_category); });
      ++index;
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

  void add(const Json& json, int index, const Json& by_category) {
    HabitatEpisode episode = episode_from(json, index);
    const std::string scene_file = scene_file_name(episode.scene_id);
    HabitatScene& scene = scenes_[scene_file];
    if (scene.name.empty()) {
      scene.name = scene_file.substr(0, scene_file.find('.'));
      scene.scene_id = episode.scene_id;
      scene.file = file_;
    }
    if (!scene.goals.contains(episode.category)) {
      const std::string key = scene_file + "_" + episode.category;
      // Older files keep the goals inside the episodes; the first of a category has them.
      const bool inside = !by_category.contains(key);
      std::vector<HabitatGoal> goals = inside ? goals_from(json.value("goals", Json::array()))
                                              : goals_from(by_category[key]);
      if (goals.empty()) throw std::runtime_error("no goal under \"" + key + "\"");
      scene.goals[episode.category] = std::move(goals);
    }
    scene.episodes.push_back(std::move(episode));
  }

  const fs::path& file_;
  std::map<std::string, HabitatScene>& scenes_;
  const Json none_ = Json::object();
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
