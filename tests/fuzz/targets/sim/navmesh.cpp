// navmesh.bin of a bundle, and the queries that go over its polygons (sim/ground/navmesh.h).
#include "sim/ground/navmesh.h"

#include "core/random.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/sim/rooms.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const sim::Navmesh navmesh = sim::Navmesh::load(in_file(bytes, "navmesh.bin"));
  core::RandomStream random(1, "places");
  for (int i = 0; i < 4; ++i) {
    const glm::dvec3 from_m = navmesh.random_point(random);
    (void)navmesh.nearest({random.uniform(-1.0, 7.0), random.uniform(-1.0, 5.0), 0.0});
    (void)navmesh.find_path(from_m, navmesh.random_point(random));
  }
}

std::vector<std::string> seeds() {
  std::vector<std::string> all;
  for (const sim::TriangleMesh& mesh : {sim::make_room(2.0F, 2.0F), sim::make_two_rooms()}) {
    const sim::Navmesh navmesh = sim::Navmesh::build(mesh, {});
    all.push_back(written([&](const auto& file) { navmesh.save(file); }));
  }
  return all;
}

}  // namespace segsim::fuzz
