// Episodes as JSON Lines (experiments/episodes/episodes.h).
#include "experiments/episodes/episodes.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

using namespace experiments;

void parse(const std::string& bytes) {
  (void)episodes::read_episodes(in_file(bytes, "episodes.jsonl"));
}

std::vector<std::string> seeds() {
  episodes::EpisodeSet set;
  set.scene = "room";
  set.robot = "jackal";
  set.generator = "test";
  set.viewer =
      episodes::EpisodeViewer{core::CameraIntrinsics::from_fov(64, 48, 1.2), 1.2, 0.1};
  set.oracle = episodes::OracleRecord{3, 4, 0.7, "segsim-object"};
  sim::Episode episode;
  episode.id = "room/couch/00";
  episode.class_name = "couch";
  episode.start = {1.0, 2.0, 0.5};
  episode.view_points_m = {{3.0, 1.0}, {3.5, 1.0}};
  episode.view_point_instance = {4, 4};
  episode.view_point_iou = {0.5F, 0.25F};
  episode.shortest_path_m = 2.5;
  episode.seed = 7;
  set.episodes = {episode};
  episode.id = "room/couch/01";
  episode.phrase = "a red couch";
  episode.goal_instances = {4};
  episodes::EpisodeSet phrases = set;
  phrases.episodes.push_back(episode);
  std::vector<std::string> all;
  for (const episodes::EpisodeSet& each : {set, phrases}) {
    all.push_back(written([&](const auto& file) { episodes::write_episodes(file, each); }));
  }
  return all;
}

}  // namespace segsim::fuzz
