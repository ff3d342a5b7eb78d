#include "experiments/detection/weights_exposure.h"

#include <algorithm>
#include <vector>

#include "perception/checkpoint/lineage.h"
#include "perception/models/object_detector.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::experiments::detection {
namespace {

using perception::DataPurpose;
using perception::DataUse;
using perception::ImagedScene;

bool shows(const ImagedScene& imaged, const EvaluationScene& scene) {
  const ImagedScene bundle{scene.manifest->name, scene.manifest->surfels.sha256};
  if (is_same_place(imaged, bundle)) return true;
  return scene.flat_seed && is_same_place(imaged, {.generator = worlds::kFlatGenerator,
                                                   .first_seed = *scene.flat_seed,
                                                   .last_seed = *scene.flat_seed});
}

bool shows(const DataUse& use, const EvaluationScene& scene) {
  return use.scenes && std::any_of(use.scenes->begin(), use.scenes->end(),
                                   [&](const auto& imaged) { return shows(imaged, scene); });
}

bool names(const DataUse& use, const EvaluationScene& scene) {
  return use.scenes &&
         std::any_of(use.scenes->begin(), use.scenes->end(), [&](const auto& imaged) {
           return imaged.name == scene.name || imaged.name == scene.manifest->name;
         });
}

/// Every data set that a detector depends on.
std::vector<DataUse> data_of_file(const std::filesystem::path& file) {
  if (perception::is_foreign_detector(file)) {
    return {perception::foreign_data(file.filename().string(), {})};
  }
  return perception::data_of(perception::read_weights(file), file);
}

records::TrainingDataKnown how_much_is_known(const std::vector<DataUse>& data) {
  const auto is_known = [](const DataUse& use) { return use.scenes.has_value(); };
  if (std::all_of(data.begin(), data.end(), is_known)) return records::TrainingDataKnown::kAll;
  const bool knows_training = std::any_of(data.begin(), data.end(), [&](const DataUse& use) {
    return is_known(use) && use.purpose != DataPurpose::kValidation;
  });
  return knows_training ? records::TrainingDataKnown::kPart
                        : records::TrainingDataKnown::kNothing;
}

}  // namespace

records::SceneExposure exposure_of(const std::filesystem::path& weights,
                                   std::span<const EvaluationScene> scenes) {
  const std::vector<DataUse> data = data_of_file(weights);
  records::SceneExposure exposure;
  for (const EvaluationScene& scene : scenes) {
    bool trained = false, chosen = false, named = false;
    for (const DataUse& use : data) {
      const bool shown = shows(use, scene);
      (use.purpose == DataPurpose::kValidation ? chosen : trained) |= shown;
      named |= !shown && names(use, scene);
    }
    if (trained) exposure.trained_on.push_back(scene.name);
    if (chosen) exposure.threshold_on.push_back(scene.name);
    if (named && !trained) exposure.same_name.push_back(scene.name);
  }
  exposure.known = how_much_is_known(data);
  return exposure;
}

}  // namespace segsim::experiments::detection
