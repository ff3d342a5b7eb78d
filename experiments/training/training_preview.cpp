#include "experiments/training/training_preview.h"

#include <algorithm>
#include <utility>

#include "experiments/drawing/frame_picture.h"
#include "perception/data/image_file.h"
#include "renderer/cpu_renderer.h"

namespace segsim::experiments::training {

void write_preview(const std::filesystem::path& file, const reconstruction::TrainingSet& set,
                   std::shared_ptr<const renderer::SurfelCloud> surfels,
                   std::shared_ptr<const renderer::PanopticField> field, int threads) {
  const auto& views = set.held_out.empty() ? set.training : set.held_out;
  const reconstruction::TrainingView& view = views[views.size() / 2];
  renderer::RenderOptions options;
  options.threads = threads;
  const auto renderer =
      renderer::make_cpu_renderer(std::move(surfels), options, std::move(field));
  const core::Frame frame =
      renderer->render(view.T_world_camera, set.intrinsics, core::Channels::kAll);
  const core::Image<core::Rgb8> labels = drawing::panoptic_picture(frame);
  const int width = set.intrinsics.width_px, height = set.intrinsics.height_px;
  core::Image<core::Rgb8> picture(3 * width, height);
  for (int y = 0; y < height; ++y) {
    std::copy_n(frame.rgb.row(y), width, picture.row(y));
    std::copy_n(view.rgb.row(y), width, picture.row(y) + width);
    if (!labels.empty()) std::copy_n(labels.row(y), width, picture.row(y) + 2 * width);
  }
  perception::write_image(file, picture);
}

}  // namespace segsim::experiments::training
