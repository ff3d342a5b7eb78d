// COLLADA (worlds/mesh/mesh_import.h).
#include "tests/fuzz/targets/worlds/mesh_file.h"
#include "tests/worlds/mesh_fixtures.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) { parse_mesh(bytes, "input.dae"); }

std::vector<std::string> seeds() {
  return {worlds::collada_triangle("0.01", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")};
}

}  // namespace segsim::fuzz
