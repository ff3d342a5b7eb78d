// Paths drawn in a map program (experiments/scripted_trials/geo_path.h).
#include "experiments/scripted_trials/geo_path.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  (void)experiments::scripted_trials::read_geojson_path(in_file(bytes, "path.geojson"));
}

std::vector<std::string> seeds() {
  return {project_file("experiments/trials/paths/living-room.geojson"),
          R"({"type":"FeatureCollection","features":[
{"type":"Feature","geometry":{"type":"Point","coordinates":[8.9,49.9]}},
{"type":"Feature","geometry":{"type":"Point","coordinates":[8.91,49.9,3]}}]})"};
}

}  // namespace segsim::fuzz
