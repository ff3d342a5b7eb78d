#include "experiments/drawing/trial_picture.h"

#include <cmath>

#include <gtest/gtest.h>

#include "experiments/video/trial_video.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

bool near(const core::Rgb8& a, const core::Rgb8& b, int tolerance) {
  return std::abs(a.r - b.r) <= tolerance && std::abs(a.g - b.g) <= tolerance &&
         std::abs(a.b - b.b) <= tolerance;
}

int count_color(const core::Image<core::Rgb8>& image, const core::Rgb8& color, int tolerance) {
  int count = 0;
  for (const core::Rgb8& pixel : image.pixels())
    count += near(pixel, color, tolerance) ? 1 : 0;
  return count;
}

constexpr core::Rgb8 kExplore{30, 116, 196}, kNavigate{240, 120, 30}, kGreen{10, 150, 70};

/// A made-up trial: through the passage from left to right.
struct Drawn {
  drawing::FloorPlan plan = drawing::make_floor_plan(TinyScene().surfels(), 1.8, 40.0);
  core::SceneManifest manifest;
  sim::Episode episode;
  sim::TrialResult result;
  drawing::TrialScene scene;

  Drawn() {
    manifest.classes = {{3, "couch", true}};
    manifest.instances = {{1, 3, "couch_1", {2.0, -2.4, 0.0}, {3.9, -1.5, 0.8}}};
    episode.id = "tiny/couch/00";
    episode.class_name = "couch";
    episode.start = {-3.0, -1.0, 0.0};
    episode.view_points_m = {{2.5, -1.0}};
    for (int k = 0; k <= 100; ++k) {
      sim::TickRecord tick;
      tick.pose = {-3.0 + 0.05 * k, -1.0 + 2.6 * std::sin(0.0314 * k), 0.0};
      tick.mode = k < 60 ? core::PolicyMode::kExplore : core::PolicyMode::kNavigate;
      result.track.push_back(tick);
    }
    result.outcome = sim::Outcome::kSuccess;
    result.success = true;
    result.final_view.resolution_m = 0.1;
    result.final_view.origin_m = {-4.5, -3.0};
    result.final_view.cells = core::Image<std::uint8_t>(60, 60, 1);  // Explored: x < 1.5.
    result.final_view.objects = {{{2.9, -1.9}, 0, 0.9F}};
    scene = {&plan,
             &manifest,
             &episode,
             "Tiny",
             "after",
             0,
             {{-3.0, -1.0}, {0.0, 1.2}, {2.5, -1.0}}};
  }
};

TEST(FloorPlan, CoversTheSceneInItsColours) {
  const Drawn drawn;
  const drawing::FloorPlan& plan = drawn.plan;
  EXPECT_NEAR(plan.rgb.width_px() / plan.px_per_m, 8.4 + 0.8, 0.3);
  EXPECT_NEAR(plan.rgb.height_px() / plan.px_per_m, 5.4 + 0.8, 0.3);
  const auto at = [&](double x_m, double y_m) {
    const glm::dvec2 px = plan.to_px({x_m, y_m});
    return plan.rgb(static_cast<int>(px.x), static_cast<int>(px.y));
  };
  const core::Rgb8 couch = at(3.0, -2.0), chair = at(-3.15, 1.85), floor = at(-2.0, 0.0);
  EXPECT_GT(couch.b, couch.r + 30);  // Blue couch, lower right.
  EXPECT_GT(chair.r, chair.b + 30);  // Red chair, upper left.
  EXPECT_FALSE(near(floor, couch, 30));
  EXPECT_FALSE(near(floor, {250, 250, 248}, 20));  // No hole in the floor.
}

TEST(FloorPlan, AnEmptySceneIsNoError) {
  EXPECT_FALSE(drawing::make_floor_plan(renderer::SurfelCloud{}).rgb.empty());
}

TEST(TrialPicture, ShowsPathGoalAndOutcome) {
  Drawn drawn;
  const core::Image<core::Rgb8> success = drawing::draw_trial(drawn.scene, drawn.result, 700);
  EXPECT_GE(success.width_px(), 700);
  EXPECT_GT(count_color(success, kExplore, 24), 400);
  EXPECT_GT(count_color(success, kNavigate, 24), 250);
  EXPECT_GT(count_color(success, kGreen, 24), 500);

  // A failure has another banner; a trial without a map or a track can be drawn as well.
  drawn.result.outcome = sim::Outcome::kTimeout;
  drawn.result.success = false;
  drawn.result.contacts = 2;
  drawn.result.distance_to_goal_m = std::numeric_limits<double>::infinity();
  const core::Image<core::Rgb8> failure = drawing::draw_trial(drawn.scene, drawn.result, 700);
  EXPECT_LT(count_color(failure, kGreen, 24), count_color(success, kGreen, 24) - 300);
  drawn.result.track.clear();
  drawn.result.final_view = {};
  EXPECT_FALSE(drawing::draw_trial(drawn.scene, drawn.result, 300).empty());
}

TEST(TrialPicture, EqualTrialsGiveEqualPictures) {
  const Drawn drawn;
  EXPECT_EQ(drawing::draw_trial(drawn.scene, drawn.result, 400).pixels(),
            drawing::draw_trial(drawn.scene, drawn.result, 400).pixels());
}

TEST(TrialVideo, IsWrittenWhole) {
  const Drawn drawn;
  const TemporaryFolder folder("video");
  const auto file = folder.path() / "sub" / "trial.mp4";
  core::Frame frame;
  frame.rgb = core::Image<core::Rgb8>(80, 60, {90, 120, 150});
  frame.semantic = core::Image<std::uint16_t>(80, 60, 3);
  frame.instance = core::Image<std::uint16_t>(80, 60, 1);
  const std::vector<core::Detection> detections{{0, 0.8F, {10, 10, 40, 50}}};
  {
    video::TrialVideo video(file, drawn.scene, {"couch"}, 20.0);
    for (int k = 0; k < 10; ++k) {
      video.add(drawn.result.track[static_cast<std::size_t>(5 * k)], frame, detections,
                drawn.result.final_view);
    }
    EXPECT_FALSE(std::filesystem::exists(file));  // Only when it is complete.
    video.finish(drawn.result);
  }
  ASSERT_TRUE(std::filesystem::exists(file));
  EXPECT_GT(std::filesystem::file_size(file), 5000U);

  const auto abandoned = folder.path() / "abandoned.mp4";
  {
    video::TrialVideo video(abandoned, drawn.scene, {"couch"}, 20.0);
    video.add(drawn.result.track[0], frame, detections, drawn.result.final_view);
  }
  // Nothing half done stays behind: only "sub" is left.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()),
                          std::filesystem::directory_iterator()),
            1);
}

}  // namespace
}  // namespace segsim::experiments
