// Habitat's episodes (experiments/episodes/habitat_episodes.h). Input is the JSON, which is
// packed; input that begins as gzip is taken as it is.
#include "experiments/episodes/habitat_episodes.h"

#include "experiments/support/gzip_file.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

using namespace experiments;

void parse(const std::string& bytes) {
  std::filesystem::path file = work_folder() / "val.json.gz";
  if (bytes.starts_with('\x1f')) {
    (void)in_file(bytes, "val.json.gz");
  } else {
    support::write_gzip(file, bytes);
  }
  (void)episodes::read_habitat(file);
}

std::vector<std::string> seeds() {
  const std::string json = R"({"episodes":[{"episode_id":"7","scene_id":"a/Room.basis.glb",
"object_category":"chair","start_position":[1,0.1,2],"start_rotation":[0,0,0,1],
"info":{"geodesic_distance":4.2,"euclidean_distance":4.1}}],
"goals_by_category":{"Room.basis.glb_chair":[{"position":[0,0.5,-3],"object_id":12,
"object_name":"chair_12","view_points":[{"agent_state":{"position":[0,0,-2],
"rotation":[0,0,0,1]},"iou":0.3}]}]}})";
  const std::string goat = R"({"episodes":[{"episode_id":"0","scene_id":"a/Room.basis.glb",
"start_position":[1,0,2],"start_rotation":[0,0,0,1],"tasks":[["chair","object",null],
["chair","description","chair_12"]]}],"goals":{"Room.basis.glb_chair":[
{"position":[0,0.5,-3],"object_id":"chair_12","view_points":[{"agent_state":{
"position":[0,0,-2],"rotation":[0,0,0,1]}}]}]}})";
  return {json, goat,
          written([&](const auto& file) { support::write_gzip(file, json); }, "a.json.gz")};
}

}  // namespace segsim::fuzz
