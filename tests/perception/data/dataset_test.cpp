#include "perception/data/dataset.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "core/error.h"
#include "perception/data/image_file.h"
#include "perception/detector/evaluate.h"
#include "tests/error_message.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using testing::HasSubstr;

CocoDataset some_dataset() {
  CocoDataset dataset;
  dataset.class_names = {"chair", "couch"};
  LabeledImage first{7, "rgb/a.png", 64, 48, {}};
  LabeledBox box;
  box.class_index = 1;
  box.box = {1, 2, 11.5F, 20};
  box.area_px2 = 123;
  box.visible_fraction = 0.25;
  box.ignore = true;
  box.truncated = true;
  box.occluded = true;
  box.distance_m = 2.5;
  box.instance_id = 17;
  first.scene = "flat-3";
  first.view = {1.5, -2.0, 0.25};
  first.boxes = {box};
  box = {};
  box.box = {0, 0, 64, 48};
  box.area_px2 = 64 * 48;
  box.crowd = true;
  first.boxes.push_back(box);
  dataset.images = {first, {8, "rgb/b.png", 64, 48, {}}};
  return dataset;
}

TEST(Coco, PlacesOfTheImagesAreKept) {
  const tests::TemporaryFolder folder;
  CocoDataset dataset = some_dataset();
  write_coco(folder / "d.json", dataset);
  EXPECT_FALSE(read_coco(folder / "d.json").scenes.has_value());
  dataset.scenes =
      std::vector<ImagedScene>{{"flat-3", std::string(64, 'c')},
                               {.generator = "rooms/1", .first_seed = 4, .last_seed = 9}};
  write_coco(folder / "d.json", dataset);
  EXPECT_EQ(read_coco(folder / "d.json").scenes, dataset.scenes);

  dataset.scenes->front().surfels_sha256 = "C" + std::string(63, 'c');
  write_coco(folder / "d.json", dataset);
  EXPECT_THAT(tests::input_error_of([&] { (void)read_coco(folder / "d.json"); }),
              HasSubstr("segsim_scenes[0].surfels_sha256: expected a SHA-256"));
}

TEST(Coco, RoundTripKeepsEverything) {
  const tests::TemporaryFolder folder;
  const CocoDataset written = some_dataset();
  write_coco(folder / "d.json", written);
  const CocoDataset read = read_coco(folder / "d.json");
  EXPECT_EQ(read.class_names, written.class_names);
  EXPECT_EQ(read.sha256.size(), 64U);
  EXPECT_EQ(read.image_file(read.images[0]), folder / "rgb/a.png");
  ASSERT_EQ(read.images.size(), 2U);
  EXPECT_EQ(read.images[0].id, 7);
  EXPECT_EQ(read.images[1].file, "rgb/b.png");
  ASSERT_EQ(read.images[0].boxes.size(), 2U);
  const LabeledBox& a = read.images[0].boxes[0];
  EXPECT_EQ(a.class_index, 1);
  EXPECT_EQ(a.box.x1, 11.5F);
  EXPECT_EQ(a.box.y1, 20.0F);
  EXPECT_EQ(a.area_px2, 123);
  EXPECT_EQ(a.visible_fraction, 0.25);
  EXPECT_TRUE(a.ignore);
  EXPECT_FALSE(a.crowd);
  EXPECT_TRUE(a.truncated);
  EXPECT_TRUE(a.occluded);
  EXPECT_EQ(a.distance_m, 2.5);
  EXPECT_EQ(a.instance_id, 17);
  EXPECT_EQ(read.images[0].scene, "flat-3");
  ASSERT_TRUE(read.images[0].view.has_value());
  EXPECT_EQ(read.images[0].view->y_m, -2.0);
  EXPECT_EQ(read.images[0].view->yaw_rad, 0.25);
  EXPECT_FALSE(read.images[1].view.has_value());
  EXPECT_FALSE(read.images[0].boxes[1].truncated);
  EXPECT_FALSE(read.images[0].boxes[1].distance_m.has_value());
  EXPECT_TRUE(read.images[0].boxes[1].crowd);
  EXPECT_FALSE(read.images[0].boxes[1].visible_fraction.has_value());
}

TEST(Coco, CategoriesAreOrderedById) {
  const tests::TemporaryFolder folder;
  std::ofstream(folder / "d.json") << R"({"categories":[{"id":62,"name":"chair"},
    {"id":5,"name":"bed"}],"images":[{"id":0,"file_name":"a.png","width":9,"height":9}],
    "annotations":[{"id":1,"image_id":0,"category_id":62,"bbox":[1,1,3,4]}]})";
  const CocoDataset read = read_coco(folder / "d.json");
  EXPECT_EQ(read.class_names, (std::vector<std::string>{"bed", "chair"}));
  EXPECT_EQ(read.images[0].boxes[0].class_index, 1);
  EXPECT_EQ(read.images[0].boxes[0].area_px2, 12);
}

/// A valid file in which one piece of text is exchanged.
struct Flaw {
  const char *from, *to, *expected_message;
};

class MalformedCoco : public testing::TestWithParam<Flaw> {};

TEST_P(MalformedCoco, IsRefusedWithFileAndKey) {
  const tests::TemporaryFolder folder;
  std::string text = R"({"categories":[{"id":1,"name":"chair"}],
    "images":[{"id":3,"file_name":"a.png","width":20,"height":10}],
    "annotations":[{"id":1,"image_id":3,"category_id":1,"bbox":[1,1,3,4],"iscrowd":0}]})";
  const auto at = text.find(GetParam().from);
  ASSERT_NE(at, std::string::npos);
  text.replace(at, std::string(GetParam().from).size(), GetParam().to);
  std::ofstream(folder / "d.json") << text;
  try {
    (void)read_coco(folder / "d.json");
    FAIL() << "accepted";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("d.json"));
    EXPECT_THAT(error.what(), HasSubstr(GetParam().expected_message));
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Flaws, MalformedCoco,
    testing::Values(
        Flaw{"}]}", "}]", "not JSON"},
        Flaw{"\"images\"", "\"image\"", "images: expected a value"},
        Flaw{"\"width\":20", "\"width\":-1", "images[0].width"},
        Flaw{"\"width\":20", "\"width\":\"20\"", "images[0].width"},
        Flaw{"\"width\":20", "\"width\":20.5", "images[0].width"},
        Flaw{"a.png", "/a.png", "images[0].file_name: expected a path relative"},
        Flaw{"\"image_id\":3", "\"image_id\":4", "annotations[0].image_id"},
        Flaw{"\"category_id\":1", "\"category_id\":2", "annotations[0].category_id"},
        Flaw{"[1,1,3,4]", "[1,1,3]", "annotations[0].bbox"},
        Flaw{"[1,1,3,4]", "[1,1,0,4]", "annotations[0].bbox: expected a box with positive"},
        Flaw{"[1,1,3,4]", "[1,1,3,40]", "annotations[0].bbox: expected a box inside"},
        Flaw{"[1,1,3,4]", "[1,null,3,4]", "annotations[0].bbox[1]"},
        Flaw{"\"iscrowd\":0", "\"iscrowd\":2", "annotations[0].iscrowd"},
        Flaw{"\"iscrowd\":0", "\"visible_fraction\":1.5", "annotations[0].visible_fraction"},
        Flaw{"{\"id\":1,\"name\":\"chair\"}",
             "{\"id\":1,\"name\":\"chair\"},{\"id\":1,\"name\":\"bed\"}", "categories[1].id"},
        Flaw{"[{\"id\":3", "[7,{\"id\":3", "images[0]: expected an object"}));

TEST(Coco, MissingFileIsNamed) {
  EXPECT_THROW((void)read_coco("no/such/file.json"), core::InputError);
}

TEST(Coco, TooLargePicturesAreRefusedBeforeTheyAreDecoded) {
  const tests::TemporaryFolder folder;
  CocoDataset dataset;
  dataset.class_names = {"chair"};
  dataset.images = {{1, "a.png", 20000, 20000, {}}};
  write_coco(folder / "d.json", dataset);
  try {
    (void)read_coco(folder / "d.json");
    FAIL();
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(),
                HasSubstr("images[0].height: expected at most 134217728 pixels"));
  }
  // Files whose headers say 20000 x 20000: nothing follows, so nothing was decoded.
  using namespace std::string_literals;
  const std::string size = "\x00\x00\x4E\x20"s;
  const std::pair<const char*, std::string> files[] = {
      {"a.png", "\x89PNG\r\n\x1A\n\x00\x00\x00\x0DIHDR"s + size + size},
      {"a.jpg", "\xFF\xD8\xFF\xE0\x00\x04\x01\x02\xFF\xC0\x00\x11\x08"s + size.substr(2) +
                    size.substr(2) + "\x03"},
      // Fill bytes before markers, and a marker that stands alone.
      {"b.jpg", "\xFF\xD8\xFF\xFF\xFF\xE0\x00\x04\x01\x02\xFF\x01\xFF\xFF\xC2\x00\x11\x08"s +
                    size.substr(2) + size.substr(2) + "\x03"}};
  for (const auto& [name, bytes] : files) {
    std::ofstream(folder / name, std::ios::binary) << bytes;
    try {
      (void)read_image(folder / name);
      FAIL();
    } catch (const core::InputError& error) {
      EXPECT_THAT(error.what(),
                  HasSubstr("expected at most 134217728 pixels, found 20000 x 20000"));
    }
  }
}

TEST(ImageFile, OtherFormatsAreNotDecoded) {
  const tests::TemporaryFolder folder;
  using namespace std::string_literals;
  // A bitmap, a JPEG that ends before its frame, and nothing: none has a size to trust.
  for (const std::string& bytes :
       {"BM\x46\x00\x00\x00\x00\x00\x00\x00\x36\x00\x00\x00"s,
        "\xFF\xD8\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF"s, ""s}) {
    std::ofstream(folder / "a.png", std::ios::binary) << bytes;
    try {
      (void)read_image(folder / "a.png");
      FAIL();
    } catch (const core::InputError& error) {
      EXPECT_THAT(error.what(), testing::ContainsRegex(
                                    "a.png: expected a (PNG or JPEG image|complete JPEG)"));
    }
  }
}

TEST(MatchClasses, MapsByNameRenamesAndDrops) {
  CocoDataset dataset = some_dataset();
  match_classes(dataset, {"sofa", "chair"}, {{"couch", "sofa"}});
  EXPECT_EQ(dataset.images[0].boxes[0].class_index, 0);
  EXPECT_EQ(dataset.images[0].boxes[1].class_index, 1);
  dataset = some_dataset();
  match_classes(dataset, {"couch"}, {{"chair", ""}});
  ASSERT_EQ(dataset.images[0].boxes.size(), 1U);
  EXPECT_EQ(dataset.images[0].boxes[0].class_index, 0);
  dataset = some_dataset();
  EXPECT_THROW(match_classes(dataset, {"couch"}, {}), core::InputError);
}

}  // namespace
TEST(ViewsNear, ThoseOfTheSceneThatAreNearAndShowTheClassCount) {
  CocoDataset views;
  views.class_names = {"chair", "couch"};
  const auto add = [&](const std::string& scene, double x_m, double y_m,
                       const std::vector<int>& classes) {
    LabeledImage& image = views.images.emplace_back();
    image.scene = scene;
    image.view = core::Pose2{x_m, y_m, 0.0};
    for (const int index : classes) image.boxes.emplace_back().class_index = index;
  };
  add("tiny", 1.0, 2.0, {0, 1});
  add("tiny", 1.3, 2.3, {1, 1});
  add("tiny", 1.0, 2.1, {0});
  add("tiny", 1.6, 2.0, {1});
  add("other", 1.0, 2.0, {1});
  views.images.emplace_back().scene = "tiny";  // Nobody knows where.
  const auto count = [&](const std::string& showing, double radius_m) {
    return views_near(views, "tiny", {{1.0, 2.0}}, radius_m, showing);
  };
  EXPECT_EQ(count("couch", 0.5), 2);
  EXPECT_EQ(count("chair", 0.5), 2);
  EXPECT_EQ(count("tv", 0.5), 0);
  EXPECT_EQ(count("couch", 0.7), 3);
  EXPECT_EQ(count("", 0.5), 3);
}

}  // namespace segsim::perception
