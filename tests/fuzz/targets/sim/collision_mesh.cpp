// collision.ply of a bundle (sim/ground/triangle_mesh.h).
#include "sim/ground/triangle_mesh.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/sim/rooms.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  (void)sim::read_mesh_ply(in_file(bytes, "collision.ply"));
}

std::vector<std::string> seeds() {
  using namespace std::string_literals;
  const std::string quad =
      "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty double x\n"
      "property double y\nproperty uchar red\nproperty double z\nelement face 1\n"
      "property list uchar uint vertex_indices\nend_header\n"s +
      std::string(std::size_t{4} * 25, '\0') + "\x04\0\0\0\0\x01\0\0\0\x02\0\0\0\x03\0\0\0"s;
  return {
      written([](const auto& file) { sim::write_mesh_ply(file, sim::make_room(1.0F, 1.0F)); }),
      quad};
}

}  // namespace segsim::fuzz
