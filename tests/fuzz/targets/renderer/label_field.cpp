// labels.bin: label distributions (renderer/files/panoptic_field_file.h).
#include "renderer/files/panoptic_field_file.h"

#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/repair.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::fuzz {
namespace {
constexpr int kSurfels = 4;
}

void parse(const std::string& bytes) {
  const renderer::PanopticField field =
      renderer::read_panoptic_field(in_file(with_checked_payload(bytes)), kSurfels);
  // Who draws it takes indices for granted.
  for (std::size_t i = 0; i < kSurfels; ++i) {
    for (const auto& entry : field.classes.row(i)) (void)field.class_id.at(entry.index);
    for (const auto& entry : field.instances.row(i)) (void)field.instance_id.at(entry.index);
  }
}

std::vector<std::string> seeds() {
  renderer::SurfelCloud cloud = renderer::testing::random_scene(1, kSurfels);
  renderer::testing::add_random_features(cloud, 2);
  renderer::PanopticModel model = renderer::testing::random_model(2, 3, 4, 0.3F);
  std::vector<std::string> all;
  for (const std::uint16_t class_id : {std::uint16_t{0}, std::uint16_t{3}}) {
    for (renderer::InstanceQuery& query : model.queries) query.class_id = class_id;
    const renderer::PanopticField field = renderer::fold_panoptic_model(cloud, model);
    all.push_back(
        written([&](const auto& file) { renderer::write_panoptic_field(file, field); }));
  }
  return all;
}

}  // namespace segsim::fuzz
