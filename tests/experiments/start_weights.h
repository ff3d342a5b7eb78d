#pragma once

// Weights to start from, in a second.

#include <filesystem>
#include <string>

#include "perception/data/dataset.h"
#include "perception/data/image_file.h"
#include "perception/training/training.h"

namespace segsim::experiments {

/// Writes `folder`/start.weights: the small network, for chairs and couches, which learnt for
/// one step from a picture of a place far away.
inline void write_start_weights(const std::filesystem::path& folder) {
  perception::CocoDataset dataset;
  dataset.class_names = {"chair", "couch"};
  perception::LabeledImage image{1, "far.png", 32, 32, {}};
  perception::LabeledBox box;
  box.box = {4, 4, 20, 20};
  box.area_px2 = 256;
  image.boxes = {box};
  dataset.images = {image};
  dataset.scenes = std::vector<perception::ImagedScene>{{"far", std::string(64, 'f')}};
  perception::write_image(folder / image.file, core::Image<core::Rgb8>(32, 32, {90, 80, 70}));
  perception::write_coco(folder / "far.json", dataset);
  perception::TrainOptions options;
  options.train_json = folder / "far.json";
  options.output = folder / "start.weights";
  options.width = 0.25;
  options.input_px = 64;
  options.steps = 1;
  options.batch = 2;
  options.threads = 1;
  options.show_progress = false;
  (void)perception::train(options);
}

}  // namespace segsim::experiments
