#include "experiments/detection/view_split.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>

#include "core/error.h"
#include "core/random.h"

namespace segsim::experiments::detection {
namespace {

using perception::CocoDataset;
using perception::LabeledImage;

enum class Part : unsigned char { kTrain, kValViews, kValScenes, kDropped };

void check_images(const CocoDataset& dataset, const ViewSplitOptions& options) {
  for (const LabeledImage& image : dataset.images) {
    if (image.scene.empty() || !image.view) {
      throw core::InputError::expected(image.file, "an image with scene and view", "neither");
    }
  }
  for (const std::string& scene : options.val_scenes) {
    const bool known =
        std::any_of(dataset.images.begin(), dataset.images.end(),
                    [&](const LabeledImage& image) { return image.scene == scene; });
    if (!known) {
      throw core::InputError::expected("validation scene " + scene, "views of it", "none");
    }
  }
}

/// The first `count` of a random order (Fisher and Yates).
std::vector<std::size_t> draw(std::vector<std::size_t> from, std::size_t count,
                              core::RandomStream& random) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t j = i + random.index(static_cast<std::uint32_t>(from.size() - i));
    std::swap(from[i], from[j]);
  }
  from.resize(count);
  return from;
}

/// Those of the data set that one of the images names.
std::optional<std::vector<perception::ImagedScene>> scenes_of(
    const CocoDataset& dataset, const std::vector<LabeledImage>& images) {
  if (!dataset.scenes) return std::nullopt;
  std::vector<perception::ImagedScene> shown;
  std::copy_if(dataset.scenes->begin(), dataset.scenes->end(), std::back_inserter(shown),
               [&](const perception::ImagedScene& scene) {
                 return std::any_of(
                     images.begin(), images.end(),
                     [&](const LabeledImage& image) { return image.scene == scene.name; });
               });
  return shown;
}

CocoDataset part_of(const CocoDataset& dataset, const std::vector<Part>& parts, Part wanted) {
  CocoDataset part;
  part.folder = dataset.folder;
  part.class_names = dataset.class_names;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (parts[i] == wanted) part.images.push_back(dataset.images[i]);
  }
  part.scenes = scenes_of(dataset, part.images);
  return part;
}

}  // namespace

ViewSplit split_views(const CocoDataset& dataset, const ViewSplitOptions& options) {
  check_images(dataset, options);
  std::vector<Part> parts(dataset.images.size(), Part::kTrain);
  std::map<std::string, std::vector<std::size_t>> by_scene;
  for (std::size_t i = 0; i < dataset.images.size(); ++i) {
    const std::string& scene = dataset.images[i].scene;
    const auto& held_out = options.val_scenes;
    if (std::find(held_out.begin(), held_out.end(), scene) != held_out.end()) {
      parts[i] = Part::kValScenes;
    } else {
      by_scene[scene].push_back(i);
    }
  }
  for (const auto& [scene, indices] : by_scene) {
    core::RandomStream random(options.seed, "view split " + scene);
    const auto count = static_cast<std::size_t>(
        std::lround(options.val_share * static_cast<double>(indices.size())));
    for (const std::size_t i : draw(indices, std::min(count, indices.size()), random)) {
      parts[i] = Part::kValViews;
    }
    for (const std::size_t i : indices) {
      if (parts[i] != Part::kTrain) continue;
      const bool too_like = std::any_of(indices.begin(), indices.end(), [&](std::size_t j) {
        return parts[j] == Part::kValViews &&
               options.apart.alike(*dataset.images[i].view, *dataset.images[j].view);
      });
      if (too_like) parts[i] = Part::kDropped;
    }
  }
  if (std::find(parts.begin(), parts.end(), Part::kTrain) == parts.end()) {
    throw core::InputError::expected("split", "views to train on", "none");
  }
  return {part_of(dataset, parts, Part::kTrain), part_of(dataset, parts, Part::kValViews),
          part_of(dataset, parts, Part::kValScenes),
          static_cast<int>(std::count(parts.begin(), parts.end(), Part::kDropped))};
}

}  // namespace segsim::experiments::detection
