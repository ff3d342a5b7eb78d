// label_edits_*.bin: labels set by hand (renderer/files/label_edits.h).
#include "renderer/files/label_edits.h"

#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/repair.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::fuzz {
namespace {
constexpr int kSurfels = 20;
}

void parse(const std::string& bytes) {
  const renderer::LabelEdits edits =
      renderer::read_label_edits(in_file(with_checked_payload(bytes)), kSurfels);
  renderer::SurfelCloud cloud = renderer::testing::random_scene(1, kSurfels);
  cloud.semantic_id.assign(kSurfels, 3);
  cloud.instance_id.assign(kSurfels, 7);
  renderer::testing::add_random_features(cloud, 2);
  renderer::PanopticField field = renderer::fold_panoptic_model(
      cloud, renderer::testing::random_model(2, 4, 3, 0.3F), {.threads = 1});
  renderer::apply_label_edits(edits, cloud, &field);
}

std::vector<std::string> seeds() {
  const renderer::LabelEdits edits{{{0, 2, 3, 7}, {5, 1, 0, 0}, {9, 4, 6, 12}},
                                   {{7, 11}, {9, 0}}};
  return {
      written([&](const auto& file) { renderer::write_label_edits(file, edits, kSurfels); })};
}

}  // namespace segsim::fuzz
