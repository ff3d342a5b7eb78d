#pragma once

/// @file
/// Pictures of boxes: images with their labels and detections, and sheets of many of them.

#include <string>
#include <vector>

#include "core/image.h"
#include "core/stages.h"
#include "perception/data/labeled_box.h"

namespace segsim::experiments::drawing {

/// One image of a sheet.
struct SheetPicture {
  core::Image<core::Rgb8> image;
  std::string caption;
};

/// Labels in the colour of their class with its name, "T" if truncated, "O" if occluded;
/// ignored ones in thin grey. Detections are dashed, with their score.
/// @param scale  Pixels of the picture per pixel of the image.
[[nodiscard]] core::Image<core::Rgb8> draw_boxes(
    const core::Image<core::Rgb8>& image, const std::vector<perception::LabeledBox>& labels,
    const std::vector<core::Detection>& detections,
    const std::vector<std::string>& class_names, double scale = 1.5);

/// Pictures in rows, each with its caption below; pictures of other sizes are fitted into the
/// first one's. @param columns  At least 1.
[[nodiscard]] core::Image<core::Rgb8> picture_sheet(const std::vector<SheetPicture>& pictures,
                                                    int columns, const std::string& title);

}  // namespace segsim::experiments::drawing
