// Wavefront OBJ with its materials (worlds/mesh/mesh_import.h).
#include "tests/fuzz/targets/worlds/mesh_file.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const std::vector<std::string> parts = split_parts(bytes, 2);
  (void)in_file(parts[1], "input.mtl");
  parse_mesh(parts[0], "input.obj");
}

std::vector<std::string> seeds() {
  const std::string materials =
      "newmtl red\nKd 0.8 0.1 0.1\nKa 0 0 0\nd 0.5\nmap_Kd wood.png\n";
  return {
      join_parts({"mtllib input.mtl\no Chair_1\nusemtl red\nv 0 0 0\nv 1 0 0\nv 1 1 0\n"
                  "v 0 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 4/1/1\nf -4 -3 -2\n",
                  materials})};
}

}  // namespace segsim::fuzz
