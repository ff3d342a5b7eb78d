#include "experiments/episodes/episode_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>

#include "core/config.h"
#include "core/error.h"
#include "sim/trial/goal_objects.h"

namespace segsim::experiments::episodes {
namespace {

constexpr double kSameLength_m = 0.05, kSameLengthShare = 0.01;
constexpr double kSnap_m = sim::DistanceField::kSnap_m;

/// Things that a phrase means are in the bundle, and of the class that the episode names.
void check_instances(const sim::Episode& episode, const std::string& place,
                     const core::SceneBundle& bundle) {
  const sim::GoalObjects goal(bundle.manifest, episode);
  for (const std::uint16_t id : episode.goal_instances) {
    const bool found =
        std::any_of(bundle.manifest.instances.begin(), bundle.manifest.instances.end(),
                    [&](const core::SceneInstance& instance) {
                      return instance.id == id && goal.holds(instance);
                    });
    if (found) continue;
    throw core::InputError::expected(
        place + ": " + episode.id + ": goal_instances",
        "things of class " + episode.class_name + " of " + bundle.folder.string(),
        std::to_string(id));
  }
}

void check_classes(const EpisodeSet& set, const std::string& place,
                   const core::SceneBundle& bundle) {
  std::vector<std::string> names;
  for (const core::SceneClass& c : bundle.manifest.classes) names.push_back(c.name);
  for (const sim::Episode& episode : set.episodes) {
    if (std::find(names.begin(), names.end(), episode.class_name) != names.end()) {
      check_instances(episode, place, bundle);
      continue;
    }
    const std::string near = core::nearest_word(episode.class_name, names);
    throw core::InputError::expected(
        place + ": " + episode.id, "a class of " + bundle.folder.string(),
        "\"" + episode.class_name + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
  }
}

/// Fields of equal view points are equal; those of one class follow one another seldom, so all
/// are kept.
class Fields {
 public:
  explicit Fields(const sim::World& world) : world_(world) {}
  const sim::DistanceField& to(const std::vector<glm::dvec2>& view_points_m) {
    for (const auto& [points, field] : fields_) {
      if (points == view_points_m) return *field;
    }
    fields_.emplace_back(view_points_m, std::make_unique<sim::DistanceField>(
                                            world_.distance_to(view_points_m)));
    return *fields_.back().second;
  }

 private:
  const sim::World& world_;
  std::vector<std::pair<std::vector<glm::dvec2>, std::unique_ptr<sim::DistanceField>>> fields_;
};

}  // namespace

const char* to_string(EpisodeState state) {
  constexpr std::array kNames{"fine",          "another length", "trivial", "off the navmesh",
                              "blocked start", "unreachable"};
  return kNames[static_cast<std::size_t>(state)];
}

std::vector<EpisodeFinding> bind_episodes(EpisodeSet& set, const std::string& place,
                                          const core::SceneBundle& bundle,
                                          const sim::World& world) {
  if (!set.scene_sha256.empty() && set.scene_sha256 != bundle.scene_sha256) {
    throw core::InputError::expected(place, "episodes of the bundle " + bundle.folder.string(),
                                     "those of another (scene hash " +
                                         set.scene_sha256.substr(0, 12) + ", not " +
                                         bundle.scene_sha256.substr(0, 12) + ")");
  }
  check_classes(set, place, bundle);
  Fields fields(world);
  std::vector<EpisodeFinding> findings;
  for (sim::Episode& episode : set.episodes) {
    const glm::dvec2 start_m(episode.start.x_m, episode.start.y_m);
    EpisodeFinding finding{episode.id, EpisodeState::kFine, episode.shortest_path_m,
                           std::numeric_limits<double>::infinity()};
    if (world.free_space().nearest_free(start_m, kSnap_m).x < 0) {
      finding.state = EpisodeState::kOffNavmesh;
    } else if (world.collision().collides(episode.start)) {
      finding.state = EpisodeState::kBlockedStart;
    } else if (episode.view_points_m.empty()) {
      finding.state = EpisodeState::kUnreachable;
    } else {
      finding.world_m = fields.to(episode.view_points_m).at(start_m);
      const double tolerance_m = std::max(kSameLength_m, kSameLengthShare * finding.file_m);
      if (!std::isfinite(finding.world_m)) {
        finding.state = EpisodeState::kUnreachable;
      } else if (finding.world_m <= 0.0) {
        finding.state = EpisodeState::kTrivial;
      } else if (!(std::abs(finding.world_m - finding.file_m) <= tolerance_m)) {
        finding.state = EpisodeState::kWrongLength;
      }
    }
    episode.shortest_path_m = finding.world_m;
    findings.push_back(finding);
  }
  return findings;
}

}  // namespace segsim::experiments::episodes
