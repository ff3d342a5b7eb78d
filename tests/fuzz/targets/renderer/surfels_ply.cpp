// surfels.ply of a bundle (renderer/files/ply_io.h).
#include "renderer/files/ply_io.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  (void)renderer::read_surfels_ply(in_file(bytes, "surfels.ply"));
}

std::vector<std::string> seeds() {
  renderer::SurfelCloud plain = renderer::testing::random_scene(1, 3);
  renderer::SurfelCloud labelled = plain;
  labelled.semantic_id.assign(3, 1);
  labelled.instance_id.assign(3, 2);
  renderer::testing::add_random_features(labelled, 2);
  std::vector<std::string> all;
  for (const renderer::SurfelCloud& cloud : {plain, labelled}) {
    all.push_back(written([&](const auto& file) { write_surfels_ply(file, cloud); }));
  }
  all.emplace_back(
      "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 1\nproperty float x\n"
      "property float y\nproperty float z\nproperty float f_dc_0\nproperty float f_dc_1\n"
      "property float f_dc_2\nproperty float opacity\nproperty float scale_0\n"
      "property float scale_1\nproperty float rot_0\nproperty float rot_1\n"
      "property float rot_2\nproperty float rot_3\nend_header\n0 0 1 0 0 0 2 -3 -3 1 0 0 0\n");
  return all;
}

}  // namespace segsim::fuzz
