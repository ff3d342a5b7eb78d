#include "experiments/scenes/scene_surfels.h"

#include "renderer/files/panoptic_field_file.h"

namespace segsim::experiments::scenes {

std::string write_label_files(const std::filesystem::path& folder,
                              const std::optional<renderer::PanopticModel>& model,
                              const std::shared_ptr<const renderer::PanopticField>& field) {
  if (model) renderer::write_panoptic_model(folder / renderer::kPanopticFileName, *model);
  if (field == nullptr) return "";
  renderer::write_panoptic_field(folder / renderer::kPanopticFieldFileName, *field);
  return renderer::kPanopticFieldFileName;
}

}  // namespace segsim::experiments::scenes
