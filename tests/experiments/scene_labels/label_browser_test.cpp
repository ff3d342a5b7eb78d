// The page of `segsim scene label` in a real browser, with its mouse and keyboard.
#include <cstdlib>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "tests/experiments/scene_labels/browser_session.h"
#include "tests/experiments/scene_labels/served_labels.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;
using tests::BrowserSession;

constexpr int kCtrl = 2;
constexpr const char* kDrawnFirst =
    "document.documentElement.dataset.ready === '1' && document.documentElement.dataset.drawn "
    ">= 1";

class LabelsInABrowser : public testing::Test {
 protected:
  void SetUp() override {
    if (!tests::has_browser()) {
      GTEST_SKIP() << "no chromium on this machine (Debian: apt-get install chromium)";
    }
    bundle_ = write_label_scene(folder_ / "scene", LabelKind::kDistributions);
    served_ = std::make_unique<ServedLabels>(bundle_);
    browser_ = std::make_unique<BrowserSession>(served_->address(), folder_.path(), 1500, 980);
    ASSERT_TRUE(browser_->wait_for(kDrawnFirst));
  }

  /// Where an instance is in the window. @param camera  That the page shows.
  [[nodiscard]] std::pair<double, double> place_of(std::size_t camera, int instance) {
    const ServedLabels::Ids ids =
        served_->ids("camera=" + std::to_string(camera) + "&width=960");
    const auto [x, y] = ServedLabels::pixel_of(ids, instance);
    const auto box = browser_->evaluate(
        "(() => { const box = document.getElementById('picture').getBoundingClientRect(); "
        "return [box.left, box.top, box.width, box.height]; })()");
    return {box[0].get<double>() + (x + 0.5) / ids.width_px * box[2].get<double>(),
            box[1].get<double>() + (y + 0.5) / ids.height_px * box[3].get<double>()};
  }
  void show_camera(std::size_t camera) {
    const std::string drawn =
        browser_->evaluate("document.documentElement.dataset.drawn").get<std::string>();
    for (std::size_t k = 0; k < camera; ++k) browser_->click("#camera-forward");
    ASSERT_TRUE(
        browser_->wait_for("Number(document.documentElement.dataset.drawn) > " + drawn));
  }
  [[nodiscard]] std::string chair() const {
    const core::SceneManifest m = core::load_bundle(bundle_).manifest;
    const core::SceneInstance* row = m.find_instance(kChairId);
    return row == nullptr ? "none" : m.class_name(row->class_id);
  }
  bool says(const std::string& text) {
    return browser_->wait_for("document.getElementById('message').textContent.includes('" +
                              text + "')");
  }

  TemporaryFolder folder_{"label_browser"};
  std::filesystem::path bundle_;
  std::unique_ptr<ServedLabels> served_;
  std::unique_ptr<BrowserSession> browser_;
};

TEST_F(LabelsInABrowser, AClickedObjectIsRenamedAndThatIsUndone) {
  const std::string before = core::read_file(bundle_ / "scene.yaml");
  show_camera(kChairView);
  const auto [x, y] = place_of(kChairView, kChairId);
  browser_->move_to(x, y);
  ASSERT_TRUE(
      browser_->wait_for("document.getElementById('under').textContent === 'chair_1 "
                         "(chair)'"));
  EXPECT_EQ(browser_->evaluate("document.querySelector('#objects .hovered').dataset.instance"),
            "2");
  browser_->click(x, y);
  EXPECT_EQ(browser_->text("chosen-name"), "chair_1");
  browser_->press("n");  // The class, all of it selected.
  browser_->type("bar stool");
  browser_->press("Enter");
  ASSERT_TRUE(says("chair_1 is bar stool, named bar stool 2. Saved."));
  EXPECT_EQ(chair(), "bar stool");
  EXPECT_THAT(browser_->text("objects"), HasSubstr("bar stool (1)"));
  EXPECT_THAT(browser_->text("undo"), HasSubstr("chair_1 is bar stool"));
  EXPECT_EQ(browser_->evaluate("document.getElementById('redo').disabled"), true);

  browser_->click("#undo");
  ASSERT_TRUE(says("Undone: chair_1 is bar stool"));
  EXPECT_EQ(core::read_file(bundle_ / "scene.yaml"), before);
  EXPECT_EQ(browser_->text("chosen-name"), "chair_1");
  browser_->press("y", kCtrl);
  ASSERT_TRUE(says("Redone"));
  EXPECT_EQ(chair(), "bar stool");
  browser_->press("z", kCtrl);
  ASSERT_TRUE(says("Undone"));
  EXPECT_EQ(chair(), "chair");
  EXPECT_THAT(browser_->complaints(), IsEmpty());
}

TEST_F(LabelsInABrowser, ClicksMergeCutAndDelete) {
  const auto [x, y] = place_of(kCouchView, kCouchId);
  browser_->click(x, y);
  browser_->press("c");
  browser_->click(x - 30, y);
  ASSERT_TRUE(browser_->wait_for(
      "document.getElementById('mode-text').textContent === 'Click the other part.'"));
  browser_->click(x + 30, y);
  ASSERT_TRUE(
      browser_->wait_for("!document.getElementById('mode-do').classList.contains('hidden')"));
  browser_->press("Enter");
  ASSERT_TRUE(says("couch_1 is split into 2. Saved."));
  EXPECT_EQ(core::load_bundle(bundle_).manifest.instances.size(), 3U);

  // The part back to the whole: M, and a click in the list.
  browser_->click("#objects [data-instance=\"3\"]");
  browser_->press("m");
  browser_->click("#objects [data-instance=\"1\"]");
  ASSERT_TRUE(says("couch 3 is part of couch_1. Saved."));
  EXPECT_EQ(core::load_bundle(bundle_).manifest.instances.size(), 2U);

  browser_->press("Delete");
  ASSERT_TRUE(says("couch_1 is deleted. Saved."));
  EXPECT_EQ(browser_->text("chosen-name"), "Nothing is chosen");
  EXPECT_EQ(core::load_bundle(bundle_).manifest.find_instance(kCouchId), nullptr);
  EXPECT_THAT(browser_->text("objects"), testing::Not(HasSubstr("couch")));
  EXPECT_THAT(browser_->complaints(), IsEmpty());
}

TEST_F(LabelsInABrowser, WhatGoesWrongIsSaid) {
  browser_->click("#objects [data-instance=\"2\"]");
  browser_->press("x");
  ASSERT_TRUE(says("chair_1: expected 2 to 50 pieces that do not touch, found 1"));
  EXPECT_EQ(browser_->evaluate("document.getElementById('message').className"),
            "message error");
  // Another window was faster.
  EXPECT_EQ(served_->edit(R"("do":"rename","instance":2,"class":"bed")").status, 200);
  browser_->press("Delete");
  ASSERT_TRUE(says("The labels were changed elsewhere meanwhile; nothing was done."));
  EXPECT_EQ(chair(), "bed");
  EXPECT_THAT(browser_->text("objects"), HasSubstr("bed (1)"));  // Shown as it is now.
  browser_->press("Delete");
  ASSERT_TRUE(says("bed 2 is deleted"));
}

TEST_F(LabelsInABrowser, KeysMoveTheCameraAndAPictureIsThere) {
  // From the couch's camera to the chair's.
  browser_->click("#objects [data-instance=\"2\"]");
  browser_->press("f");
  ASSERT_TRUE(browser_->wait_for("document.getElementById('camera').value === '1'"));
  browser_->press("w");
  ASSERT_TRUE(browser_->wait_for("document.getElementById('camera').value === ''"));
  ASSERT_TRUE(browser_->wait_for("document.getElementById('picture').width === 960"));
  // Colours of many kinds, where nothing would be drawn there are none.
  const auto colors = browser_->evaluate(
      "(() => { const c = document.getElementById('picture'); const d = "
      "c.getContext('2d').getImageData(0, 0, c.width, c.height).data; const seen = new Set(); "
      "for (let i = 0; i < d.length; i += 4) seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]); "
      "return seen.size; })()");
  EXPECT_GT(colors, 200);
  if (const char* keep = std::getenv("SEGSIM_SCREENSHOTS")) {
    browser_->screenshot(std::filesystem::path(keep) / "label.png");
  }
  EXPECT_THAT(browser_->complaints(), IsEmpty());
}

}  // namespace
}  // namespace segsim::experiments
