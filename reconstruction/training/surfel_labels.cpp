#include "reconstruction/training/surfel_labels.h"

#include <algorithm>
#include <array>
#include <map>
#include <string>

#include "core/check.h"
#include "reconstruction/lifting/lifting.h"
#include "renderer/raster/label_resolve.h"

namespace segsim::reconstruction {

void label_surfels(const renderer::PanopticField& field, renderer::SurfelCloud& surfels) {
  SEGSIM_CHECK(field.size() == surfels.size(), "a field of " + std::to_string(field.size()) +
                                                   " surfels for " +
                                                   std::to_string(surfels.size()));
  surfels.semantic_id.assign(surfels.size(), 0);
  surfels.instance_id.assign(surfels.size(), 0);
  renderer::internal::ResolveScratch scratch;
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    const std::array<renderer::internal::WeightedSurfel, 1> itself{
        {{1.0F, static_cast<std::uint32_t>(i)}}};
    const renderer::internal::PixelLabel label =
        renderer::internal::resolve_panoptic(field, itself, scratch);
    surfels.semantic_id[i] = label.semantic;
    surfels.instance_id[i] = label.instance;
  }
}

std::vector<core::SceneInstance> instances_of(const renderer::SurfelCloud& surfels,
                                              const std::vector<core::SceneClass>& classes) {
  std::map<std::uint16_t, std::map<std::uint16_t, std::size_t>> votes;  // Instance, class.
  for (std::size_t i = 0; i < surfels.instance_id.size(); ++i) {
    if (surfels.instance_id[i] != 0) ++votes[surfels.instance_id[i]][surfels.semantic_id[i]];
  }
  std::vector<core::SceneInstance> instances;
  for (const auto& [id, by_class] : votes) {
    const auto most =
        std::max_element(by_class.begin(), by_class.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    const auto found =
        std::find_if(classes.begin(), classes.end(),
                     [&](const core::SceneClass& c) { return c.id == most->first; });
    if (found == classes.end() || !found->thing) continue;
    core::SceneInstance instance;
    instance.id = id;
    instance.class_id = found->id;
    instance.name = found->name + " " + std::to_string(id);
    instances.push_back(std::move(instance));
  }
  return instance_boxes(surfels, instances);
}

}  // namespace segsim::reconstruction
