// What happens to the journal of labels and to the bundle between two programs.
#include <algorithm>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "experiments/scene_labels/label_editor.h"
#include "tests/error_message.h"
#include "tests/experiments/label_scene.h"

namespace segsim::experiments::scene_labels {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;
using tests::input_error_of;

class LabelJournal : public testing::Test {
 protected:
  LabelJournal() : bundle_(write_label_scene(folder_ / "scene", LabelKind::kDistributions)) {}

  [[nodiscard]] fs::path journal() const { return bundle_ / kJournalFileName; }
  void edit(const std::string& name) const {
    LabelEditor editor(bundle_);
    (void)editor.apply(
        rename_instance(editor.state(), editor.cloud(), kChairId, {name, true}));
  }
  [[nodiscard]] std::string refusal() const {
    return input_error_of([&] { LabelEditor editor(bundle_); });
  }
  [[nodiscard]] std::string chair() const {
    const core::SceneManifest m = core::load_bundle(bundle_).manifest;
    return m.class_name(m.find_instance(kChairId)->class_id);
  }
  void write(const fs::path& file, const std::string& text) const {
    std::ofstream(file, std::ios::binary) << text;
  }
  /// All files as they are now.
  void keep() {
    fs::remove_all(folder_ / "kept");
    fs::copy(bundle_, folder_ / "kept", fs::copy_options::recursive);
  }
  /// But for the journal.
  void put_back() {
    const std::string newest = core::read_file(journal());
    fs::remove_all(bundle_);
    fs::copy(folder_ / "kept", bundle_, fs::copy_options::recursive);
    write(journal(), newest);
  }

  TemporaryFolder folder_;
  fs::path bundle_;
};

TEST_F(LabelJournal, ACrashBeforeTheBundleIsWrittenLosesNothing) {
  edit("bed");
  keep();
  edit("lamp");
  const std::string wanted = core::read_file(bundle_ / "scene.yaml");
  put_back();
  ASSERT_EQ(chair(), "bed");
  { LabelEditor editor(bundle_); }
  EXPECT_EQ(core::read_file(bundle_ / "scene.yaml"), wanted);
  EXPECT_EQ(chair(), "lamp");
  EXPECT_NO_THROW((void)scenes::load_scene_surfels(core::load_bundle(bundle_)));
}

TEST_F(LabelJournal, ACrashInTheMiddleOfALineLeavesTheLineOut) {
  edit("bed");
  keep();
  const std::string whole = core::read_file(journal());
  edit("lamp");
  const std::string longer = core::read_file(journal());
  put_back();
  for (const std::size_t kept : {std::size_t{1}, std::size_t{20}, longer.size() - 1}) {
    const std::size_t size = std::min(whole.size() + kept, longer.size() - 1);
    write(journal(), longer.substr(0, size));
    LabelEditor editor(bundle_);
    EXPECT_EQ(editor.undoable(), "chair_1 is bed, named bed 2");
  }
  edit("stool");  // Over the rest of the line.
  EXPECT_EQ(chair(), "stool");
  EXPECT_EQ(refusal(), "no error");
  // A crash in the very first line.
  fs::remove_all(bundle_);
  write_label_scene(bundle_);
  write(journal(), longer.substr(0, 100));
  EXPECT_EQ(refusal(), "no error");
  edit("bed");
  EXPECT_EQ(chair(), "bed");
}

TEST_F(LabelJournal, DamageIsOneClearLine) {
  edit("bed");
  edit("lamp");
  const std::string good = core::read_file(journal());
  const std::size_t second = good.find('\n') + 1, third = good.find('\n', second) + 1;
  std::string bad = good;
  bad[second + 60] ^= 1;
  write(journal(), bad);
  EXPECT_THAT(refusal(),
              HasSubstr("label_journal.jsonl:2: expected a line that its checksum"));
  EXPECT_THAT(refusal(), HasSubstr("the journal is damaged"));
  EXPECT_THAT(refusal(), Not(HasSubstr("\n")));
  write(journal(), good.substr(0, second) + good.substr(third));  // A line is missing.
  EXPECT_THAT(refusal(), HasSubstr("label_journal.jsonl:2:"));
  write(journal(), "\n" + good);
  EXPECT_THAT(refusal(), HasSubstr("label_journal.jsonl:1:"));
  write(journal(), "hello\n");
  EXPECT_THAT(refusal(), HasSubstr("label_journal.jsonl:1:"));
  // Nothing was changed by looking.
  write(journal(), good);
  EXPECT_EQ(refusal(), "no error");
  EXPECT_EQ(chair(), "lamp");
}

TEST_F(LabelJournal, WithoutItTheLabelsStay) {
  edit("bed");
  fs::remove(journal());
  {
    LabelEditor editor(bundle_);
    EXPECT_EQ(editor.undoable(), std::nullopt);
  }
  edit("lamp");
  LabelEditor editor(bundle_);
  (void)editor.undo();
  EXPECT_EQ(chair(), "bed");
  EXPECT_EQ(editor.undoable(), std::nullopt);
}

TEST_F(LabelJournal, OfAnotherSceneIsRefused) {
  edit("bed");
  const std::string of_first = core::read_file(journal());
  fs::remove_all(bundle_);
  write_label_scene(bundle_, LabelKind::kDistributionsWithClasses);
  write(journal(), of_first);
  EXPECT_THAT(refusal(), HasSubstr("a journal of this scene's surfels and labels"));
}

TEST_F(LabelJournal, AManifestThatSomebodyChangedIsNotOverwritten) {
  edit("bed");
  edit("lamp");
  std::string text = core::read_file(bundle_ / "scene.yaml");
  text.replace(text.find("lamp 2"), 6, "mine 2");
  write(bundle_ / "scene.yaml", text);
  EXPECT_THAT(refusal(), HasSubstr("scene.yaml: expected the labels, classes and instances "
                                   "that label_journal.jsonl leads to, found others"));
  EXPECT_EQ(core::read_file(bundle_ / "scene.yaml"), text);
}

TEST_F(LabelJournal, AnotherCommandMayChangeTheRestOfTheBundle) {
  LabelEditor editor(bundle_);
  core::SceneManifest m = core::load_bundle(bundle_).manifest;
  m.statistics.emplace_back("doors_counted", 12.0);
  core::write_bundle_manifest(bundle_, m, core::load_bundle_parts(bundle_));
  (void)editor.apply(rename_instance(editor.state(), editor.cloud(), kChairId, {"bed", true}));
  EXPECT_THAT(core::read_file(bundle_ / "scene.yaml"), HasSubstr("doors_counted: 12"));
  EXPECT_EQ(chair(), "bed");
  m = core::load_bundle(bundle_).manifest;
  m.instances[0].name = "mine";
  core::write_bundle_manifest(bundle_, m, core::load_bundle_parts(bundle_));
  EXPECT_THAT(input_error_of([&] { (void)editor.undo(); }),
              HasSubstr("that were last written"));
}

}  // namespace
}  // namespace segsim::experiments::scene_labels
