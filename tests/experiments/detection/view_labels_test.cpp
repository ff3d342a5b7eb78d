#include "experiments/detection/view_labels.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/detection/label_report.h"
#include "perception/data/image_file.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

class ViewLabelsTest : public testing::Test {
 protected:
  ViewLabelsTest() : folder_("view_labels"), bundle_folder_(folder_.path() / "tiny") {
    TinyScene().write(bundle_folder_);
  }

  [[nodiscard]] core::SceneBundle bundle() const { return core::load_bundle(bundle_folder_); }
  [[nodiscard]] sim::World world() const {
    return sim::World::load(bundle(), sim::RobotModel::jackal_gentle());
  }
  [[nodiscard]] static detection::ViewLabelOptions options() {
    detection::ViewLabelOptions options;
    options.views = 12;
    options.camera = core::CameraIntrinsics::from_fov(96, 72, 1.4);
    options.camera_height_m = 1.0;
    options.class_names = {"chair", "couch"};
    options.show_progress = false;
    return options;
  }
  [[nodiscard]] detection::ViewLabels label(const detection::ViewLabelOptions& options) const {
    return detection::label_views(bundle(), sim::RobotModel::jackal_gentle(), options,
                                  folder_.path() / "out");
  }
  [[nodiscard]] std::filesystem::path drive_file(const std::string& text) const {
    const std::filesystem::path file = folder_.path() / "drive.yaml";
    std::ofstream(file) << "schema: segsim.drive\nversion: 1\n" << text;
    return file;
  }

  TemporaryFolder folder_;
  std::filesystem::path bundle_folder_;
};

TEST_F(ViewLabelsTest, RandomViewsAreReachableDistinctAndNamed) {
  const detection::ViewLabels labels = label(options());
  ASSERT_EQ(labels.dataset.images.size(), 12U);
  const std::string surfels = core::sha256_of_file(bundle_folder_ / "surfels.ply");
  EXPECT_EQ(labels.dataset.scenes, (std::vector<perception::ImagedScene>{{"tiny", surfels}}));
  const sim::World place = world();
  for (std::size_t i = 0; i < labels.dataset.images.size(); ++i) {
    const perception::LabeledImage& image = labels.dataset.images[i];
    EXPECT_EQ(image.scene, "tiny");
    ASSERT_TRUE(image.view.has_value());
    EXPECT_TRUE(place.navmesh().nearest({image.view->x_m, image.view->y_m, 0.0}, 0.1));
    for (std::size_t j = 0; j < i; ++j) {
      EXPECT_FALSE(scenes::ViewDistance().alike(*image.view, *labels.dataset.images[j].view));
    }
  }
}

TEST_F(ViewLabelsTest, ObjectsAgreeWithThemselvesAndWithTheirExtent) {
  detection::ViewLabelOptions many = options();
  many.views = 40;
  const detection::ViewLabels labels = label(many);
  ASSERT_EQ(labels.instances.size(), 2U);
  int seen_whole = 0;
  for (const detection::InstanceConsistency& instance : labels.instances) {
    EXPECT_GT(instance.views, 5) << instance.name;
    EXPECT_EQ(instance.differing_views, 0) << instance.name;
    EXPECT_GT(instance.label_agreement, 0.95) << instance.name;
    if (instance.whole_views == 0) continue;  // The couch may never be seen whole.
    ++seen_whole;
    // Surfels fill their boxes, so a whole view's label is nearly the projected box; in images
    // this small a pixel is a tenth of a side.
    EXPECT_GT(instance.extent_overlap, 0.65) << instance.name;
    EXPECT_NEAR(instance.size_ratio, 1.0, 0.15) << instance.name;
  }
  EXPECT_GT(seen_whole, 0);
  EXPECT_EQ(labels.instances[0].class_name, "couch");
}

TEST_F(ViewLabelsTest, ObjectsOfLittleAgreementAreIgnored) {
  detection::ViewLabelOptions strict = options();
  strict.min_label_agreement = 1.01;
  std::size_t boxes = 0;
  for (const auto& image : label(strict).dataset.images) {
    for (const auto& box : image.boxes) EXPECT_TRUE(box.ignore);
    boxes += image.boxes.size();
  }
  EXPECT_GT(boxes, 0U);
}

TEST_F(ViewLabelsTest, AvoidedPlacesStayEmpty) {
  detection::ViewLabelOptions careful = options();
  careful.avoid_m = {{-2.0, 0.0}, {2.0, 1.0}};
  careful.avoid_radius_m = 1.2;
  const detection::ViewLabels labels = label(careful);
  ASSERT_FALSE(labels.dataset.images.empty());
  EXPECT_EQ(perception::views_near(labels.dataset, "tiny", careful.avoid_m, 1.2), 0);
  EXPECT_GT(perception::views_near(labels.dataset, "tiny", careful.avoid_m, 3.0), 0);
  careful.avoid_radius_m = 50.0;
  EXPECT_THROW((void)label(careful), core::InputError);
}

TEST_F(ViewLabelsTest, ClassMapRenamesTheScenesClasses) {
  detection::ViewLabelOptions mapped = options();
  mapped.class_names = {"seat"};
  perception::ClassMap map;
  map.target_of = {{"couch", "seat"}};
  mapped.class_map = map;
  const detection::ViewLabels labels = label(mapped);
  EXPECT_THAT(labels.unmapped, testing::ElementsAre("chair"));
  int boxes = 0;
  for (const auto& image : labels.dataset.images) {
    for (const auto& box : image.boxes) {
      EXPECT_EQ(box.instance_id, 1);  // The couch.
      ++boxes;
    }
  }
  EXPECT_GT(boxes, 0);
}

TEST_F(ViewLabelsTest, DrivesGoAroundWallsAtEvenSteps) {
  const scenes::Drive drive = scenes::read_drive(
      drive_file("every_m: 0.4\nturn_every_deg: 30\nway_points: [[-2, -1.5], [2, 1.5]]\n"));
  const std::vector<core::Pose2> poses = scenes::drive_poses(world(), drive);
  ASSERT_GT(poses.size(), 10U);
  EXPECT_NEAR(poses.front().x_m, -2.0, 1e-9);
  bool through_passage = false;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const double step_m =
        std::hypot(poses[i].x_m - poses[i - 1].x_m, poses[i].y_m - poses[i - 1].y_m);
    const double turn_rad =
        std::abs(core::wrap_angle_rad(poses[i].yaw_rad - poses[i - 1].yaw_rad));
    EXPECT_LE(step_m, 0.4 + 1e-9);  // Along the chord of a corner it may be less.
    if (step_m < 1e-9) {
      EXPECT_LE(turn_rad, std::numbers::pi / 6.0 + 1e-9);
    }
    through_passage |= std::abs(poses[i].x_m) < 0.2 && poses[i].y_m > 0.8;
  }
  EXPECT_TRUE(through_passage);  // The wall between leaves a passage only there.
}

TEST_F(ViewLabelsTest, DriveViewsComeFirst) {
  detection::ViewLabelOptions driven = options();
  driven.views = 3;
  driven.drives = {scenes::read_drive(drive_file("way_points: [[-2, 0], [-2, -1.8]]\n"))};
  const detection::ViewLabels labels = label(driven);
  ASSERT_GT(labels.drive_views, 1);
  EXPECT_EQ(labels.dataset.images.size(), static_cast<std::size_t>(labels.drive_views) + 3U);
  EXPECT_NEAR(labels.dataset.images[0].view->x_m, -2.0, 1e-9);
  driven.drives[0].scene = "another";
  EXPECT_EQ(label(driven).drive_views, 0);
}

TEST_F(ViewLabelsTest, FaultsOfDrivesAreNamed) {
  const auto fault = [&](const std::string& text) {
    return [this, text] {
      (void)scenes::drive_poses(world(), scenes::read_drive(drive_file(text)));
    };
  };
  EXPECT_THAT(fault("way_points: [[0, 0]]\n"),
              ThrowsMessage<core::InputError>(HasSubstr("two places or more")));
  EXPECT_THAT(fault("way_points: [[-2, 0], [-2, 40]]\n"),
              ThrowsMessage<core::InputError>(HasSubstr("way point 2 (-2.00, 40.00)")));
  EXPECT_THAT(fault("every_m: 0\nway_points: [[-2, 0], [-2, 1]]\n"),
              ThrowsMessage<core::InputError>(HasSubstr("every_m")));
  EXPECT_THAT(fault("way_points: [[-2, 0, 1], [-2, 1]]\n"),
              ThrowsMessage<core::InputError>(HasSubstr("[x, y]")));
}

TEST_F(ViewLabelsTest, ReportFilesBelongTogether) {
  const detection::ViewLabels labels = label(options());
  detection::LabelReport report;
  report.dataset = labels.dataset;
  report.instances = labels.instances;
  report.notes = {"a note for the reader"};
  report.split = detection::split_views(report.dataset, {0.25, {}, {}, 1});
  const std::filesystem::path out = folder_.path() / "out";
  detection::write_label_files(out, report);
  EXPECT_EQ(perception::read_coco(out / "labels.json").images.size(), 12U);
  EXPECT_EQ(perception::read_coco(out / "val_views.json").images.size(), 3U);
  EXPECT_FALSE(std::filesystem::exists(out / "val_scenes.json"));
  EXPECT_TRUE(std::filesystem::exists(out / "labels/00001.txt"));
  EXPECT_THAT(core::read_file(out / "report.md"), HasSubstr("- a note for the reader"));
  EXPECT_THAT(core::read_file(out / "consistency.csv"), HasSubstr("\ntiny,1,couch_1,couch,"));
  EXPECT_GT(perception::read_image(out / "contact_sheet.png").width_px(), 300);
}

TEST(ProjectedBox, IsTheBoxOfTheCornersCutAtTheImage) {
  core::SceneInstance instance;
  instance.box_min_m = {2.0, -0.5, 0.5};
  instance.box_max_m = {3.0, 0.5, 1.5};
  core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(100, 100, 1.5707963267949);
  const auto ahead = core::look_at({0.0, 0.0, 1.0}, {1.0, 0.0, 1.0});
  const auto box = detection::projected_box(instance, ahead, camera);
  ASSERT_TRUE(box.has_value());
  // The near face, 2 m away, with f = 50 px: 0.5 m is 12.5 px.
  EXPECT_NEAR(box->x0, 37.5, 1e-4);
  EXPECT_NEAR(box->y1, 62.5, 1e-4);
  const auto behind = core::look_at({0.0, 0.0, 1.0}, {-1.0, 0.0, 1.0});
  EXPECT_FALSE(detection::projected_box(instance, behind, camera).has_value());
}

}  // namespace
}  // namespace segsim::experiments
