// PLY meshes of others (worlds/mesh/mesh_import.h).
#include "tests/fuzz/targets/worlds/mesh_file.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) { parse_mesh(bytes, "input.ply"); }

std::vector<std::string> seeds() {
  using namespace std::string_literals;
  const std::string properties =
      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
  return {"ply\nformat ascii 1.0\n" + properties + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
          "ply\nformat binary_little_endian 1.0\n" + properties +
              "\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x80\x3f\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x80\x3f"
              "\0\0\0\0\x03\0\0\0\0\x01\0\0\0\x02\0\0\0"s};
}

}  // namespace segsim::fuzz
