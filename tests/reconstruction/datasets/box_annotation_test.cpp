#include "reconstruction/datasets/box_annotation.h"

#include <cmath>
#include <string>

#include <gmock/gmock.h>

#include "core/error.h"
#include "tests/reconstruction/tiny_sequence.h"

namespace segsim::reconstruction {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::TemporaryFolder;

const std::string kBoxes = R"({
 "objects": [
  {"id": 5, "class": "sofa", "center": [0, 2, 0.5], "size": [2, 1, 1], "yaw_rad": 0.5, "core": true},
  {"id": 9, "class": "chair", "center": [0, 2, 0.5], "size": [0.5, 0.5, 1], "yaw_rad": 0,
   "core": false, "note": "inside the sofa",
   "parts": [{"center": [0, 2, 0.75], "size": [0.5, 0.5, 0.5], "yaw_rad": 0}]}],
 "planes": {"list": [
  {"id": 1001, "class": "floor", "center": [0, 0, -0.08], "size": [10, 10, 0.24], "yaw_rad": 0},
  {"id": 1002, "class": "wall", "center": [0, 2.4, 1.0], "size": [10, 0.2, 2.0], "yaw_rad": 0}]}})";

std::filesystem::path write_boxes(const TemporaryFolder& folder, const std::string& text) {
  const auto file = folder.path() / "boxes.json";
  testing::write_text(file, text);
  return file;
}

TEST(BoxAnnotation, ReadsNamesAndClasses) {
  const TemporaryFolder folder("boxes");
  const BoxAnnotation annotation = read_box_annotation(write_boxes(folder, kBoxes));
  ASSERT_EQ(annotation.boxes.size(), 4U);
  EXPECT_EQ(annotation.boxes[0].class_name, "couch");  // COCO's word.
  EXPECT_EQ(annotation.boxes[0].name, "couch 1");
  EXPECT_TRUE(annotation.boxes[0].core);
  EXPECT_FALSE(annotation.boxes[1].core);
  EXPECT_EQ(annotation.boxes[1].parts.size(), 1U);
  EXPECT_TRUE(annotation.boxes[2].structure);
  ASSERT_EQ(annotation.classes.size(), 4U);
  EXPECT_TRUE(annotation.classes[0].thing);
  EXPECT_FALSE(annotation.classes[3].thing);
  ASSERT_EQ(annotation.instances.size(), 2U);  // Slabs are none.
  EXPECT_EQ(annotation.instances[0].id, 5);
  EXPECT_NEAR(annotation.instances[0].box_max_m.x, std::cos(0.5) * 1.0 + std::sin(0.5) * 0.5,
              1e-9);
}

TEST(BoxAnnotation, TurnedBoxContains) {
  const OrientedBox box{{1, 2, 3}, {4, 1, 1}, 3.14159265358979 / 2};  // Long along y.
  EXPECT_TRUE(box.contains({1, 3.9, 3}));
  EXPECT_FALSE(box.contains({2.9, 2, 3}));
  EXPECT_FALSE(box.contains({1, 4.05, 3}));
  EXPECT_TRUE(box.contains({1, 4.05, 3}, 0.1));
}

/// One camera at (0, 0, 0.75) that looks along +y at depth `depth_m`; all pixels within +-1
/// cm.
class OneRay final : public RgbdSequence {
 public:
  OneRay(float depth_m, double height_m) : depth_m_(depth_m) {
    intrinsics_ = {3, 3, 1000.0, 1000.0, 1.5, 1.5};
    pose_ = core::look_at({0, 0, height_m}, {0, 1, height_m});
  }
  const std::string& name() const override { return name_; }
  const core::CameraIntrinsics& intrinsics() const override { return intrinsics_; }
  std::size_t frame_count() const override { return 1; }
  const std::string& frame_name(std::size_t) const override { return name_; }
  const core::CameraPose& pose(std::size_t) const override { return pose_; }
  RgbdFrame load(std::size_t) const override {
    RgbdFrame frame;
    frame.rgb = core::Image<core::Rgb8>(3, 3);
    frame.depth_m = core::Image<float>(3, 3, depth_m_);
    frame.depth_m(0, 0) = std::nanf("");
    frame.T_world_camera = pose_;
    return frame;
  }
  bool has_masks() const override { return false; }
  const std::vector<core::SceneClass>& classes() const override { return classes_; }
  const std::vector<core::SceneInstance>& instances() const override { return instances_; }
  const std::vector<std::string>& warnings() const override { return lines_; }
  const std::vector<std::string>& notes() const override { return lines_; }

 private:
  float depth_m_;
  std::string name_ = "ray";
  core::CameraIntrinsics intrinsics_;
  core::CameraPose pose_;
  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
  std::vector<std::string> lines_;
};

/// (class name, instance) of the pixel in the middle.
std::pair<std::string, int> label_at(float depth_m, double height_m) {
  const TemporaryFolder folder("boxes");
  const auto sequence = with_box_labels(std::make_unique<OneRay>(depth_m, height_m),
                                        write_boxes(folder, kBoxes));
  const RgbdFrame frame = sequence->load(0);
  EXPECT_EQ(frame.semantic(0, 0), 0);  // No depth, no label.
  std::string name = "void";
  for (const core::SceneClass& entry : sequence->classes()) {
    if (entry.id == frame.semantic(1, 1)) name = entry.name;
  }
  return {name, frame.instance(1, 1)};
}

TEST(BoxAnnotation, LabelsThePixels) {
  using Label = std::pair<std::string, int>;
  EXPECT_EQ(label_at(2.0F, 0.75), Label("chair", 9));    // The smaller of two boxes.
  EXPECT_EQ(label_at(2.0F, 0.30), Label("couch", 5));    // Below the chair's only part.
  EXPECT_EQ(label_at(1.735F, 0.75), Label("chair", 9));  // 1.5 cm outside: within the margin.
  EXPECT_EQ(label_at(1.70F, 0.75), Label("couch", 5));
  EXPECT_EQ(label_at(2.0F, 0.02), Label("floor", 0));  // The floor comes first.
  EXPECT_EQ(label_at(2.4F, 1.5), Label("wall", 0));
  EXPECT_EQ(label_at(1.0F, 1.5), Label("void", 0));
}

/// A grid over boxes in a row of 2 x 10^7 m would not fit into memory with cells for a room.
TEST(BoxAnnotation, BoxesFarApartFitIntoMemory) {
  const TemporaryFolder folder("boxes");
  const std::string rest = R"(, "size": [1, 1, 1], "yaw_rad": 0})";
  const auto file = write_boxes(
      folder, R"({"objects": [{"id": 1, "class": "chair", "center": [0, 2, 0.5])" + rest +
                  R"(, {"id": 2, "class": "chair", "center": [1e7, 0, 0])" + rest +
                  R"(, {"id": 3, "class": "chair", "center": [-1e7, 0, 1e-3])" + rest + "]}");
  const auto sequence = with_box_labels(std::make_unique<OneRay>(2.0F, 0.75), file);
  EXPECT_EQ(sequence->load(0).instance(1, 1), 1);
}

TEST(BoxAnnotation, RefusesMoreBoxesThanCanBeAsked) {
  const TemporaryFolder folder("boxes");
  std::string parts;
  for (int k = 0; k < 10'001; ++k) {
    parts += std::string(k == 0 ? "" : ",") +
             R"({"center": [0,0,0], "size": [1,1,1], "yaw_rad": 0})";
  }
  const auto file = write_boxes(folder, R"({"objects": [{"id": 1, "class": "chair",
    "center": [0,0,0], "size": [1,1,1], "yaw_rad": 0, "parts": [)" +
                                            parts + "]}]}");
  EXPECT_THROW((void)read_box_annotation(file), core::InputError);
}

TEST(BoxAnnotation, RefusesBadFiles) {
  const std::string head = R"({"objects": [{"id": 1, "class": "chair", )";
  for (const auto& [text, part] : std::vector<std::pair<std::string, std::string>>{
           {"{", "JSON"},
           {"[1]", "'objects'"},
           {head + R"("center": [0,0], "size": [1,1,1], "yaw_rad": 0}]})",
            "objects[0].center"},
           {head + R"("center": [0,0,0], "size": [1,0,1], "yaw_rad": 0}]})", "extents > 0"},
           {head + R"("center": [0,0,0], "size": [1,1,1]}]})", "'yaw_rad'"},
           {head + R"("center": [0,0,"a"], "size": [1,1,1], "yaw_rad": 0}]})",
            "finite number"},
           {head + R"("center": [0,0,1e300], "size": [1,1,1], "yaw_rad": 0}]})",
            "within 1e+07"},
           {head + R"("center": [0,0,0], "size": [1,1,1e999], "yaw_rad": 0}]})", "JSON"},
           {std::string(1000, '['), "nested"},
           {R"({"objects": [{"id": 0, "class": "a"}]})", "[1, 65535]"},
           {head + R"("center": [0,0,0], "size": [1,1,1], "yaw_rad": 0},
             {"id": 1, "class": "a", "center": [0,0,0], "size": [1,1,1], "yaw_rad": 0}]})",
            "not used above"}}) {
    const TemporaryFolder folder("boxes");
    const auto file = write_boxes(folder, text);
    std::string message = "no error";
    try {
      (void)read_box_annotation(file);
    } catch (const core::InputError& error) {
      message = error.what();
    }
    EXPECT_THAT(message, AllOf(HasSubstr("boxes.json"), HasSubstr(part)));
  }
}

}  // namespace
}  // namespace segsim::reconstruction
