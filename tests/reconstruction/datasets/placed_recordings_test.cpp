// A room recorded in every layout, in frames that are turned at random: the same scene comes
// out, upright and with its floor at z = 0.

#include <array>
#include <cstdio>
#include <functional>

#include <gmock/gmock.h>
#include <glm/gtc/quaternion.hpp>

#include "tests/reconstruction/ray_room.h"
#include "tests/reconstruction/tiny_datasets.h"

namespace segsim::reconstruction {
namespace {

using namespace testing;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr int kRoomWidth = 64, kRoomHeight = 48;
constexpr double kDegree = std::numbers::pi / 180.0;

/// Integer pixel centres lie half a pixel off.
core::CameraIntrinsics room_camera() {
  return {kRoomWidth, kRoomHeight, 50.0, 50.0, 32.0, 24.0};
}
const char* const kIntegerMatrix = "50 0 31.5 0\n0 50 23.5 0\n0 0 1 0\n0 0 0 1\n";

/// One recording of a room: poses in the recording's frame, depth as drawn.
struct Recorded {
  std::vector<core::CameraPose> poses;
  std::vector<core::Image<float>> depths_m;
};

/// p_source = R p_room + t.
Recorded record(const RayRoom& room, const glm::dquat& R, const glm::dvec3& t_m) {
  core::RandomStream random(3, "depth noise");
  Recorded recorded;
  for (const core::CameraPose& pose : room.cameras) {
    recorded.depths_m.push_back(draw_depth(room, pose, room_camera(), random));
    recorded.poses.emplace_back(R * pose.rotation(), R * pose.translation_m() + t_m);
  }
  return recorded;
}

void write_room_depth(const fs::path& file, const core::Image<float>& depth_m,
                      double per_metre = 1000.0) {
  fs::create_directories(file.parent_path());
  cv::Mat image(depth_m.height_px(), depth_m.width_px(), CV_16UC1, cv::Scalar(0));
  for (int y = 0; y < depth_m.height_px(); ++y) {
    for (int x = 0; x < depth_m.width_px(); ++x) {
      if (!(depth_m(x, y) > 0.0F)) continue;
      image.at<std::uint16_t>(y, x) =
          static_cast<std::uint16_t>(std::lround(per_metre * depth_m(x, y)));
    }
  }
  cv::imwrite(file.string(), image);
}

void write_room_rgb(const fs::path& file) { write_rgb(file, kRoomWidth, kRoomHeight); }

/// Row-major 3x4 or 4x4; `opengl`: camera axes of OpenGL.
std::string matrix_text(const core::CameraPose& pose, const char* between_rows,
                        const char* between = " ", bool opengl = false) {
  const glm::dmat3 R(glm::mat3_cast(pose.rotation()));
  std::string text;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      double value = row == 3 ? (column == 3 ? 1.0 : 0.0)
                              : (column == 3 ? pose.translation_m()[row] : R[column][row]);
      if (opengl && row < 3 && (column == 1 || column == 2)) value = -value;
      char number[40];
      std::snprintf(number, sizeof number, "%.12f", value);
      text += number + std::string(column < 3 ? between : row < 3 ? between_rows : "");
    }
  }
  return text;
}

std::string index_name(std::size_t i, std::size_t digits) {
  const std::string number = std::to_string(i);
  return std::string(digits - number.size(), '0') + number;
}

void write_as_hololens(const fs::path& folder, const Recorded& recorded) {
  std::string poses;
  for (std::size_t i = 0; i < recorded.poses.size(); ++i) {
    const std::string name = index_name(i, 5) + ".png";
    write_room_rgb(folder / "rgb" / name);
    write_room_depth(folder / "depth" / name, recorded.depths_m[i]);
    poses += matrix_text(recorded.poses[i], " ") + "\n";
  }
  write_file(folder / "poses.txt", poses);
  write_file(folder / "K.txt", "50 0 31.5\n0 50 23.5\n0 0 1\n");
}

void write_as_seven_scenes(const fs::path& folder, const Recorded& recorded) {
  for (std::size_t i = 0; i < recorded.poses.size(); ++i) {
    const std::string stem = (folder / ("frame-" + index_name(i, 6))).string();
    write_room_rgb(stem + ".color.png");
    write_room_depth(stem + ".depth.png", recorded.depths_m[i]);
    write_file(stem + ".pose.txt", matrix_text(recorded.poses[i], "\n") + "\n");
  }
  write_file(folder / "intrinsics.txt", kIntegerMatrix);
}

void write_as_scannet(const fs::path& folder, const Recorded& recorded) {
  for (std::size_t i = 0; i < recorded.poses.size(); ++i) {
    const std::string name = std::to_string(i);
    write_room_rgb(folder / "color" / (name + ".jpg"));
    write_room_depth(folder / "depth" / (name + ".png"), recorded.depths_m[i]);
    write_file(folder / "pose" / (name + ".txt"), matrix_text(recorded.poses[i], "\n") + "\n");
  }
  write_file(folder / "intrinsic/intrinsic_color.txt", kIntegerMatrix);
  write_file(folder / "intrinsic/intrinsic_depth.txt", kIntegerMatrix);
}

void write_as_replica(const fs::path& folder, const Recorded& recorded) {
  std::string poses;
  for (std::size_t i = 0; i < recorded.poses.size(); ++i) {
    write_room_rgb(folder / "rgb" / ("rgb_" + std::to_string(i) + ".png"));
    write_room_depth(folder / "depth" / ("depth_" + std::to_string(i) + ".png"),
                     recorded.depths_m[i]);
    poses += matrix_text(recorded.poses[i], " ") + "\n";
  }
  write_file(folder / "traj_w_c.txt", poses);
  write_file(folder / "intrinsics.txt", kIntegerMatrix);
}

void write_as_tum(const fs::path& folder, const Recorded& recorded) {
  std::string rgb, depth, poses;
  for (std::size_t i = 0; i < recorded.poses.size(); ++i) {
    const std::string time = std::to_string(100.0 + 0.1 * static_cast<double>(i));
    write_room_rgb(folder / "rgb" / (time + ".png"));
    write_room_depth(folder / "depth" / (time + ".png"), recorded.depths_m[i], 5000.0);
    rgb += time + " rgb/" + time + ".png\n";
    depth += time + " depth/" + time + ".png\n";
    const glm::dquat& q = recorded.poses[i].rotation();
    const glm::dvec3& t = recorded.poses[i].translation_m();
    char line[256];
    std::snprintf(line, sizeof line, "%s %.12f %.12f %.12f %.12f %.12f %.12f %.12f\n",
                  time.c_str(), t.x, t.y, t.z, q.x, q.y, q.z, q.w);
    poses += line;
  }
  write_file(folder / "rgb.txt", rgb);
  write_file(folder / "depth.txt", depth);
  write_file(folder / "groundtruth.txt", poses);
  write_file(folder / "intrinsics.txt", "50 50 31.5 23.5\n");
}

void write_as_nerfstudio(const fs::path& folder, const Recorded& recorded) {
  std::string frames;
  for (std::size_t i = 0; i < recorded.poses.size(); ++i) {
    const std::string name = index_name(i, 3) + ".png";
    write_room_rgb(folder / "images" / name);
    write_room_depth(folder / "depth" / name, recorded.depths_m[i]);
    frames += std::string(i == 0 ? "" : ",\n") + "{\"file_path\": \"images/" + name +
              "\", \"depth_file_path\": \"depth/" + name + "\", \"transform_matrix\": [[" +
              matrix_text(recorded.poses[i], "], [", ", ", true) + "]]}";
  }
  write_file(folder / "transforms.json",
             "{\"w\": 64, \"h\": 48, \"fl_x\": 50, \"fl_y\": 50, \"cx\": 32, \"cy\": 24,\n"
             "\"frames\": [" +
                 frames + "]}");
}

/// Model and depth of COLMAP: world-to-camera poses.
void write_model(const fs::path& model, const fs::path& images, const fs::path& depths,
                 const Recorded& recorded) {
  std::string lines;
  for (std::size_t i = 0; i < recorded.poses.size(); ++i) {
    const std::string name = index_name(i, 4) + ".png";
    write_room_rgb(images / name);
    write_room_depth(depths / name, recorded.depths_m[i]);
    const auto T_camera_world = recorded.poses[i].inverse();
    const glm::dquat& q = T_camera_world.rotation();
    const glm::dvec3& t = T_camera_world.translation_m();
    char line[256];
    std::snprintf(line, sizeof line, "%zu %.12f %.12f %.12f %.12f %.12f %.12f %.12f 1 %s\n\n",
                  i + 1, q.w, q.x, q.y, q.z, t.x, t.y, t.z, name.c_str());
    lines += line;
  }
  write_colmap_text(model, "1 PINHOLE 64 48 50 50 32 24\n", lines);
}

void write_as_colmap(const fs::path& folder, const Recorded& recorded) {
  write_model(folder / "sparse/0", folder / "images", folder / "depth", recorded);
}

void write_as_scannetpp(const fs::path& folder, const Recorded& recorded) {
  const fs::path phone = folder / "iphone";
  write_model(phone / "colmap", phone / "rgb", phone / "depth", recorded);
}

struct Layout {
  const char* name;
  SequenceLayout layout;
  void (*write)(const fs::path&, const Recorded&);
  glm::dvec3 habit;  ///< What is up if nothing says otherwise.
};

const std::array<Layout, 8> kLayouts{
    {{"hololens", SequenceLayout::kHololens, write_as_hololens, {0, 1, 0}},
     {"7scenes", SequenceLayout::kSevenScenes, write_as_seven_scenes, {0, 0, 1}},
     {"scannet", SequenceLayout::kScanNet, write_as_scannet, {0, 0, 1}},
     {"scannetpp", SequenceLayout::kScanNetPlusPlus, write_as_scannetpp, {0, 0, 1}},
     {"replica", SequenceLayout::kReplica, write_as_replica, {0, 0, 1}},
     {"tum", SequenceLayout::kTum, write_as_tum, {0, 0, 1}},
     {"nerfstudio", SequenceLayout::kNerfstudio, write_as_nerfstudio, {0, 0, 1}},
     {"colmap", SequenceLayout::kColmap, write_as_colmap, {0, 0, 1}}}};

/// Turns room coordinates so that their z becomes `up`.
glm::dquat turn_to(const glm::dvec3& up) {
  return up.y == 1.0 ? glm::angleAxis(-0.5 * std::numbers::pi, glm::dvec3(1, 0, 0))
                     : glm::dquat(1, 0, 0, 0);
}

/// Where the room's up and floor end in the world of the sequence.
struct Placed {
  double tilt_deg = 0.0, floor_m = 0.0;
};

Placed placed(const RgbdSequence& sequence, const glm::dquat& R, const glm::dvec3& t_m) {
  const auto world = [&](const glm::dvec3& p_room_m) {
    return (sequence.T_world_source() * core::Point<core::frame::World>{R * p_room_m + t_m})
        .xyz_m;
  };
  const glm::dvec3 up = world({2.5, 2.0, 1.0}) - world({2.5, 2.0, 0.0});
  return {std::atan2(std::hypot(up.x, up.y), up.z) / kDegree, world({2.5, 2.0, 0.0}).z};
}

class PlacedRecordings : public ::testing::TestWithParam<Layout> {};

TEST_P(PlacedRecordings, TurnedAtRandomGiveTheSameScene) {
  const Layout& layout = GetParam();
  core::RandomStream random(11, layout.name);
  const RayRoom room = living_room();
  std::optional<core::CameraPose> first;
  for (int turn = 0; turn < 2; ++turn) {
    const glm::dquat R = glm::normalize(
        glm::dquat(random.normal(), random.normal(), random.normal(), random.normal()));
    const TemporaryFolder folder("turned");
    layout.write(folder.path(), record(room, R, {0, 0, 0}));
    SequenceOptions options;
    options.layout = layout.layout;
    const auto sequence = open_sequence(folder.path(), options);
    ASSERT_EQ(sequence->frame_count(), room.cameras.size());
    const Placed found = placed(*sequence, R, {0, 0, 0});
    EXPECT_LT(found.tilt_deg, 0.3);
    EXPECT_NEAR(found.floor_m, 0.0, 0.02);
    EXPECT_THAT(sequence->warnings(), IsEmpty());
    EXPECT_THAT(sequence->notes(), Contains(AllOf(HasSubstr("by evidence"), HasSubstr("m2"))));
    ASSERT_NE(sequence->placement(), nullptr);
    EXPECT_EQ(sequence->placement()->up_source, UpSource::kEvidence);
    // Not only upright: each camera is where it was, whatever the frame.
    const core::CameraPose& last = sequence->pose(sequence->frame_count() - 1);
    if (first) {
      EXPECT_LT(glm::distance(first->translation_m(), last.translation_m()), 0.02);
      EXPECT_GT(std::abs(glm::dot(first->rotation(), last.rotation())),
                std::cos(0.5 * 0.3 * kDegree));
    }
    first = last;
  }
}

TEST_P(PlacedRecordings, AnUprightOneKeepsItsAxes) {
  const Layout& layout = GetParam();
  const TemporaryFolder folder("upright");
  // As much off as a headset's own sense of gravity.
  const glm::dquat R =
      turn_to(layout.habit) * glm::angleAxis(0.4 * kDegree, glm::dvec3(1, 0, 0));
  const glm::dvec3 t_m = -1.3 * layout.habit;
  layout.write(folder.path(), record(living_room(), R, t_m));
  SequenceOptions options;
  options.layout = layout.layout;
  const auto sequence = open_sequence(folder.path(), options);
  EXPECT_EQ(sequence->placement()->up_source, UpSource::kLayout);
  EXPECT_EQ(sequence->placement()->up, layout.habit);
  EXPECT_NEAR(placed(*sequence, R, t_m).floor_m, 0.0, 0.03);
  options.up_axis = layout.habit.y == 1.0 ? UpAxis::kY : UpAxis::kZ;
  const auto given = open_sequence(folder.path(), options);
  EXPECT_EQ(given->T_world_source().rotation(), sequence->T_world_source().rotation());
  EXPECT_EQ(given->T_world_source().translation_m(),
            sequence->T_world_source().translation_m());
}

INSTANTIATE_TEST_SUITE_P(Layouts, PlacedRecordings, ::testing::ValuesIn(kLayouts),
                         [](const auto& layout) {
                           return layout.param.name[0] == '7' ? std::string("sevenscenes")
                                                              : std::string(layout.param.name);
                         });

/// A tilt that a layout's axis cannot express, and its way back by hand.
TEST(PlacedByHand, GravityAndFloorHeight) {
  const glm::dvec3 down = glm::normalize(glm::dvec3(-0.01, 0.90, 0.43));
  const glm::dvec3 axis = glm::normalize(glm::cross(glm::dvec3(0, 0, -1), down));
  const glm::dquat R = glm::angleAxis(std::acos(-down.z), axis);
  const glm::dvec3 t_m(0.3, -0.2, 0.9);
  const TemporaryFolder folder("by_hand");
  write_as_seven_scenes(folder.path(), record(living_room(), R, t_m));
  const auto found = open_sequence(folder.path());
  EXPECT_LT(placed(*found, R, t_m).tilt_deg, 0.3);
  EXPECT_NEAR(placed(*found, R, t_m).floor_m, 0.0, 0.02);

  SequenceOptions options;
  options.gravity = 9.81 * down;
  options.floor_height_m = -glm::dot(down, t_m);
  const auto given = open_sequence(folder.path(), options);
  EXPECT_LT(placed(*given, R, t_m).tilt_deg, 1e-6);
  EXPECT_NEAR(placed(*given, R, t_m).floor_m, 0.0, 1e-9);
  EXPECT_TRUE(given->placement()->elements.empty());  // Nothing had to be found out.
  EXPECT_THAT(given->notes(),
              Contains(AllOf(HasSubstr("is up (given)"), HasSubstr("m (given)"))));
  // Both ways lead to the same axes.
  EXPECT_LT(glm::distance(given->pose(5).translation_m(), found->pose(5).translation_m()),
            0.03);

  options.floor_height_m.reset();  // The floor is found along the direction that was given.
  const auto fitted = open_sequence(folder.path(), options);
  EXPECT_NEAR(placed(*fitted, R, t_m).floor_m, 0.0, 0.02);
}

TEST(PlacedByHand, AFloorThatWasNotSeenIsAGuess) {
  const TemporaryFolder folder("no_floor");
  const glm::dquat R = glm::angleAxis(1.0, glm::normalize(glm::dvec3(1, 2, 3)));
  write_as_seven_scenes(folder.path(), record(living_room({.floor = false}), R, {0, 0, 0}));
  const auto sequence = open_sequence(folder.path());
  EXPECT_EQ(sequence->placement()->floor_source, FloorSource::kGuessed);
  EXPECT_NEAR(placed(*sequence, R, {0, 0, 0}).floor_m, 0.0, 0.08);
  EXPECT_THAT(sequence->warnings(),
              Contains(AllOf(HasSubstr("guessed"), HasSubstr("--floor-height"))));
  EXPECT_THAT(sequence->notes(), Contains(HasSubstr("guessed")));
}

TEST(PlacedByHand, CamerasOnTheirSidesAreADoubtNotADecision) {
  RayRoom room = living_room();
  for (core::CameraPose& pose : room.cameras) {
    pose = {pose.rotation() * glm::angleAxis(0.5 * std::numbers::pi, glm::dvec3(0, 0, 1)),
            pose.translation_m()};
  }
  const TemporaryFolder folder("portrait");
  write_as_seven_scenes(folder.path(), record(room, {1, 0, 0, 0}, {0, 0, 0}));
  const auto sequence = open_sequence(folder.path());
  EXPECT_EQ(sequence->placement()->up_source, UpSource::kLayout);
  EXPECT_NEAR(placed(*sequence, {1, 0, 0, 0}, {0, 0, 0}).floor_m, 0.0, 0.03);
}

TEST(PlacedByHand, WithoutDepthCamerasAloneRaiseADoubt) {
  const TemporaryFolder folder("colour");
  const glm::dquat R = glm::angleAxis(1.0, glm::normalize(glm::dvec3(1, 2, 0)));
  write_as_colmap(folder.path(), record(living_room(), R, {0, 0, 0}));
  fs::remove_all(folder.path() / "depth");
  const auto sequence = open_sequence(folder.path());
  EXPECT_EQ(sequence->placement()->up_source, UpSource::kLayout);
  EXPECT_THAT(sequence->warnings(),
              Contains(AllOf(HasSubstr("57 deg"), HasSubstr("--gravity"))));
}

TEST(PlacedByHand, GravityWithoutADirectionIsRefused) {
  const TemporaryFolder folder("zero");
  write_seven_scenes(folder.path(), false);
  SequenceOptions options;
  options.gravity = glm::dvec3(0.0);
  EXPECT_THAT(open_error(folder.path(), options), HasSubstr("--gravity"));
  options.gravity = glm::dvec3(0.0, 0.0, -1.0);
  options.up_axis = UpAxis::kY;
  EXPECT_THAT(open_error(folder.path(), options),
              AllOf(HasSubstr("--gravity"), HasSubstr("--up")));
}

}  // namespace
}  // namespace segsim::reconstruction
