#include "experiments/records/scene_exposure.h"

#include <algorithm>

namespace segsim::experiments::records {
namespace {

constexpr const char* kNone = "none";
constexpr const char* kUnknown = "unknown";
constexpr const char* kPartlyUnknown = "partly unknown";
constexpr const char* kTrainedOn = "trained on ";
constexpr const char* kThresholdOn = "threshold chosen on ";
constexpr const char* kSameName = "another scene named ";

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

}  // namespace segsim::experiments::records
