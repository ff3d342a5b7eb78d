#include "experiments/benchmarks/label_quality.h"

#include <algorithm>
#include <memory>

#include "core/error.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::benchmarks {

LabelledViews load_labelled_views(const std::filesystem::path& recording, int count,
                                  const std::vector<core::SceneClass>& scene_classes) {
  const auto sequence = reconstruction::open_sequence(recording);
  LabelledViews truth;
  truth.name = sequence->name();
  truth.intrinsics = sequence->intrinsics();
  truth.classes = sequence->classes();
  const std::size_t frames = sequence->frame_count();
  const std::size_t taken = std::min(frames, static_cast<std::size_t>(count));
  for (std::size_t i = 0; i < taken; ++i) {
    truth.views.push_back(training::load_true_labels(*sequence, i * frames / taken));
  }
  truth.translation = training::translate_classes(scene_classes, truth.classes);
  if (truth.translation.common.empty()) {
    throw core::InputError::expected(recording.string(), "a class of the scene", "none");
  }
  return truth;
}

reconstruction::PanopticReport label_quality(core::Renderer& renderer,
                                             const LabelledViews& truth) {
  reconstruction::ContingencyTable table;
  core::Frame frame;
  for (const training::TrueLabels& view : truth.views) {
    renderer.render(view.T_world_camera, truth.intrinsics, core::Channels::kLabels, frame);
    truth.translation.apply(frame.semantic, frame.instance);
    table.add_frame(view.images(), {frame.semantic, frame.instance});
  }
  return reconstruction::panoptic_report(table, truth.classes,
                                         reconstruction::PanopticRules::strict());
}

}  // namespace segsim::experiments::benchmarks
