// What trials leave: the log of one (packed JSON) and the recording of one (JSON Lines); input
// that begins with 'r' is a recording (experiments/records).
#include "experiments/records/replay_log.h"
#include "experiments/records/scene_exposure.h"
#include "experiments/records/trial_log.h"
#include "experiments/support/gzip_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

using namespace experiments;

void parse(const std::string& bytes) {
  if (bytes.starts_with('r')) {
    (void)records::read_replay_log(in_file(bytes.substr(1), "trial.jsonl"));
  } else if (bytes.starts_with('e')) {
    (void)records::parse_exposure(bytes.substr(1));
  } else {
    const std::filesystem::path file = work_folder() / "trial.json.gz";
    support::write_gzip(file, bytes);
    (void)records::read_trial_log(file);
  }
}

std::vector<std::string> seeds() {
  records::TrialLog log;
  log.scene_title = "Room";
  log.arm = "before";
  log.camera = core::CameraIntrinsics::from_fov(64, 48, 1.2);
  log.episode.id = "room/couch/00";
  log.episode.class_name = "couch";
  log.episode.view_points_m = {{1.0, 2.0}};
  log.shortest_path_m = {{0.0, 0.0}, {1.0, 2.0}};
  log.track.resize(2);
  log.evidence.resize(2);
  log.distance_m = {1.0, 0.5};
  const std::string packed =
      written([&](const auto& file) { records::write_trial_log(file, log); }, "seed.json.gz");
  records::ReplayLog replay;
  replay.spec_text = "name: demo\n";
  replay.scene = "room";
  replay.class_names = {"chair"};
  replay.detections[3] = {{0, 0.5F, {1, 2, 3, 4}}};
  replay.ticks.resize(2);
  replay.sensors = {};
  return {support::read_gzip(in_file(packed, "seed.json.gz")),
          "r" + written([&](const auto& file) { records::write_replay_log(file, replay); })};
}

}  // namespace segsim::fuzz
