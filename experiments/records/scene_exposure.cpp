#include "experiments/records/scene_exposure.h"

#include <algorithm>

#include "perception/checkpoint/lineage.h"
#include "perception/models/object_detector.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::experiments {
namespace {

using perception::DataPurpose;
using perception::DataUse;
using perception::ImagedScene;

constexpr const char* kNone = "none";
constexpr const char* kUnknown = "unknown";
constexpr const char* kPartlyUnknown = "partly unknown";
constexpr const char* kTrainedOn = "trained on ";
constexpr const char* kThresholdOn = "threshold chosen on ";
constexpr const char* kSameName = "another scene named ";

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

TrainingDataKnown how_much_is_known(const std::vector<DataUse>& data) {
  const auto is_known = [](const DataUse& use) { return use.scenes.has_value(); };
  if (std::all_of(data.begin(), data.end(), is_known)) return TrainingDataKnown::kAll;
  const bool knows_training = std::any_of(data.begin(), data.end(), [&](const DataUse& use) {
    return is_known(use) && use.purpose != DataPurpose::kValidation;
  });
  return knows_training ? TrainingDataKnown::kPart : TrainingDataKnown::kNothing;
}

std::string joined(const std::vector<std::string>& parts, const char* between) {
  std::string text;
  for (const std::string& part : parts) text += (text.empty() ? "" : between) + part;
  return text;
}

std::vector<std::string> split(const std::string& text, const std::string& between) {
  std::vector<std::string> parts;
  for (std::size_t start = 0; start <= text.size();) {
    const std::size_t end = std::min(text.find(between, start), text.size());
    parts.push_back(text.substr(start, end - start));
    start = end + between.size();
  }
  return parts;
}

}  // namespace

bool SceneExposure::is_trained_on(const std::string& scene) const {
  return std::find(trained_on.begin(), trained_on.end(), scene) != trained_on.end();
}

SceneExposure exposure_of(const std::filesystem::path& weights,
                          std::span<const EvaluationScene> scenes) {
  const std::vector<DataUse> data = data_of_file(weights);
  SceneExposure exposure;
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

std::string exposure_text(const SceneExposure& exposure) {
  std::vector<std::string> parts;
  if (exposure.known != TrainingDataKnown::kAll) {
    parts.emplace_back(exposure.known == TrainingDataKnown::kPart ? kPartlyUnknown : kUnknown);
  }
  const auto add = [&](const char* what, const std::vector<std::string>& scenes) {
    if (!scenes.empty()) parts.push_back(what + joined(scenes, ", "));
  };
  add(kTrainedOn, exposure.trained_on);
  add(kThresholdOn, exposure.threshold_on);
  add(kSameName, exposure.same_name);
  return parts.empty() ? kNone : joined(parts, "; ");
}

SceneExposure parse_exposure(const std::string& text) {
  SceneExposure exposure;
  for (const std::string& part : split(text, "; ")) {
    const auto read = [&](const std::string& what, std::vector<std::string>& scenes) {
      if (part.starts_with(what)) scenes = split(part.substr(what.size()), ", ");
      return part.starts_with(what);
    };
    if (part == kNone || read(kTrainedOn, exposure.trained_on) ||
        read(kThresholdOn, exposure.threshold_on) || read(kSameName, exposure.same_name)) {
      continue;
    }
    exposure.known =
        part == kPartlyUnknown ? TrainingDataKnown::kPart : TrainingDataKnown::kNothing;
  }
  return exposure;
}

}  // namespace segsim::experiments
