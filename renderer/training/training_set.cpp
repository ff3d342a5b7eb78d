#include "renderer/training/training_set.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>

namespace segsim::renderer {
namespace {

constexpr double kExtentMargin = 1.1, kSmallestExtent_m = 0.5;

}  // namespace

core::FrameMasks exact_masks(const RgbdFrame& frame) {
  core::FrameMasks masks;
  masks.semantic = frame.semantic;
  masks.instance = frame.instance;
  masks.confidence =
      core::Image<std::uint8_t>(frame.semantic.width_px(), frame.semantic.height_px());
  for (std::size_t i = 0; i < masks.semantic.size(); ++i) {
    masks.confidence.data()[i] = masks.semantic.data()[i] == 0 ? 0 : 255;
  }
  masks.segments = core::segments_of(masks);
  return masks;
}

double TrainingSet::extent_m() const {
  glm::dvec3 centre(0.0);
  for (const TrainingView& view : training) centre += view.T_world_camera.translation_m();
  centre /= static_cast<double>(std::max<std::size_t>(training.size(), 1));
  double radius = 0.0;
  for (const TrainingView& view : training) {
    radius = std::max(radius, glm::distance(view.T_world_camera.translation_m(), centre));
  }
  return std::max(kExtentMargin * radius, kSmallestExtent_m);
}

}  // namespace segsim::renderer
