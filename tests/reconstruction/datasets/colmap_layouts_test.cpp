// COLMAP models, text and binary, ScanNet++ folders, and lenses.

#include <cmath>
#include <cstring>
#include <fstream>

#include <gmock/gmock.h>

#include "reconstruction/datasets/internal/lens.h"
#include "tests/reconstruction/tiny_datasets.h"

namespace segsim::reconstruction {
namespace {

using namespace testing;
using internal::Lens;
using internal::LensModel;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

void expect_position(const core::CameraPose& pose, double x) {
  EXPECT_NEAR(pose.translation_m().x, x, 1e-9);
  EXPECT_NEAR(pose.translation_m().y, 2.0, 1e-9);
  EXPECT_NEAR(pose.translation_m().z, 3.0, 1e-9);
}

/// Little-endian values after one another.
class BinaryWriter {
 public:
  template <class Value>
  BinaryWriter& add(Value value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  BinaryWriter& add_text(const std::string& text) {
    bytes_.append(text.c_str(), text.size() + 1);
    return *this;
  }
  void save(const fs::path& file, std::size_t cut = 0) const {
    std::ofstream(file, std::ios::binary) << bytes_.substr(0, bytes_.size() - cut);
  }

 private:
  std::string bytes_;
};

TEST(Colmap, ReadsTextModels) {
  const TemporaryFolder folder("colmap");
  write_colmap(folder.path());
  const auto sequence = open_sequence(folder.path(), as_is());
  ASSERT_EQ(sequence->frame_count(), 2U);
  EXPECT_EQ(sequence->frame_name(0), "a");
  EXPECT_EQ(sequence->frame_name(1), "b c");
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cx_px, 8.25);
  expect_position(sequence->pose(0), 1.0);
  expect_position(sequence->pose(1), 2.0);
  EXPECT_FALSE(sequence->has_depth());
}

TEST(Colmap, SparsePointsBelongToTheImagesThatSawThem) {
  const TemporaryFolder folder("colmap");
  write_colmap(folder.path());
  EXPECT_THAT(open_sequence(folder.path(), as_is())->seen_points_m(0), IsEmpty());
  const fs::path model = folder.path() / "sparse/0";
  const auto expect_points = [&] {
    SequenceOptions options = as_is();
    options.pose_scale = 2.0;
    const auto sequence = open_sequence(folder.path(), options);
    ASSERT_THAT(sequence->seen_points_m(0), SizeIs(2));
    ASSERT_THAT(sequence->seen_points_m(1), SizeIs(1));
    EXPECT_EQ(sequence->seen_points_m(0)[0], glm::dvec3(2.0, 4.0, 10.0));
    EXPECT_EQ(sequence->seen_points_m(0)[1], glm::dvec3(2.0, 4.0, 12.0));
    EXPECT_EQ(sequence->seen_points_m(1)[0], glm::dvec3(2.0, 4.0, 12.0));
  };
  write_text(model / "points3D.txt",
             "# a comment\n1 1 2 5 255 0 0 0.5 9 0 9 3\n2 1 2 6 0 0 0 1.5 7 0 9 1\n"
             "3 1 2 7 0 0 0 2.5 9 2 7 2\n");  // The last one fits badly.
  expect_points();
  write_text(model / "points3D.txt", "7 1 2 nan 255 0 0 0.5 1 0\n");
  EXPECT_THAT(open_error(folder.path(), as_is()),
              AllOf(HasSubstr("points3D.txt:1"), HasSubstr("finite")));
  write_text(model / "points3D.txt", "7 1 2\n");
  EXPECT_THAT(open_error(folder.path(), as_is()), HasSubstr("points3D.txt:1"));
}

TEST(Colmap, InvertsWorldToCamera) {
  const TemporaryFolder folder("colmap");
  write_colmap(folder.path());
  // R_camera_world turns a quarter about z; scalar first. C = -R^T t.
  write_text(folder.path() / "sparse/0/images.txt",
             "1 0.70710678118654752 0 0 0.70710678118654752 2 -1 -3 1 a.png\n\n"
             "2 1 0 0 0 -2 -2 -3 1 b c.png\n\n");
  const auto sequence = open_sequence(folder.path(), as_is());
  expect_position(sequence->pose(0), 1.0);
  // The camera's x axis in the world is the first row of R_camera_world: (0, -1, 0).
  EXPECT_NEAR((sequence->pose(0).rotation() * glm::dvec3(1, 0, 0)).y, -1.0, 1e-12);
  expect_position(sequence->pose(1), 2.0);  // An image without points has an empty line.
}

TEST(Colmap, ReadsBinaryModels) {
  const TemporaryFolder folder("colmap");
  write_colmap(folder.path());
  const fs::path model = folder.path() / "sparse/0";
  fs::remove(model / "cameras.txt");
  BinaryWriter cameras, images;
  cameras.add(std::uint64_t{1}).add(std::int32_t{5}).add(std::int32_t{1});
  cameras.add(std::uint64_t{16}).add(std::uint64_t{12});
  for (const double value : {20.0, 21.0, 8.25, 6.0}) cameras.add(value);
  images.add(std::uint64_t{2});
  for (const int i : {0, 1}) {
    images.add(std::int32_t{40 + i});
    for (const double value : {1.0, 0.0, 0.0, 0.0, -1.0 - i, -2.0, -3.0}) images.add(value);
    images.add(std::int32_t{5}).add_text(i == 0 ? "a.png" : "b c.png");
    images.add(std::uint64_t(i));  // 2-D points.
    if (i == 1) images.add(1.0).add(2.0).add(std::int64_t{-1});
  }
  cameras.save(model / "cameras.bin");
  images.save(model / "images.bin");
  const auto sequence = open_sequence(folder.path(), as_is());
  ASSERT_EQ(sequence->frame_count(), 2U);
  EXPECT_DOUBLE_EQ(sequence->intrinsics().fy_px, 21.0);
  expect_position(sequence->pose(1), 2.0);

  BinaryWriter points;
  points.add(std::uint64_t{1}).add(std::uint64_t{77});
  for (const double value : {1.0, 2.0, 5.0}) points.add(value);
  points.add(std::uint8_t{9}).add(std::uint8_t{9}).add(std::uint8_t{9}).add(0.5);
  points.add(std::uint64_t{1}).add(std::uint32_t{41}).add(std::uint32_t{0});
  points.save(model / "points3D.bin");
  EXPECT_THAT(open_sequence(folder.path(), as_is())->seen_points_m(0), IsEmpty());
  EXPECT_THAT(open_sequence(folder.path(), as_is())->seen_points_m(1),
              ElementsAre(glm::dvec3(1.0, 2.0, 5.0)));
  points.save(model / "points3D.bin", 1);
  EXPECT_THAT(open_error(folder.path(), as_is()),
              AllOf(HasSubstr("points3D.bin"), HasSubstr("end of the file")));
  fs::remove(model / "points3D.bin");

  images.save(model / "images.bin", 1);
  EXPECT_THAT(open_error(folder.path(), as_is()),
              AllOf(HasSubstr("images.bin"), HasSubstr("end of the file")));
  cameras.save(model / "cameras.bin", 9);
  EXPECT_THAT(open_error(folder.path(), as_is()), HasSubstr("cameras.bin"));
}

TEST(Colmap, ReadsDepthAndMasksBesideTheImages) {
  const TemporaryFolder folder("colmap");
  write_colmap(folder.path());
  for (const char* name : {"a.png", "b c.png"}) {
    write_depth(folder.path() / "depth" / name, 2500);
    write_ids(folder.path() / "masks" / name, 0, 255, CV_8UC1);
  }
  const auto sequence = open_sequence(folder.path(), as_is());
  EXPECT_TRUE(sequence->has_depth());
  const RgbdFrame frame = sequence->load(1);
  EXPECT_FLOAT_EQ(frame.depth_m(12, 3), 2.5F);
  EXPECT_EQ(frame.valid(0, 3), 0);
}

TEST(Colmap, NamesTheLineOfAFault) {
  const std::string cameras = "1 PINHOLE 16 12 20 21 8.25 6\n";
  const std::string images = colmap_image(9, 0, "a.png");
  struct Fault {
    std::string cameras, images, place, message;
  };
  for (const Fault& fault : std::vector<Fault>{
           {"1 FISHY 16 12 20\n", images, "cameras.txt:2", "'FISHY'"},
           {"1 PINHOLE 16 12 20 21 8\n", images, "cameras.txt:2", "4 parameters"},
           {"1 PINHOLE 16 12 20 21 8 x\n", images, "cameras.txt:2", "'x'"},
           {"1 PINHOLE 16 12 -20 21 8 6\n", images, "cameras.txt:2", "> 0"},
           {cameras, colmap_image(9, 0, "a.png", 4), "images.txt:2", "camera 4"},
           {cameras, "1 2 0 0 0 1 2 3 1 a.png\n\n", "images.txt:2", "unit quaternion"},
           {cameras, "1 1 0 0 0 1 2 3 1\n\n", "images.txt:2", "9 words"},
           {"1 PINHOLE 1e30 12 20 21 8 6\n", images, "cameras.txt:2", "found '1e30'"},
           {cameras, "-7 1 0 0 0 1 2 3 1 a.png\n\n", "images.txt:2", "found '-7'"},
           {cameras, "1 1 0 0 0 1 2 3 1.5 a.png\n\n", "images.txt:2", "found '1.5'"},
           {cameras, "", "sparse/0", "at least one image"},
           {cameras + "2 PINHOLE 16 12 30 21 8.25 6\n",
            images + colmap_image(8, 1, "b c.png", 2), "images.txt:4", "one for all"}}) {
    const TemporaryFolder folder("colmap");
    write_colmap(folder.path());
    write_colmap_text(folder.path() / "sparse/0", fault.cameras, fault.images);
    EXPECT_THAT(open_error(folder.path(), as_is()),
                AllOf(HasSubstr(fault.place), HasSubstr(fault.message)));
  }
}

// ---- ScanNet++

/// Two undistorted DSLR images; the model has a fisheye camera.
void write_scannetpp(const fs::path& scene) {
  const fs::path dslr = scene / "dslr";
  write_colmap_text(dslr / "colmap", "1 OPENCV_FISHEYE 16 12 8 8 8 6 0.05 -0.01 0 0\n",
                    colmap_image(1, 0, "DSC1.JPG") + colmap_image(2, 1, "DSC2.JPG"));
  for (const char* name : {"DSC1", "DSC2"}) {
    write_rgb(dslr / "resized_undistorted_images" / (std::string(name) + ".JPG"));
    write_rgb(dslr / "resized_images" / (std::string(name) + ".JPG"));
    write_ids(dslr / "resized_undistorted_masks" / (std::string(name) + ".png"), 0, 255,
              CV_8UC1);
  }
  write_file(
      dslr / "nerfstudio/transforms_undistorted.json",
      R"({"w": 16, "h": 12, "fl_x": 9.5, "fl_y": 9.5, "cx": 8, "cy": 6, "frames": []})");
}

TEST(ScanNetPlusPlus, PrefersUndistortedImagesAndColmapPoses) {
  const TemporaryFolder scene("5748ce6f01");
  write_scannetpp(scene.path());
  const auto sequence = open_sequence(scene.path(), as_is());
  ASSERT_EQ(sequence->frame_count(), 2U);
  EXPECT_EQ(sequence->frame_name(0), "DSC1");
  EXPECT_DOUBLE_EQ(sequence->intrinsics().fx_px, 9.5);
  expect_position(sequence->pose(1), 2.0);
  EXPECT_FALSE(sequence->has_depth());
  EXPECT_EQ(sequence->load(0).valid(15, 3), 255);
}

TEST(ScanNetPlusPlus, StraightensFisheyeImages) {
  const TemporaryFolder scene("scannetpp");
  write_scannetpp(scene.path());
  fs::remove_all(scene.path() / "dslr/resized_undistorted_images");
  const auto sequence = open_sequence(scene.path(), as_is());
  EXPECT_THAT(sequence->notes(), Contains(HasSubstr("straightened")));
  // The middle of the upper border decides: f theta_d(atan(6 / f')) = 6 px.
  const double fx_px = sequence->intrinsics().fx_px, theta = std::atan(6.0 / fx_px);
  EXPECT_NEAR(8.0 * theta * (1 + 0.05 * std::pow(theta, 2) - 0.01 * std::pow(theta, 4)), 6.0,
              1e-6);
  EXPECT_EQ(sequence->load(0).rgb.width_px(), 16);
}

TEST(ScanNetPlusPlus, ReadsRenderedDepthAndLabelsAndSkipsBadFrames) {
  const TemporaryFolder scene("scannetpp");
  write_scannetpp(scene.path());
  const fs::path dslr = scene.path() / "dslr";
  for (const char* name : {"DSC1.png", "DSC2.png"}) {
    write_depth(dslr / "render_depth" / name, 1250);
    write_ids(dslr / "semantic" / name, 1, 2);
    write_ids(dslr / "instance" / name, 20000, 12);
  }
  write_file(dslr / "nerfstudio/transforms.json",
             R"({"frames": [{"file_path": "DSC1.JPG", "is_bad": true}],
                 "test_frames": [{"file_path": "DSC2.JPG", "is_bad": false}]})");
  EXPECT_FALSE(open_sequence(scene.path(), as_is())->has_masks());  // No table of classes.
  SequenceOptions options = as_is();
  options.label_map = scene.path() / "map.yaml";
  write_text(
      options.label_map,
      "schema: segsim.label_map\nversion: 1\nclasses:\n  - {id: 1, name: blinds, thing: "
      "true}\n  - {id: 2, name: chair, thing: true}\n");
  const auto sequence = open_sequence(scene.path(), options);
  ASSERT_EQ(sequence->frame_count(), 1U);
  EXPECT_EQ(sequence->frame_name(0), "DSC2");
  const RgbdFrame frame = sequence->load(0);
  EXPECT_EQ(frame.semantic(0, 0), 1);
  EXPECT_EQ(frame.instance(0, 0), 0);  // Above 10000: none.
  EXPECT_EQ(frame.instance(15, 0), 12);
  EXPECT_FLOAT_EQ(frame.depth_m(15, 5), 1.25F);
}

TEST(ScanNetPlusPlus, ReadsIphoneDepthOfAnotherSize) {
  const TemporaryFolder scene("iphone");
  const fs::path iphone = scene.path() / "iphone";
  write_colmap_text(iphone / "colmap", "1 PINHOLE 16 12 20 20 8 6\n",
                    colmap_image(1, 0, "frame_000000.jpg"));
  write_rgb(iphone / "rgb/frame_000000.jpg");
  write_depth(iphone / "depth/frame_000000.png", 900, 8, 6);
  const auto sequence = open_sequence(scene.path(), as_is());
  EXPECT_TRUE(sequence->has_depth());
  EXPECT_FLOAT_EQ(sequence->load(0).depth_m(4, 4), 0.9F);
}

// ---- Lenses

TEST(Lens, ProjectsLikeOpenCv) {
  Lens lens;
  lens.model = LensModel::kBrown;
  lens.camera = {640, 480, 500.0, 510.0, 320.0, 240.0};
  lens.k = {0.2624, -0.9531, 1.1633, 0.0};
  lens.p1 = -0.0054, lens.p2 = 0.0026;
  // By hand, from the formula: x = 0.3, y = -0.2, r2 = 0.13.
  const double radial = 1 + 0.2624 * 0.13 - 0.9531 * 0.13 * 0.13 + 1.1633 * 0.13 * 0.13 * 0.13;
  const double x = 0.3 * radial + 2 * -0.0054 * 0.3 * -0.2 + 0.0026 * (0.13 + 0.18);
  const double y = -0.2 * radial + -0.0054 * (0.13 + 0.08) + 2 * 0.0026 * 0.3 * -0.2;
  const glm::dvec2 px = lens.project({0.3, -0.2});
  EXPECT_NEAR(px.x, 500 * x + 320, 1e-9);
  EXPECT_NEAR(px.y, 510 * y + 240, 1e-9);

  lens.model = LensModel::kFisheye;
  lens.k = {0.1, -0.02, 0.003, -0.0004};
  const double r = std::sqrt(0.13), t = std::atan(r);
  const double bent = t * (1 + 0.1 * std::pow(t, 2) - 0.02 * std::pow(t, 4) +
                           0.003 * std::pow(t, 6) - 0.0004 * std::pow(t, 8));
  EXPECT_NEAR(lens.project({0.3, -0.2}).x, 500 * 0.3 * bent / r + 320, 1e-9);
  EXPECT_NEAR(lens.project({0.0, 0.0}).y, 240.0, 1e-12);
}

TEST(Lens, StraightensWithoutShowingTheOutside) {
  for (const LensModel model : {LensModel::kBrown, LensModel::kFisheye}) {
    Lens lens;
    lens.model = model;
    lens.camera = {64, 48, 30.0, 30.0, 33.0, 23.0};
    lens.k = {-0.1, 0.01, 0.0, 0.0};
    const core::CameraIntrinsics camera = straight_camera(lens);
    double closest = 1e9;
    for (int y = 0; y <= 48; ++y) {
      for (int x = 0; x <= 64; ++x) {
        const glm::dvec3 ray = camera.back_project({x, y}, 1.0);
        const glm::dvec2 px = lens.project({ray.x, ray.y});
        for (const double margin : {px.x, px.y, 64.0 - px.x, 48.0 - px.y}) {
          EXPECT_GE(margin, -0.02);
          closest = std::min(closest, margin);
        }
      }
    }
    EXPECT_LT(closest, 0.02);  // And no narrower than it must be.
  }
}

TEST(Lens, UndistortionPutsPixelsWhereAPinholeSeesThem) {
  Lens lens;
  lens.model = LensModel::kFisheye;
  lens.camera = {200, 160, 90.0, 90.0, 100.0, 80.0};
  lens.k = {0.03, -0.01, 0.0, 0.0};
  const core::CameraIntrinsics camera = straight_camera(lens);
  // A vertical world line x = 0.4 z is straight in the result, bent in the picture.
  core::Image<core::Rgb8> taken(200, 160);
  core::Image<std::uint16_t> ids(200, 160);
  for (double y = -2.0; y < 2.0; y += 0.001) {
    for (double x = 0.36; x < 0.44; x += 0.002) {
      const glm::dvec2 px = lens.project({x, y});
      if (!taken.contains(static_cast<int>(px.x), static_cast<int>(px.y))) continue;
      taken(static_cast<int>(px.x), static_cast<int>(px.y)) = {200, 200, 200};
      ids(static_cast<int>(px.x), static_cast<int>(px.y)) = 9;
    }
  }
  const internal::Undistortion undistortion(lens, camera, 200, 160);
  const auto straight = undistortion.color(taken);
  const auto straight_ids = undistortion.nearest(ids);
  const int column = static_cast<int>(camera.project({0.4, 0.0, 1.0}).x);
  for (int y = 0; y < 160; ++y) {
    EXPECT_EQ(straight(column, y).g, 200) << y;
    EXPECT_EQ(straight_ids(column, y), 9) << y;
    EXPECT_EQ(straight(column - 20, y).g, 0) << y;
  }
}

}  // namespace
}  // namespace segsim::reconstruction
