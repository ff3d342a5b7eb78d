#include "perception/data/class_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "core/error.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

ClassMap shipped(const std::string& name) {
  return read_class_map(std::filesystem::path(SEGSIM_CLASS_MAPS) / name);
}

TEST(ClassMap, NamesAreNormalised) {
  EXPECT_EQ(normalised_name("  Sofa_Chair  "), "sofa chair");
  EXPECT_EQ(normalised_name("L-shaped__sofa"), "l shaped sofa");
  EXPECT_EQ(normalised_name(""), "");
}

TEST(ClassMap, ShippedMapsReadAndMapTheGoals) {
  const ClassMap hm3d = shipped("coco_from_hm3d.yaml");
  EXPECT_EQ(hm3d.find("sofa"), "couch");
  EXPECT_EQ(hm3d.find("tv_monitor"), "tv");
  EXPECT_EQ(hm3d.find("Plant"), "potted plant");
  EXPECT_EQ(hm3d.find("chair"), "chair");  // Its own name.
  EXPECT_EQ(hm3d.find("wall"), "");        // Left out on purpose.
  EXPECT_EQ(hm3d.find("red chair"), std::nullopt);
  EXPECT_EQ(shipped("coco_from_scannet.yaml").find("office chair"), "chair");
  EXPECT_EQ(shipped("coco_from_scannet.yaml").find("refridgerator"), "refrigerator");
  EXPECT_EQ(shipped("hm3d_from_coco.yaml").find("couch"), "sofa");
  EXPECT_EQ(shipped("hm3d_from_coco.yaml").find("trash bin"), "");
}

TEST(ClassMap, FreeTextCountsByItsEnd) {
  const ClassMap text = shipped("coco_from_text.yaml");
  EXPECT_EQ(text.find("a red office chair"), "chair");
  EXPECT_EQ(text.find("two armchairs"), "chair");
  EXPECT_EQ(text.find("Large Potted Palm"), "potted plant");
  EXPECT_EQ(text.find("football table"), "foosball table");  // Longer than any "table".
  EXPECT_EQ(text.find("chair leg"), std::nullopt);
  EXPECT_EQ(text.find("wheelchair"), std::nullopt);  // Ends inside a word.
  EXPECT_EQ(text.find("the kitchen wall"), "");
}

void expect_error(const std::string& text, const std::string& expected) {
  const tests::TemporaryFolder folder;
  std::ofstream(folder / "map.yaml") << text;
  EXPECT_THAT([&] { (void)read_class_map(folder / "map.yaml"); },
              ThrowsMessage<core::InputError>(HasSubstr(expected)));
}

TEST(ClassMap, FaultsAreNamedWithTheirLine) {
  const std::string head = "schema: segsim.class_map\nversion: 1\n";
  expect_error("schema: other\nversion: 1\nclasses: {a: [b]}\n", "segsim.class_map");
  expect_error("schema: segsim.class_map\nversion: 2\nclasses: {a: [b]}\n", "map.yaml:2");
  expect_error(head, "classes");
  expect_error(head + "classes: {}\n", "class names");
  expect_error(head + "classes:\n  a: [x]\n  b: [x]\n", "map.yaml:5");
  expect_error(head + "classes:\n  a: [x]\nleave_out: [X]\n", "a name with one target");
  expect_error(head + "classes:\n  a: [x]\nclases: 1\n", "clases");
}

}  // namespace
}  // namespace segsim::perception
