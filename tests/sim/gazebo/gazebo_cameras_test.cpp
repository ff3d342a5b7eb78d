// Camera sensors of SDF worlds: mounting, optics, topics.

#include "sim/gazebo/gazebo_cameras.h"

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/error_message.h"

namespace segsim::sim {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using tests::input_error_of;

std::string world_of(const std::string& content) {
  return "<sdf version=\"1.9\"><world name=\"lab\">" + content + "</world></sdf>";
}

std::string robot_with(const std::string& sensors) {
  return world_of("<model name=\"bot\"><pose>5 6 7 0 0 0</pose><link name=\"base\">" +
                  sensors + "</link></model>");
}

std::string sensor(const std::string& type, const std::string& extra,
                   const std::string& camera = {}) {
  return "<sensor name=\"eye\" type=\"" + type + "\">" + extra +
         "<update_rate>15</update_rate><camera><horizontal_fov>1.5707963267948966"
         "</horizontal_fov><image><width>200</width><height>100</height></"
         "image><clip><near>0.2"
         "</near><far>9</far></clip>" +
         camera + "</camera></sensor>";
}

GazeboCameras parse(const std::string& text) { return parse_gazebo_cameras(text, "test.sdf"); }

TEST(GazeboCameras, OpticsComeFromTheSensor) {
  const GazeboCameras found = parse(robot_with(sensor("camera", "")));
  EXPECT_EQ(found.world, "lab");
  EXPECT_THAT(found.warnings, IsEmpty());
  ASSERT_THAT(found.cameras, SizeIs(1));
  const GazeboCamera& camera = found.cameras[0];
  EXPECT_EQ(camera.intrinsics.width_px, 200);
  EXPECT_EQ(camera.intrinsics.height_px, 100);
  EXPECT_NEAR(camera.intrinsics.fx_px, 100.0, 1e-9);  // 90 degrees over 200 pixels.
  EXPECT_NEAR(camera.intrinsics.fy_px, 100.0, 1e-9);
  EXPECT_EQ(camera.intrinsics.cx_px, 100.0);
  EXPECT_EQ(camera.intrinsics.cy_px, 50.0);
  EXPECT_EQ(camera.rate_hz, 15.0);
  EXPECT_EQ(camera.near_m, 0.2);
  EXPECT_EQ(camera.far_m, 9.0);
  EXPECT_EQ(camera.frame_id, "bot::base::eye");
  EXPECT_THAT(camera.link_path, ElementsAre("bot", "base"));
}

TEST(GazeboCameras, LensIntrinsicsTakeTheFieldOfViewsPlace) {
  const GazeboCameras found = parse(robot_with(sensor(
      "camera", "",
      "<lens><intrinsics><fx>90</fx><fy>91</fy><cx>99</cx><cy>52</cy></intrinsics></lens>"
      "<distortion><k1>0.1</k1></distortion>")));
  ASSERT_THAT(found.cameras, SizeIs(1));
  EXPECT_EQ(found.cameras[0].intrinsics.fx_px, 90.0);
  EXPECT_EQ(found.cameras[0].intrinsics.fy_px, 91.0);
  EXPECT_EQ(found.cameras[0].intrinsics.cx_px, 99.0);
  EXPECT_EQ(found.cameras[0].intrinsics.cy_px, 52.0);
  EXPECT_THAT(found.warnings, ElementsAre(HasSubstr("distortion")));
}

TEST(GazeboCameras, TopicsAreThoseOfGazebosSensors) {
  const std::string scoped = "/world/lab/model/bot/link/base/sensor/eye";
  const auto one = [](const std::string& type, const std::string& extra) {
    return parse(robot_with(sensor(type, extra))).cameras.at(0);
  };
  GazeboCamera c = one("camera", "");
  EXPECT_EQ(c.rgb_topic, scoped + "/image");
  EXPECT_EQ(c.info_topic, scoped + "/camera_info");
  c = one("camera", "<topic>front/rgb</topic>");
  EXPECT_EQ(c.rgb_topic, "/front/rgb");
  EXPECT_EQ(c.info_topic, "/front/camera_info");
  c = one("depth_camera", "");
  EXPECT_EQ(c.rgb_topic, "");
  EXPECT_EQ(c.depth_topic, scoped + "/depth_image");
  EXPECT_EQ(c.info_topic, scoped + "/camera_info");
  c = one("rgbd_camera", "<topic>camera</topic>");
  EXPECT_EQ(c.rgb_topic, "/camera/image");
  EXPECT_EQ(c.depth_topic, "/camera/depth_image");
  EXPECT_EQ(c.info_topic, "/camera/camera_info");
  EXPECT_EQ(one("rgbd_camera", "").depth_topic, scoped + "/depth_image");
  c = one("segmentation", "");
  EXPECT_EQ(c.labels_topic, scoped + "/segmentation/labels_map");
  EXPECT_EQ(c.colored_topic, scoped + "/segmentation/colored_map");
  EXPECT_EQ(c.info_topic, scoped + "/segmentation/camera_info");
  EXPECT_EQ(c.rgb_topic, "");
  EXPECT_EQ(one("segmentation", "<topic>/panoptic</topic>").labels_topic,
            "/panoptic/labels_map");
}

TEST(GazeboCameras, SegmentationTypes) {
  const auto coding = [](const std::string& camera) {
    return parse(robot_with(sensor("segmentation", "", camera))).cameras.at(0).labels;
  };
  EXPECT_EQ(coding(""), GazeboLabels::kSemantic);
  EXPECT_EQ(coding("<segmentation_type>semantic</segmentation_type>"),
            GazeboLabels::kSemantic);
  EXPECT_EQ(coding("<segmentation_type>panoptic</segmentation_type>"),
            GazeboLabels::kPanoptic);
  EXPECT_EQ(coding("<segmentation_type>instance</segmentation_type>"),
            GazeboLabels::kPanoptic);
}

TEST(GazeboCameras, TheMountingIsRelativeToItsLink) {
  // Turned left by 90 degrees and 0.3 m up; where the model stands does not matter.
  const GazeboCameras found =
      parse(robot_with(sensor("camera", "<pose>0.1 0 0.3 0 0 1.5707963267948966</pose>")));
  const auto& T = found.cameras.at(0).T_link_camera;
  EXPECT_EQ(T.translation_m(), glm::dvec3(0.1, 0.0, 0.3));
  const glm::dvec3 axis = T.rotation() * glm::dvec3(0, 0, 1);
  EXPECT_NEAR(axis.x, 0.0, 1e-12);
  EXPECT_NEAR(axis.y, 1.0, 1e-12);
  const glm::dvec3 down = T.rotation() * glm::dvec3(0, 1, 0);
  EXPECT_NEAR(down.z, -1.0, 1e-12);
}

TEST(GazeboCameras, CamerasOfStaticModelsAreFixedInTheWorld) {
  const GazeboCameras found = parse(world_of(
      "<model name=\"pole\"><static>true</static><pose>1 2 0 0 0 3.141592653589793</pose>"
      "<link name=\"top\"><pose>0 0 2 0 0 0</pose>" +
      sensor("camera", "<pose>0.5 0 0 0 0 0</pose>") + "</link></model>"));
  const GazeboCamera& camera = found.cameras.at(0);
  EXPECT_THAT(camera.link_path, IsEmpty());
  EXPECT_NEAR(camera.T_link_camera.translation_m().x, 0.5, 1e-12);
  EXPECT_NEAR(camera.T_link_camera.translation_m().y, 2.0, 1e-12);
  EXPECT_NEAR(camera.T_link_camera.translation_m().z, 2.0, 1e-12);
}

TEST(GazeboCameras, NestedModelsLengthenThePath) {
  const GazeboCameras found = parse(world_of(
      "<model name=\"bot\"><link name=\"base\"/><model name=\"head\"><pose>0 0 1 0 0 0</pose>"
      "<link name=\"skull\">" +
      sensor("camera", "") + "</link></model></model>"));
  EXPECT_THAT(found.cameras.at(0).link_path, ElementsAre("bot", "head", "skull"));
  EXPECT_EQ(found.cameras.at(0).rgb_topic,
            "/world/lab/model/bot/model/head/link/skull/sensor/eye/image");
  EXPECT_EQ(found.cameras.at(0).frame_id, "bot::head::skull::eye");
}

TEST(GazeboCameras, BadWorldsAreOneLine) {
  EXPECT_THAT(input_error_of([] { (void)read_gazebo_cameras("/nowhere/world.sdf"); }),
              HasSubstr("no such file"));
  EXPECT_THAT(input_error_of([] { (void)parse("no sdf at all"); }),
              HasSubstr("expected an SDF file with a world"));
  EXPECT_THAT(input_error_of([] { (void)parse(world_of("")); }), HasSubstr("found none"));
  EXPECT_THAT(
      input_error_of([] { (void)parse(robot_with("<sensor name=\"s\" type=\"imu\"/>")); }),
      HasSubstr("a sensor of type camera"));
  EXPECT_THAT(input_error_of([] {
                (void)parse(
                    robot_with("<sensor name=\"eye\" type=\"camera\"><camera><horizontal_fov>"
                               "3.14</horizontal_fov><image><width>8</width><height>8</height>"
                               "</image></camera></sensor>"));
              }),
              HasSubstr("bot::base::eye: expected a horizontal_fov"));
  EXPECT_THAT(input_error_of([] {
                (void)parse(
                    robot_with("<sensor name=\"eye\" type=\"camera\"><camera><horizontal_fov>"
                               "1</horizontal_fov><image><width>0</width><height>8</height>"
                               "</image></camera></sensor>"));
              }),
              HasSubstr("found 0 x 8"));
  EXPECT_THAT(input_error_of([] {
                (void)parse(robot_with(sensor(
                    "segmentation", "", "<segmentation_type>colour</segmentation_type>")));
              }),
              HasSubstr("found colour"));
}

}  // namespace
}  // namespace segsim::sim
