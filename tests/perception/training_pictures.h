#pragma once

/// @file
/// Pictures of coloured rectangles as a data set, for tests of training.

#include "core/random.h"
#include "perception/data/dataset.h"
#include "perception/data/image_file.h"
#include "perception/training/training.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {

inline void paint(core::Image<core::Rgb8>& image, const core::BoxPx& box, core::Rgb8 colour) {
  for (int y = static_cast<int>(box.y0); y < static_cast<int>(box.y1); ++y) {
    for (int x = static_cast<int>(box.x0); x < static_cast<int>(box.x1); ++x) {
      image(x, y) = colour;
    }
  }
}

/// Three pictures of red and blue rectangles ("warm", "cold") on a noisy grey.
inline std::filesystem::path write_rectangles(const tests::TemporaryFolder& folder) {
  const core::BoxPx boxes[3][2] = {{{10, 12, 50, 40}, {70, 50, 110, 90}},
                                   {{60, 8, 118, 44}, {16, 54, 44, 88}},
                                   {{30, 30, 90, 70}, {4, 4, 24, 28}}};
  CocoDataset dataset;
  dataset.class_names = {"cold", "warm"};
  core::RandomStream random(1, "noise");
  for (int i = 0; i < 3; ++i) {
    core::Image<core::Rgb8> image(128, 96);
    for (core::Rgb8& pixel : image.pixels()) {
      const auto grey = static_cast<std::uint8_t>(100 + random.index(40));
      pixel = {grey, grey, grey};
    }
    LabeledImage entry{i, "image" + std::to_string(i) + ".png", 128, 96, {}};
    for (int c = 0; c < 2; ++c) {
      paint(image, boxes[i][c], c == 1 ? core::Rgb8{210, 40, 30} : core::Rgb8{30, 50, 200});
      LabeledBox label;
      label.class_index = c;
      label.box = boxes[i][c];
      label.area_px2 = label.box.area_px2();
      entry.boxes.push_back(label);
    }
    write_image(folder / entry.file, image);
    dataset.images.push_back(entry);
  }
  write_coco(folder / "train.json", dataset);
  return folder / "train.json";
}

}  // namespace segsim::perception
