#include "experiments/detection/seen_data.h"

#include <algorithm>

namespace segsim::experiments::detection {
namespace {

using perception::DataPurpose;
using perception::DataUse;
using perception::ImagedScene;

bool is_training(const DataUse& use) { return use.purpose != DataPurpose::kValidation; }

/// "37 of the 160 images"; empty for none.
std::string shared_images(const DataUse& tested, const std::vector<DataUse>& data,
                          bool training) {
  const auto seen = std::count_if(
      tested.image_hashes.begin(), tested.image_hashes.end(), [&](std::uint64_t hash) {
        return std::any_of(data.begin(), data.end(), [&](const DataUse& use) {
          return is_training(use) == training && has_image(use, hash);
        });
      });
  if (seen == 0) return {};
  return std::to_string(seen) + " of the " + std::to_string(tested.images) + " images";
}

/// Those of the test that were trained on.
std::string shared_scenes(const DataUse& tested, const std::vector<DataUse>& data) {
  std::string names;
  for (const ImagedScene& scene : tested.scenes.value_or(std::vector<ImagedScene>{})) {
    const bool seen = std::any_of(data.begin(), data.end(), [&](const DataUse& use) {
      return is_training(use) && use.scenes &&
             std::any_of(
                 use.scenes->begin(), use.scenes->end(),
                 [&](const ImagedScene& other) { return is_same_place(scene, other); });
    });
    if (seen) names += (names.empty() ? "" : ", ") + scene_text(scene);
  }
  return names;
}

/// The data sets of which nobody knows where their images were taken.
std::string unknown_sets(const std::vector<DataUse>& data) {
  std::string names;
  for (const DataUse& use : data) {
    if (use.scenes) continue;
    names += (names.empty() ? "" : ", ") + (use.purpose == DataPurpose::kForeign
                                                ? use.file
                                                : "labels " + use.labels_sha256.substr(0, 12));
  }
  return names;
}

}  // namespace

SeenData seen_data(const std::filesystem::path& weights, const DataUse& tested) {
  const std::vector<DataUse> data =
      perception::data_of(perception::read_weights(weights), weights);
  const std::string name = weights.filename().string();
  SeenData seen;
  if (const std::string images = shared_images(tested, data, true); !images.empty()) {
    seen.warnings.push_back(name + " was trained on " + images);
  }
  if (const std::string scenes = shared_scenes(tested, data); !scenes.empty()) {
    seen.warnings.push_back(name +
                            " was trained on views of scenes that the images show: " + scenes);
  }
  if (const std::string images = shared_images(tested, data, false); !images.empty()) {
    seen.warnings.push_back("the score threshold of " + name + " was chosen on " + images);
  }
  if (const std::string sets = unknown_sets(data); !sets.empty()) {
    seen.unknown.push_back("not known: of which scenes all images are that " + name +
                           " was trained on (" + sets + ")");
  }
  if (!tested.scenes) {
    seen.unknown.push_back("not known: which scenes the images show, so whether " + name +
                           " was trained on other views of them");
  }
  return seen;
}

std::string scene_text(const ImagedScene& scene) {
  if (scene.generator.empty()) return scene.name;
  return scene.generator + ", seeds " + std::to_string(scene.first_seed) + " to " +
         std::to_string(scene.last_seed);
}

}  // namespace segsim::experiments::detection
