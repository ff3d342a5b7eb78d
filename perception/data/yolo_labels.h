#pragma once

/// @file
/// Labels in the text layout that YOLO trainers read (Ultralytics' documentation, "Object
/// Detection Datasets"): one file an image, one line a box:
///
///     <class index> <centre x> <centre y> <width> <height>        as shares of the image's
///     size
///
///     FOLDER/images/00001.png    FOLDER/labels/00001.txt    FOLDER/data.yaml

#include <filesystem>
#include <map>
#include <string>

#include "perception/data/dataset.h"

namespace segsim::perception {

/// Writes `folder`/labels/NAME.txt for every image (an empty file if it has no box). The
/// layout knows no ignored regions: ignored boxes and crowds are left out, so a trainer of
/// that family takes them for background; use the COCO file where that matters.
/// @param dataset  Image files below "images/".
/// @return  How many boxes were left out.
int write_yolo_labels(const std::filesystem::path& folder, const CocoDataset& dataset);

/// Writes `folder/<split>.txt`, a list of image files, for each split, and data.yaml that
/// names the lists and the classes. Trainers want a `val`: without a split of that name it is
/// the list of "val_views", else of "val_scenes".
void write_yolo_splits(const std::filesystem::path& folder,
                       const std::map<std::string, CocoDataset>& splits);

}  // namespace segsim::perception
