#include "reconstruction/training/training_set.h"

#include <gmock/gmock.h>

#include "core/error.h"
#include "tests/error_message.h"
#include "tests/reconstruction/tiny_sequence.h"

namespace segsim::reconstruction {
namespace {

using ::testing::ElementsAre;

/// Frame i has colour (i, 0, 0), depth i + 1 at half size, and class 1.
class CountingSequence final : public RgbdSequence {
 public:
  explicit CountingSequence(std::size_t frames, bool masks = true) : masks_(masks) {
    camera_ = core::CameraIntrinsics::from_fov(8, 6, 1.0);
    for (std::size_t i = 0; i < frames; ++i) {
      names_.push_back("f" + std::to_string(i));
      poses_.emplace_back(glm::dquat(1.0, 0.0, 0.0, 0.0),
                          glm::dvec3(static_cast<double>(i), 0.0, 0.0));
    }
    classes_ = {{1, "floor", false}};
  }
  const std::string& name() const override { return name_; }
  const core::CameraIntrinsics& intrinsics() const override { return camera_; }
  std::size_t frame_count() const override { return poses_.size(); }
  const std::string& frame_name(std::size_t i) const override { return names_[i]; }
  const core::CameraPose& pose(std::size_t i) const override { return poses_[i]; }
  bool has_masks() const override { return masks_; }
  const std::vector<core::SceneClass>& classes() const override { return classes_; }
  const std::vector<core::SceneInstance>& instances() const override { return instances_; }
  const std::vector<std::string>& warnings() const override { return lines_; }
  const std::vector<std::string>& notes() const override { return lines_; }
  RgbdFrame load(std::size_t i) const override {
    RgbdFrame frame;
    frame.name = names_[i];
    frame.T_world_camera = poses_[i];
    frame.rgb = core::Image<core::Rgb8>(8, 6, {static_cast<std::uint8_t>(i), 0, 0});
    frame.depth_m = core::Image<float>(4, 3, static_cast<float>(i + 1));
    if (masks_) {
      frame.semantic = core::Image<std::uint16_t>(8, 6, 1);
      frame.semantic(0, 0) = 0;
      frame.instance = core::Image<std::uint16_t>(8, 6, 0);
    }
    return frame;
  }

 private:
  bool masks_;
  std::string name_ = "counting";
  core::CameraIntrinsics camera_;
  std::vector<std::string> names_, lines_;
  std::vector<core::CameraPose> poses_;
  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
};

std::vector<std::size_t> frames_of(const std::vector<TrainingView>& views) {
  std::vector<std::size_t> frames;
  for (const TrainingView& view : views) frames.push_back(view.frame);
  return frames;
}

TEST(TrainingSet, HeldOutFramesAreApart) {
  const CountingSequence sequence(10);
  const TrainingSet set = load_training_set(sequence, nullptr, {.held_out_every = 4});
  EXPECT_THAT(frames_of(set.held_out), ElementsAre(0, 4, 8));
  EXPECT_THAT(frames_of(set.training), ElementsAre(1, 2, 3, 5, 6, 7, 9));
  EXPECT_EQ(set.training[3].rgb(0, 0).r, 5);
  EXPECT_EQ(set.training[3].name, "f5");
  const TrainingSet all = load_training_set(sequence, nullptr, {.held_out_every = 0});
  EXPECT_EQ(all.training.size(), 10U);
  EXPECT_TRUE(all.held_out.empty());
  const TrainingSet some =
      load_training_set(sequence, nullptr, {.held_out_every = 4, .frame_step = 3});
  EXPECT_THAT(frames_of(some.training), ElementsAre(3, 6, 9));
}

TEST(TrainingSet, ImagesHaveOneSize) {
  const TrainingSet set = load_training_set(CountingSequence(3), nullptr, {});
  const TrainingView& view = set.training.front();
  EXPECT_EQ(view.depth_m.width_px(), 8);
  EXPECT_EQ(view.depth_m.height_px(), 6);
  EXPECT_EQ(view.depth_m(7, 5), 2.0F);
  EXPECT_EQ(view.masks.confidence(0, 0), 0);
  EXPECT_EQ(view.masks.confidence(1, 0), 255);
  EXPECT_TRUE(set.has_true_labels);
}

TEST(TrainingSet, WithoutLabels) {
  const TrainingSet set = load_training_set(CountingSequence(3, false), nullptr, {});
  EXPECT_FALSE(set.has_true_labels);
  EXPECT_TRUE(set.training.front().masks.semantic.empty());
}

TEST(TrainingSet, Extent) {
  const TrainingSet set =
      load_training_set(CountingSequence(5), nullptr, {.held_out_every = 0});
  EXPECT_NEAR(set.extent_m(), 2.2, 1e-12);  // Cameras at x = 0 ... 4.
  const TrainingSet one =
      load_training_set(CountingSequence(1), nullptr, {.held_out_every = 0});
  EXPECT_EQ(one.extent_m(), 0.5);
}

TEST(TrainingSet, NothingLeftToTrainOn) {
  EXPECT_THROW((void)load_training_set(CountingSequence(1), nullptr, {.held_out_every = 8}),
               core::InputError);
}

/// Frames 5 and 6 repeat 3 and 4, which a held-out frame is; 7 has the picture of 3 at another
/// pose.
class RepeatingSequence final : public RgbdSequence {
 public:
  const std::string& name() const override { return inner_.name(); }
  const core::CameraIntrinsics& intrinsics() const override { return inner_.intrinsics(); }
  std::size_t frame_count() const override { return 8; }
  const std::string& frame_name(std::size_t i) const override { return inner_.frame_name(i); }
  const core::CameraPose& pose(std::size_t i) const override {
    return inner_.pose(i == 5 || i == 6 ? i - 2 : i);
  }
  bool has_masks() const override { return inner_.has_masks(); }
  const std::vector<core::SceneClass>& classes() const override { return inner_.classes(); }
  const std::vector<core::SceneInstance>& instances() const override {
    return inner_.instances();
  }
  const std::vector<std::string>& warnings() const override { return inner_.warnings(); }
  const std::vector<std::string>& notes() const override { return inner_.notes(); }
  RgbdFrame load(std::size_t i) const override {
    RgbdFrame frame = inner_.load(i == 5 || i == 6 ? i - 2 : i == 7 ? 3 : i);
    frame.name = inner_.frame_name(i);
    frame.T_world_camera = pose(i);
    frame.rgb(1, 1) = {9, 9, static_cast<std::uint8_t>(frame.rgb(0, 0).r)};  // Not plain.
    return frame;
  }

 private:
  CountingSequence inner_{8};
};

TEST(TrainingSet, DuplicateFramesAreLeftOut) {
  const TrainingSet set =
      load_training_set(RepeatingSequence(), nullptr, {.held_out_every = 4});
  EXPECT_THAT(frames_of(set.held_out), ElementsAre(0, 4));
  EXPECT_THAT(frames_of(set.training), ElementsAre(1, 2, 3, 7));
  using ::testing::HasSubstr;
  EXPECT_THAT(set.warnings,
              ElementsAre(HasSubstr("frame f5 left out: it repeats frame f3"),
                          HasSubstr("frame f6 left out: it repeats frame f4"),
                          HasSubstr("frames f3 and f7 are one picture with two poses")));
  EXPECT_TRUE(load_training_set(CountingSequence(8), nullptr, {}).warnings.empty());
}

/// Masks in a folder, of 8 x 6 pixels as the recording unless told.
class MaskFolder {
 public:
  MaskFolder(const std::string& name, int width_px, int height_px, std::uint16_t class_id)
      : folder_(name) {
    core::FrameMasks masks;
    masks.semantic = core::Image<std::uint16_t>(width_px, height_px, class_id);
    masks.instance = core::Image<std::uint16_t>(width_px, height_px, 0);
    masks.confidence = core::Image<std::uint8_t>(width_px, height_px, 255);
    masks.segments = core::segments_of(masks);
    const std::vector<core::SceneClass> written{{class_id, "floor", false}};
    for (int i = 0; i < 3; ++i) {
      write_masks(folder_.path(), "f" + std::to_string(i), masks, written);
    }
    write_mask_set_info(folder_.path(), {"a test", {{1, "floor", false}}, {}, {}, {}});
  }
  [[nodiscard]] std::string load_error() const {
    const auto masks = open_masks(folder_.path());
    return tests::input_error_of(
        [&] { (void)load_training_set(CountingSequence(3), masks.get(), {}); });
  }

 private:
  testing::TemporaryFolder folder_;
};

TEST(TrainingSet, MasksOfAnotherSizeAreRefused) {
  EXPECT_EQ(MaskFolder("fitting", 8, 6, 1).load_error(), "no error");
  EXPECT_THAT(MaskFolder("large", 16, 12, 1).load_error(),
              ::testing::AllOf(::testing::HasSubstr("f1_sem.png"),
                               ::testing::HasSubstr("expected 8x6 pixels"),
                               ::testing::HasSubstr("found 16x12")));
}

TEST(TrainingSet, ClassIdsOutsideTheTableAreRefused) {
  EXPECT_THAT(MaskFolder("unknown", 8, 6, 7).load_error(),
              ::testing::AllOf(
                  ::testing::HasSubstr("f1_sem.png"),
                  ::testing::HasSubstr("expected class ids of the scene's table, found 7")));
}

TEST(TrainingSet, ShrunkViewsSeeTheSamePointsWithFewerPixels) {
  const core::CameraIntrinsics camera{7, 5, 6.0, 9.0, 3.5, 2.5};
  const core::CameraIntrinsics small = shrunk(camera, 3);
  EXPECT_EQ(small.width_px, 2);
  EXPECT_EQ(small.height_px, 1);
  const glm::dvec3 p_m(0.3, -0.2, 2.0);
  EXPECT_NEAR(small.project(p_m).x, camera.project(p_m).x / 3.0, 1e-12);
  EXPECT_NEAR(small.project(p_m).y, camera.project(p_m).y / 3.0, 1e-12);

  TrainingView view;
  view.frame = 4;
  view.rgb = core::Image<core::Rgb8>(7, 5);
  view.depth_m = core::Image<float>(7, 5);
  view.masks.semantic = core::Image<std::uint16_t>(7, 5);
  view.masks.instance = core::Image<std::uint16_t>(7, 5);
  view.masks.confidence = core::Image<std::uint8_t>(7, 5, 255);
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 7; ++x) {
      view.rgb(x, y).r = static_cast<std::uint8_t>(10 * x + y);
      view.depth_m(x, y) = static_cast<float>(10 * x + y);
      view.masks.semantic(x, y) = static_cast<std::uint16_t>(10 * x + y);
    }
  }
  const TrainingView half = shrunk(view, 3);
  EXPECT_EQ(half.frame, 4U);
  ASSERT_EQ(half.rgb.width_px(), 2);
  ASSERT_EQ(half.rgb.height_px(), 1);
  // Means of columns 0 ... 2 and 3 ... 5, rows 0 ... 2; middles (1, 1) and (4, 1).
  EXPECT_EQ(half.rgb(0, 0).r, 11);
  EXPECT_EQ(half.rgb(1, 0).r, 41);
  EXPECT_EQ(half.depth_m(0, 0), 11.0F);
  EXPECT_EQ(half.depth_m(1, 0), 41.0F);
  EXPECT_EQ(half.masks.semantic(1, 0), 41);
  EXPECT_EQ(half.masks.segments.size(), 2U);
  EXPECT_TRUE(half.valid.empty());
  view.valid = core::Image<std::uint8_t>(7, 5, 1);
  view.valid(5, 0) = 0;  // Not the middle of its block.
  view.valid(6, 0) = 0;  // In none.
  EXPECT_EQ(shrunk(view, 3).valid(0, 0), 1);
  EXPECT_EQ(shrunk(view, 3).valid(1, 0), 0);
}

TEST(TrainingSet, CrowdsOfARecordingAreCrowdsOfItsViews) {
  RgbdFrame frame;
  frame.semantic = core::Image<std::uint16_t>(6, 3, 2);
  frame.instance = core::Image<std::uint16_t>(6, 3, 5);
  for (int x = 3; x < 6; ++x) frame.instance(x, 1) = 7;
  frame.crowds = {7, 9};  // 9 is out of view.
  TrainingView view;
  view.rgb = core::Image<core::Rgb8>(6, 3);
  view.masks = exact_masks(frame);
  const TrainingView small = shrunk(view, 3);
  for (const core::FrameMasks& masks : std::vector{view.masks, small.masks}) {
    ASSERT_EQ(masks.segments.size(), 2U);
    EXPECT_FALSE(masks.segments[0].crowd);
    EXPECT_EQ(masks.segments[1].id, 7);
    EXPECT_TRUE(masks.segments[1].crowd);
  }
}

TEST(TrainingSet, LoadsShrunkAndRefusesToShrinkToNothing) {
  const CountingSequence recording(4);
  TrainingSetOptions options;
  options.shrink = 2;
  const TrainingSet set = load_training_set(recording, nullptr, options);
  EXPECT_EQ(set.intrinsics.width_px, 4);
  EXPECT_EQ(set.training.front().rgb.height_px(), 3);
  EXPECT_EQ(set.training.front().depth_m.width_px(), 4);
  EXPECT_EQ(set.held_out.front().masks.semantic.width_px(), 4);
  options.shrink = 7;
  EXPECT_THROW((void)load_training_set(recording, nullptr, options), core::InputError);
}

}  // namespace
}  // namespace segsim::reconstruction
