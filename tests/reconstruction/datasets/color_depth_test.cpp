// Depth of another camera, another time and a stated sensor.

#include "reconstruction/datasets/color_depth.h"

#include <cmath>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>

#include "core/random.h"
#include "reconstruction/datasets/depth_sensor.h"
#include "reconstruction/datasets/internal/reproject_depth.h"
#include "reconstruction/datasets/pose_track.h"
#include "tests/error_message.h"
#include "tests/reconstruction/ray_room.h"
#include "tests/reconstruction/tiny_datasets.h"

namespace segsim::reconstruction {
namespace {

using namespace testing;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;

core::CameraIntrinsics wide_camera(int width_px, int height_px) {
  return core::CameraIntrinsics::from_fov(width_px, height_px,
                                          75.0 * std::numbers::pi / 180.0);
}

/// Without noise.
core::Image<float> exact_depth(const RayRoom& room, const core::CameraPose& T,
                               const core::CameraIntrinsics& camera) {
  core::Image<float> depth_m(camera.width_px, camera.height_px, std::nanf(""));
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const glm::dvec3 ray = T.rotation() * camera.back_project({x + 0.5, y + 0.5}, 1.0);
      double z = 1e9;
      for (const Rectangle& r : room.rectangles)
        z = std::min(z, hit(r, T.translation_m(), ray));
      depth_m(x, y) = static_cast<float>(z);
    }
  }
  return depth_m;
}

struct Comparison {
  int seen = 0;     ///< Pixels whose surface the first camera sees, too.
  int missing = 0;  ///< Of these, without depth.
  int right = 0;    ///< Of these, within 1 % of the truth.
  int through = 0;  ///< Of all pixels, those that show what lies behind a surface.
};

/// Whether the surface at a point shows in the first camera, and its neighbourhood, too.
bool is_seen(const core::Image<float>& depth_m, const core::CameraIntrinsics& camera,
             const glm::dvec3& p_m) {
  if (p_m.z <= 0.0) return false;
  const glm::dvec2 px = camera.project(p_m);
  const int x = static_cast<int>(std::floor(px.x)), y = static_cast<int>(std::floor(px.y));
  for (int k = 0; k < 9; ++k) {
    const int nx = x + k % 3 - 1, ny = y + k / 3 - 1;
    if (!depth_m.contains(nx, ny) || std::abs(depth_m(nx, ny) - p_m.z) > 0.03 * p_m.z) {
      return false;
    }
  }
  return true;
}

Comparison compare(const RayRoom& room, const core::CameraPose& T_world_from,
                   const core::CameraIntrinsics& from, const CameraToCamera& T_to_from,
                   const core::CameraIntrinsics& to) {
  const core::Image<float> measured_m = exact_depth(room, T_world_from, from);
  const core::Image<float> truth_m = exact_depth(room, T_world_from * T_to_from.inverse(), to);
  const core::Image<float> found_m =
      internal::reproject_depth(measured_m, from, T_to_from, to);
  Comparison result;
  for (int y = 0; y < to.height_px; ++y) {
    for (int x = 0; x < to.width_px; ++x) {
      const core::Point<core::frame::Camera> p{
          to.back_project({x + 0.5, y + 0.5}, truth_m(x, y))};
      if (found_m(x, y) > 1.1F * truth_m(x, y)) ++result.through;
      if (!is_seen(measured_m, from, (T_to_from.inverse() * p).xyz_m)) continue;
      ++result.seen;
      if (!(found_m(x, y) > 0.0F)) ++result.missing;
      if (std::abs(found_m(x, y) - truth_m(x, y)) < 0.01 * truth_m(x, y)) ++result.right;
    }
  }
  return result;
}

TEST(ReprojectDepth, IsWhatTheOtherCameraWouldMeasure) {
  const RayRoom room = living_room();
  const CameraToCamera T{glm::angleAxis(0.02, glm::normalize(glm::dvec3(0.3, 1.0, 0.1))),
                         {0.05, -0.01, 0.02}};
  for (const std::size_t view : {0U, 5U, 11U, 17U}) {
    const core::CameraIntrinsics camera = wide_camera(160, 120);
    const Comparison same = compare(room, room.cameras[view], camera, T, camera);
    EXPECT_GT(same.seen, 15000);
    EXPECT_EQ(same.missing, 0);  // Surfaces have no cracks.
    EXPECT_GT(same.right, 0.995 * same.seen);
    // Half a pixel along contours, and what only the other camera can see to be hidden.
    EXPECT_LT(same.through, 0.01 * 160 * 120);
    // Twice as many pixels of a narrower view: every depth pixel covers several.
    core::CameraIntrinsics narrow = core::CameraIntrinsics::from_fov(320, 240, 0.9);
    narrow.cx_px += 3.3;
    const Comparison larger = compare(room, room.cameras[view], camera, T, narrow);
    EXPECT_GT(larger.seen, 60000);
    EXPECT_EQ(larger.missing, 0);
    EXPECT_GT(larger.right, 0.995 * larger.seen);
  }
}

TEST(ReprojectDepth, NearSurfacesHideFarOnes) {
  // A board at 1 m before a wall at 3 m; the other camera stands 20 cm to the right.
  const core::CameraIntrinsics camera = wide_camera(80, 60);
  core::Image<float> depth_m(80, 60, 3.0F);
  for (int y = 20; y < 40; ++y) {
    for (int x = 30; x < 50; ++x) depth_m(x, y) = 1.0F;
  }
  const CameraToCamera T{{1.0, 0.0, 0.0, 0.0}, {-0.2, 0.0, 0.0}};
  const auto found_m = internal::reproject_depth(depth_m, camera, T, camera);
  // f = 52 px: the board moves by 10.4 px, the wall by 3.5 px.
  EXPECT_FLOAT_EQ(found_m(30, 30), 1.0F);
  EXPECT_FLOAT_EQ(found_m(38, 30), 1.0F);
  EXPECT_FLOAT_EQ(found_m(15, 30), 3.0F);
  EXPECT_TRUE(std::isnan(found_m(42, 30)));  // Behind the board, seen by nobody.
  EXPECT_FLOAT_EQ(found_m(50, 30), 3.0F);
  EXPECT_TRUE(std::isnan(found_m(78, 10)));  // Outside of what the depth camera sees.
}

TEST(ColorDepthFile, ComesBackAsItWasWritten) {
  const TemporaryFolder folder;
  const ColorDepth written{{glm::angleAxis(0.3, glm::normalize(glm::dvec3(1, 2, 3))),
                            {0.025, -0.001, 0.0123456789}},
                           wide_camera(64, 48)};
  write_color_depth(folder / "a.yaml", written);
  const ColorDepth read = read_color_depth(folder / "a.yaml");
  const glm::dvec3 p(0.3, -0.2, 2.0);
  const auto at = [&](const ColorDepth& c) {
    return (c.T_color_depth * core::Point<core::frame::Camera>{p}).xyz_m;
  };
  EXPECT_LT(glm::distance(at(read), at(written)), 1e-9);
  ASSERT_TRUE(read.depth_camera.has_value());
  EXPECT_EQ(read.depth_camera->width_px, 64);
  EXPECT_NEAR(read.depth_camera->cx_px, written.depth_camera->cx_px, 1e-9);
}

TEST(ColorDepthFile, SaysWhatIsWrongInOneLine) {
  const std::string head = "schema: segsim.color_depth\nversion: 1\n";
  const std::string eye = "T_color_depth: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n";
  struct Fault {
    std::string text, message;
  };
  for (const Fault& fault :
       {Fault{"schema: labels\nversion: 1\n", "segsim.color_depth"},
        Fault{head + "T_color_depth: [1, 0, 0]\n", "16 numbers"},
        Fault{head + "T_color_depth: [1,0,0,0, 0,2,0,0, 0,0,1,0, 0,0,0,1]\n", "orthonormal"},
        Fault{head + "T_color_depth: [1,0,0,25, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n", "millimetres?"},
        Fault{head + eye + "scale: 2\n", "scale"},
        Fault{
            head + eye + "depth_camera: {width: 8, height: 6, fx: 9, fy: 9, cx: 90, cy: 3}\n",
            "principal point"},
        Fault{
            head + eye + "depth_camera: {width: 8, height: 6, fx: -9, fy: 9, cx: 4, cy: 3}\n",
            "focal lengths"}}) {
    const TemporaryFolder folder;
    folder.write("c.yaml", fault.text);
    const std::string message =
        tests::input_error_of([&] { (void)read_color_depth(folder / "c.yaml"); });
    EXPECT_THAT(message, AllOf(HasSubstr("c.yaml"), HasSubstr(fault.message)));
  }
}

TEST(ColorDepthOption, BringsAnotherCamerasDepthToTheColourImage) {
  const TemporaryFolder folder("scannet");
  write_scannet(folder.path(), false);
  SequenceOptions options = as_is();
  // 8 x 6 depth images of another shape of view than the 16 x 12 colour images, all at 1.5 m.
  options.color_depth = ColorDepth{{{1.0, 0.0, 0.0, 0.0}, {0.0, 0.0, 0.25}},
                                   core::CameraIntrinsics{8, 6, 7.0, 7.0, 4.0, 3.0}};
  const auto sequence = open_sequence(folder.path(), options);
  EXPECT_THAT(sequence->notes(), Contains(HasSubstr("--color-depth")));
  const RgbdFrame frame = sequence->load(0);
  EXPECT_EQ(frame.depth_m.width_px(), 8);
  EXPECT_FLOAT_EQ(frame.depth_m(4, 3), 1.75F);
  // Depth images of another size than the file says.
  options.color_depth->depth_camera->width_px = 9;
  EXPECT_THAT(open_error(folder.path(), options), HasSubstr("9x6 pixels"));
}

TEST(PoseTrack, LiesBetweenItsEntries) {
  const glm::dvec3 z(0.0, 0.0, 1.0);
  const PoseTrack track({{2.0, {glm::angleAxis(0.4, z), {2.0, 0.0, 0.0}}},
                         {1.9, {glm::angleAxis(0.0, z), {0.0, 0.0, 1.0}}},
                         {1.9, {glm::angleAxis(3.0, z), {9.0, 9.0, 9.0}}},
                         {3.0, {}}});
  const auto middle = track.at(1.925);
  ASSERT_TRUE(middle.has_value());
  EXPECT_NEAR(middle->translation_m().x, 0.5, 1e-9);
  EXPECT_NEAR(middle->translation_m().z, 0.75, 1e-9);
  EXPECT_NEAR(glm::angle(middle->rotation()), 0.1, 1e-9);
  EXPECT_DOUBLE_EQ(track.at(1.9)->translation_m().z, 1.0);
  EXPECT_FALSE(track.at(1.8).has_value());
  EXPECT_FALSE(track.at(2.5).has_value());  // A gap of a second.
  EXPECT_FALSE(track.at(3.1).has_value());
}

TEST(TimeOptions, MovePosesAndChooseDepth) {
  const TemporaryFolder folder("tum");
  write_tum(folder.path());
  SequenceOptions options = as_is();
  // Poses are stamped at 102.11, 102.21 and 102.31 with x = 1, 2, 3; pictures at 102.1, ...
  options.times.pose_offset_s = -0.06;
  const auto moved = open_sequence(folder.path(), options);
  ASSERT_EQ(moved->frame_count(), 2U);
  EXPECT_NEAR(moved->pose(0).translation_m().x, 1.5, 1e-5);
  EXPECT_NEAR(moved->pose(1).translation_m().x, 2.5, 1e-5);
  EXPECT_NEAR(moved->pose_track().at(1305031102.16)->translation_m().x, 1.5, 1e-5);
  // Depth is stamped 0.015 s after colour, seen from 0.15 m farther along x: at 1.5 m and
  // f = 20 px that is 2 px.
  options.times.depth_offset_s = 0.0;
  const auto shifted = open_sequence(folder.path(), options);
  EXPECT_THAT(shifted->notes(), Contains(HasSubstr("the camera's motion is allowed for")));
  const RgbdFrame frame = shifted->load(0);
  EXPECT_TRUE(std::isnan(frame.depth_m(0, 5)) && std::isnan(frame.depth_m(1, 5)));
  EXPECT_FLOAT_EQ(frame.depth_m(3, 5), 1.5F);
  options.times.depth_offset_s = 5.0;
  EXPECT_THAT(open_error(folder.path(), options), HasSubstr("milliseconds?"));
}

TEST(TimeOptions, NeedTimes) {
  const TemporaryFolder folder("hololens");
  write_hololens(folder.path());
  SequenceOptions options = as_is();
  options.times.depth_offset_s = 0.01;
  EXPECT_THAT(open_error(folder.path(), options), HasSubstr("--frame-rate HZ"));
  options.times.frame_rate_hz = 10.0;
  const auto sequence = open_sequence(folder.path(), options);
  // Frames 3, 4 and 7, and none after the last: its depth is of a time without pose.
  EXPECT_EQ(sequence->frame_count(), 2U);
  EXPECT_DOUBLE_EQ(*sequence->time_s(1), 0.4);
  const TemporaryFolder timed("tum");
  write_tum(timed.path());
  EXPECT_THAT(open_error(timed.path(), options), HasSubstr("--frame-rate"));
  fs::rename(folder.path() / "rgb/00003.png", folder.path() / "rgb/first.png");
  fs::rename(folder.path() / "depth/00003.png", folder.path() / "depth/first.png");
  EXPECT_THAT(open_error(folder.path(), options), HasSubstr("number in their names"));
}

TEST(DepthSensors, KnowTheirErrors) {
  // The papers' formulas at 1 and 3 m.
  EXPECT_NEAR(depth_sigma_m(DepthSensor::kKinectV1, 1.0F), 0.0012 + 0.0019 * 0.36, 1e-6);
  EXPECT_NEAR(depth_sigma_m(DepthSensor::kTof, 3.0F), 0.0015 - 0.0015 + 0.0027, 1e-6);
  EXPECT_NEAR(depth_sigma_m(DepthSensor::kStereo, 3.0F), 0.0342, 1e-6);
  for (const char* word : {"generic", "kinect-v1", "tof", "stereo", "hololens"}) {
    const DepthSensor sensor = parse_depth_sensor(word, "--sensor");
    EXPECT_EQ(words_of(sensor), word);
    EXPECT_FLOAT_EQ(depth_weight(sensor, 1.0F), 1.0F);
    EXPECT_LT(depth_weight(sensor, 4.0F), depth_weight(sensor, 2.0F));
    EXPECT_GT(depth_weight(sensor, 20.0F), 0.0F);
  }
  EXPECT_THAT(tests::input_error_of([] { (void)parse_depth_sensor("lidar", "--sensor"); }),
              AllOf(HasSubstr("--sensor"), HasSubstr("kinect-v1"), HasSubstr("lidar")));
}

TEST(FlyingPixels, GoAndSurfacesStay) {
  const core::CameraIntrinsics camera = wide_camera(160, 120);
  const RayRoom room = living_room();
  int mixed = 0, erased = 0, mixed_erased = 0, pixels = 0;
  for (std::size_t view = 0; view < 12; ++view) {
    // Every pixel is the mean of the light of four: at contours, a depth between.
    const core::Image<float> fine_m =
        exact_depth(room, room.cameras[view], wide_camera(320, 240));
    core::Image<float> depth_m(160, 120);
    core::Image<std::uint8_t> is_mixed(160, 120, 0);
    for (int y = 0; y < 120; ++y) {
      for (int x = 0; x < 160; ++x) {
        float sum = 0.0F, low = 1e9F, high = 0.0F;
        for (int k = 0; k < 4; ++k) {
          const float z = fine_m(2 * x + k % 2, 2 * y + k / 2);
          sum += z, low = std::min(low, z), high = std::max(high, z);
        }
        depth_m(x, y) = 0.25F * sum;
        is_mixed(x, y) = high - low > 0.25F * low ? 1 : 0;
      }
    }
    remove_flying_pixels(DepthSensor::kTof, camera, depth_m);
    for (int y = 1; y < 119; ++y) {
      for (int x = 1; x < 159; ++x) {
        const bool gone = std::isnan(depth_m(x, y));
        ++pixels, mixed += is_mixed(x, y), erased += gone ? 1 : 0;
        mixed_erased += gone ? is_mixed(x, y) : 0;
      }
    }
  }
  EXPECT_GT(mixed, 500);
  EXPECT_GT(mixed_erased, 0.9 * mixed);
  EXPECT_LT(erased - mixed_erased, 0.004 * pixels);
}

}  // namespace
}  // namespace segsim::reconstruction
