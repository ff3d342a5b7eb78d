// Point clouds of laser scanners, PCD and PLY (reconstruction/datasets/point_cloud_file.h).
#include "reconstruction/datasets/point_cloud_file.h"

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const char* name = bytes.starts_with("ply") ? "cloud.ply" : "cloud.pcd";
  (void)reconstruction::read_point_cloud(in_file(bytes, name));
}

std::vector<std::string> seeds() {
  using namespace std::string_literals;
  const std::string fields =
      "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\n"
      "COUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\n";
  return {fields + "DATA ascii\n1 2 3 16711680\nnan nan nan 0\n",
          fields + "DATA binary\n" + std::string(32, '\0'),
          "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
          "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
          "end_header\n1 2 3 255 0 0\n2 2 3 0 0 9\n"};
}

}  // namespace segsim::fuzz
