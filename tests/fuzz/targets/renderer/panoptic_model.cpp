// panoptic.bin: decoder and queries of a trained scene (renderer/scene/panoptic_field.h).
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/repair.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const renderer::PanopticModel model =
      renderer::read_panoptic_model(in_file(with_checked_payload(bytes)));
  renderer::SurfelCloud cloud = renderer::testing::random_scene(1, 2);
  renderer::testing::add_random_features(cloud, 2);
  (void)renderer::fold_panoptic_model(cloud, model, {.threads = 1});
}

std::vector<std::string> seeds() {
  std::vector<std::string> all;
  for (const auto variant :
       {renderer::LabelVariant::kTemperature, renderer::LabelVariant::kLogSoftmax}) {
    renderer::PanopticModel model = renderer::testing::random_model(1, 3, 2);
    model.variant = variant;
    all.push_back(
        written([&](const auto& file) { renderer::write_panoptic_model(file, model); }));
  }
  return all;
}

}  // namespace segsim::fuzz
