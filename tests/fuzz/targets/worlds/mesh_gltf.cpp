// glTF, as JSON with its buffer inside (worlds/mesh/mesh_import.h).
#include "tests/fuzz/targets/worlds/mesh_file.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) { parse_mesh(bytes, "input.gltf"); }

std::vector<std::string> seeds() {
  // The positions (0, 0, 0), (1, 0, 0), (0, 1, 0) and the indices 0, 1, 2.
  return {R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"mesh":0,"name":"Chair_1"}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"buffers":[{"byteLength":42,"uri":"data:application/octet-stream;base64,)"
          "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAABAAIA"
          R"("}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},
{"buffer":0,"byteOffset":36,"byteLength":6}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",
"min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}]})"};
}

}  // namespace segsim::fuzz
