#include "perception/data/yolo_labels.h"

#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

CocoDataset some_dataset() {
  CocoDataset dataset;
  dataset.class_names = {"chair", "potted \"plant\""};
  LabeledImage image{1, "images/a/one.png", 200, 100, {}};
  LabeledBox box;
  box.class_index = 1;
  box.box = {20, 10, 60, 60};
  image.boxes.push_back(box);
  box.box = {190, 90, 202, 101};  // COCO lets boxes leave the image by rounding.
  box.class_index = 0;
  image.boxes.push_back(box);
  box.ignore = true;
  image.boxes.push_back(box);
  dataset.images = {image, {2, "images/two.jpg", 200, 100, {}}};
  return dataset;
}

TEST(YoloLabels, LinesAreSharesOfTheImage) {
  const tests::TemporaryFolder folder;
  EXPECT_EQ(write_yolo_labels(folder / "", some_dataset()), 1);
  EXPECT_EQ(core::read_file(folder / "labels/a/one.txt"),
            "1 0.200000 0.350000 0.200000 0.500000\n"
            "0 0.975000 0.950000 0.050000 0.100000\n");
  EXPECT_EQ(core::read_file(folder / "labels/two.txt"), "");  // Background, not forgotten.
}

TEST(YoloLabels, SplitsListImagesAndNameClasses) {
  const tests::TemporaryFolder folder;
  CocoDataset train = some_dataset(), val = some_dataset();
  train.images.resize(1);
  val.images.erase(val.images.begin());
  write_yolo_splits(folder / "", {{"train", train}, {"val", val}});
  EXPECT_EQ(core::read_file(folder / "train.txt"), "./images/a/one.png\n");
  EXPECT_EQ(core::read_file(folder / "val.txt"), "./images/two.jpg\n");
  EXPECT_EQ(core::read_file(folder / "data.yaml"),
            "train: train.txt\nval: val.txt\nnames:\n  0: \"chair\"\n"
            "  1: \"potted \\\"plant\\\"\"\n");
}

TEST(YoloLabels, TrainersFindAValidationList) {
  const tests::TemporaryFolder folder;
  const CocoDataset all = some_dataset();
  write_yolo_splits(folder / "", {{"train", all}, {"val_scenes", all}, {"val_views", all}});
  EXPECT_TRUE(core::read_file(folder / "data.yaml")
                  .starts_with("train: train.txt\nval_scenes: val_scenes.txt\n"
                               "val_views: val_views.txt\nval: val_views.txt\nnames:\n"));
  write_yolo_splits(folder / "", {{"train", all}, {"val_scenes", all}});
  EXPECT_TRUE(core::read_file(folder / "data.yaml")
                  .starts_with("train: train.txt\nval_scenes: val_scenes.txt\n"
                               "val: val_scenes.txt\nnames:\n"));
}

TEST(YoloLabels, ImagesElsewhereAreRefused) {
  const tests::TemporaryFolder folder;
  CocoDataset dataset = some_dataset();
  dataset.images[1].file = "rgb/two.jpg";
  EXPECT_THROW(write_yolo_labels(folder / "", dataset), core::InputError);
}

}  // namespace
}  // namespace segsim::perception
