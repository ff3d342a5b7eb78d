#include "reconstruction/datasets/mask_files.h"

#include <functional>

#include <gmock/gmock.h>

#include "core/error.h"
#include "tests/error_message.h"
#include "tests/reconstruction/tiny_sequence.h"

namespace segsim::reconstruction {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::TemporaryFolder;
using testing::write_text;
using tests::input_error_of;

const std::vector<core::SceneClass> kClasses{{1, "floor", false}, {3, "office chair", true}};

/// 4 x 2: void, floor, chair 7 twice above; floor and chair 2 below.
core::FrameMasks example() {
  core::FrameMasks masks;
  masks.semantic = masks.instance = core::Image<std::uint16_t>(4, 2);
  masks.confidence = core::Image<std::uint8_t>(4, 2);
  masks.semantic.pixels() = {0, 1, 3, 3, 1, 1, 1, 3};
  masks.instance.pixels() = {0, 0, 700, 700, 0, 0, 0, 2};
  masks.confidence.pixels() = {0, 51, 102, 102, 51, 51, 51, 204};
  masks.segments = core::segments_of(masks);
  return masks;
}

void write_example(const fs::path& folder) {
  write_masks(folder, "frame-000003", example(), kClasses);
  MaskSetInfo info;
  info.source = "a \"test\"";
  info.classes = kClasses;
  info.prompts = {"floor", "office chair"};
  info.measured = {{"pq", 0.535}};
  write_mask_set_info(folder, info);
}

void write_ids(const fs::path& file, const std::vector<int>& ids, int width_px = 4) {
  fs::create_directories(file.parent_path());
  cv::Mat image(static_cast<int>(ids.size()) / width_px, width_px, CV_8UC1);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    image.data[i] = static_cast<std::uint8_t>(ids[i]);
  }
  cv::imwrite(file.string(), image);
}

TEST(MaskFiles, SegmentsAreFoundInTheImages) {
  const auto segments = example().segments;
  ASSERT_EQ(segments.size(), 3U);
  EXPECT_EQ(segments[0].class_id, 1);
  EXPECT_EQ(segments[0].area_px, 4);
  EXPECT_FLOAT_EQ(segments[0].score, 0.2F);
  EXPECT_EQ(segments[2].id, 700);
  EXPECT_FLOAT_EQ(segments[2].box.x0, 2.0F);
  EXPECT_FLOAT_EQ(segments[2].box.x1, 4.0F);
  EXPECT_FLOAT_EQ(segments[2].box.y1, 1.0F);
}

TEST(MaskFiles, ReadsBackWhatItWrote) {
  const TemporaryFolder folder("masks");
  write_example(folder.path());
  const auto set = open_masks(folder.path());
  EXPECT_EQ(set->layout(), MaskLayout::kSegsim);
  EXPECT_EQ(set->info().source, "a \"test\"");
  EXPECT_THAT(set->info().prompts, ::testing::ElementsAre("floor", "office chair"));
  ASSERT_EQ(set->info().measured.size(), 1U);
  EXPECT_DOUBLE_EQ(set->info().measured[0].second, 0.535);
  ASSERT_EQ(set->info().classes.size(), 2U);
  EXPECT_TRUE(set->info().classes[1].thing);
  EXPECT_THAT(set->names(), ::testing::ElementsAre("frame-000003"));
  const core::FrameMasks masks = set->read("frame-000003", 4, 2), expected = example();
  EXPECT_EQ(masks.semantic.pixels(), expected.semantic.pixels());
  EXPECT_EQ(masks.instance.pixels(), expected.instance.pixels());
  EXPECT_EQ(masks.confidence.pixels(), expected.confidence.pixels());
  ASSERT_EQ(masks.segments.size(), 3U);
  EXPECT_NEAR(masks.segments[1].score, 0.8, 1e-4);
}

TEST(MaskFiles, CrowdsComeBackAndStuffHasNone) {
  const TemporaryFolder folder("crowds");
  write_example(folder.path());
  core::FrameMasks masks = example();
  masks.segments[2].crowd = true;  // Chair 700.
  write_masks(folder.path(), "frame-000003", masks, kClasses);
  const auto set = open_masks(folder.path());
  const core::FrameMasks back = set->read_as_stored("frame-000003");
  EXPECT_EQ(back.semantic.pixels(), masks.semantic.pixels());
  ASSERT_EQ(back.segments.size(), 3U);
  EXPECT_FALSE(back.segments[0].crowd);
  EXPECT_FALSE(back.segments[1].crowd);
  EXPECT_TRUE(back.segments[2].crowd);

  masks.segments[0].crowd = true;  // The floor.
  write_masks(folder.path(), "frame-000003", masks, kClasses);
  EXPECT_THAT(input_error_of([&] { (void)set->read("frame-000003", 4, 2); }),
              AllOf(HasSubstr("frame-000003.json: [0].iscrowd"),
                    HasSubstr("expected 0 for stuff, found 1")));
}

TEST(MaskFiles, ReadsGroundedSamExports) {
  const TemporaryFolder folder("gsam");
  write_ids(folder.path() / "00001.png", {0, 1, 2, 2, 1, 3, 3, 2});
  const std::string list =
      R"([{"value": 0, "label": "background"},
          {"value": 1, "label": "floor", "logit": 0.4, "box": [0, 0, 4, 2]},
          {"value": 2, "label": "office chair", "logit": 0.8},
          {"value": 3, "label": "dragon", "logit": 0.9}])";
  for (const std::string& json : {list, "{\"tags\": \"x\", \"mask\": " + list + "}"}) {
    write_text(folder.path() / "00001.json", json);
    const auto set = open_masks(folder.path(), kClasses);
    EXPECT_EQ(set->layout(), MaskLayout::kGroundedSam);
    const core::FrameMasks masks = set->read("00001", 4, 2);
    EXPECT_THAT(masks.semantic.pixels(), ::testing::ElementsAre(0, 1, 3, 3, 1, 0, 0, 3));
    EXPECT_THAT(masks.instance.pixels(), ::testing::ElementsAre(0, 0, 2, 2, 0, 0, 0, 2));
    EXPECT_EQ(masks.confidence(2, 0), 204);
    EXPECT_EQ(masks.segments.size(), 2U);
  }
}

TEST(MaskFiles, ReadsPanopticReconFolders) {
  const TemporaryFolder folder("recon");
  write_ids(folder.path() / "semantic_image/12.png", {0, 1, 3, 3, 1, 1, 1, 3});
  write_ids(folder.path() / "instance_image/12.png", {0, 5, 1, 1, 0, 0, 0, 2});
  const auto set = open_masks(folder.path(), kClasses);
  EXPECT_EQ(set->layout(), MaskLayout::kPanopticRecon);
  const core::FrameMasks masks = set->read("12", 4, 2);
  EXPECT_EQ(masks.instance(1, 0), 0);  // Stuff has no id.
  EXPECT_EQ(masks.instance(3, 1), 2);
  EXPECT_EQ(masks.confidence(1, 0), 255);
}

TEST(MaskFiles, RefusesWhatIsBroken) {
  struct Fault {
    std::string name;
    std::function<void(const fs::path&)> break_it;
    std::vector<std::string> message;
  };
  const auto text = [](const std::string& file, const std::string& content) {
    return [=](const fs::path& folder) { write_text(folder / file, content); };
  };
  const std::string n = "frame-000003";
  const std::vector<Fault> faults{
      {"no list",
       [](const fs::path& f) { fs::remove(f / "masks.yaml"); },
       {"masks.yaml", "written last"}},
      {"another schema", text("masks.yaml", "schema: other\nversion: 1\n"), {"segsim.masks"}},
      {"unknown class",
       text("masks.yaml",
            "schema: segsim.masks\nversion: 1\nclasses:\n  - {id: 1, name: floor}\n"),
       {n + "_sem.png", "class ids", "found 3"}},
      {"syntax", text(n + ".json", "[{\"id\": 1,\n }]"), {n + ".json", "line 2"}},
      {"no score", text(n + ".json", R"([{"id": 2, "label": "floor"}])"), {"[0]", "score"}},
      {"score",
       text(n + ".json", R"([{"id": 2, "label": "floor", "score": 1.5}])"),
       {"[0].score", "[0, 1]", "1.5"}},
      {"label",
       text(n + ".json", R"([{"id": 2, "label": "flor", "score": 0.5}])"),
       {"[0].label", "'flor'", "masks.yaml"}},
      {"missing entry",
       text(n + ".json", R"([{"id": 0, "label": "floor", "score": 0.5}])"),
       {n + ".json", "id 2"}},
      {"damaged image",
       [&](const fs::path& f) { testing::truncate_file(f / (n + "_ins.png"), 0.7); },
       {n + "_ins.png", "complete PNG"}},
      {"missing image",
       [&](const fs::path& f) { fs::remove(f / (n + "_conf.png")); },
       {n + "_conf.png"}},
      {"another size",
       [&](const fs::path& f) {
         write_ids(f / (n + "_ins.png"), {0, 0}, 2);
       },
       {n + "_ins.png", "4x2", "2x1"}}};
  for (const Fault& fault : faults) {
    const TemporaryFolder folder("broken");
    write_example(folder.path());
    fault.break_it(folder.path());
    const std::string message =
        input_error_of([&] { (void)open_masks(folder.path())->read(n, 4, 2); });
    for (const std::string& part : fault.message) {
      EXPECT_THAT(message, HasSubstr(part)) << fault.name;
    }
  }
}

TEST(MaskFiles, RefusesFoldersThatDoNotFit) {
  const TemporaryFolder folder("none");
  EXPECT_THAT(input_error_of([&] { (void)open_masks(folder.path()); }),
              HasSubstr("masks.yaml"));
  EXPECT_THAT(input_error_of([&] { (void)open_masks(folder.path() / "no"); }),
              HasSubstr("no such folder"));
  write_example(folder.path());
  const std::vector<core::SceneClass> other{{1, "floor", false}, {3, "table", true}};
  EXPECT_THAT(
      input_error_of([&] { (void)open_masks(folder.path(), other); }),
      AllOf(HasSubstr("masks.yaml"), HasSubstr("'table'"), HasSubstr("'office chair'")));
  const std::vector<core::SceneClass> moved{{1, "floor", false}, {4, "office chair", true}};
  EXPECT_THAT(input_error_of([&] { (void)open_masks(folder.path(), moved); }),
              HasSubstr("class 4 to be 'office chair'"));
  // What only one of them knows is no contradiction.
  const std::vector<core::SceneClass> few{{1, "floor", false}, {9, "table", true}};
  EXPECT_EQ(open_masks(folder.path(), few)->info().classes.size(), 2U);
  const TemporaryFolder recon("recon");
  write_ids(recon.path() / "semantic_image/12.png", {0, 1, 3, 3});
  EXPECT_THAT(input_error_of([&] { (void)open_masks(recon.path()); }),
              HasSubstr("classes of a scene"));
}

}  // namespace
}  // namespace segsim::reconstruction
