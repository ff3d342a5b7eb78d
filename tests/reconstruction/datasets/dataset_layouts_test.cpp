// Each public layout on a tiny folder: names, order, units, axes, label maps, and what broken
// folders say.

#include <cmath>
#include <cstring>
#include <fstream>

#include <gmock/gmock.h>

#include "reconstruction/datasets/label_map.h"
#include "tests/reconstruction/tiny_datasets.h"

namespace segsim::reconstruction {
namespace {

using namespace testing;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<std::string> names_of(const RgbdSequence& sequence) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < sequence.frame_count(); ++i) {
    names.push_back(sequence.frame_name(i));
  }
  return names;
}

/// Stands at (x, 2, 3) and looks along the world's +z with x to the right.
void expect_pose(const core::CameraPose& pose, double x) {
  EXPECT_NEAR(pose.translation_m().x, x, 1e-9);
  EXPECT_NEAR(pose.translation_m().y, 2.0, 1e-9);
  EXPECT_NEAR(pose.translation_m().z, 3.0, 1e-9);
  EXPECT_NEAR((pose.rotation() * glm::dvec3(0, 0, 1)).z, 1.0, 1e-9);
  EXPECT_NEAR((pose.rotation() * glm::dvec3(1, 0, 0)).x, 1.0, 1e-9);
}

// ---- ScanNet

TEST(ScanNet, ReadsExportedScansInOrderOfNumbers) {
  const TemporaryFolder root("scannet");
  const fs::path scan = root.path() / "scans/scene0087_02";
  write_scannet(scan);
  write_file(root.path() / "scannetv2-labels.combined.tsv", kScanNetTable);
  const auto sequence = open_sequence(scan, as_is());
  EXPECT_EQ(sequence->name(), "scene0087_02");
  EXPECT_THAT(names_of(*sequence), ElementsAre("2", "10"));  // Not "10", "2"; 9 is lost.
  EXPECT_THAT(sequence->notes(), Contains(HasSubstr("1 frames without tracking")));
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cx_px, 8.0);  // Integer centres: + 0.5.
  expect_pose(sequence->pose(0), 2.0);
  expect_pose(sequence->pose(1), 10.0);
  const RgbdFrame frame = sequence->load(0);
  EXPECT_EQ(frame.depth_m.width_px(), 8);
  EXPECT_TRUE(std::isnan(frame.depth_m(0, 0)));
  EXPECT_FLOAT_EQ(frame.depth_m(3, 3), 1.5F);
}

TEST(ScanNet, MapsRawLabelsToNyu40) {
  const TemporaryFolder root("scannet");
  const fs::path scan = root.path() / "scans/scene0087_02";
  write_scannet(scan);
  write_file(root.path() / "scannetv2-labels.combined.tsv", kScanNetTable);
  const auto sequence = open_sequence(scan, as_is());
  ASSERT_TRUE(sequence->has_masks());
  EXPECT_EQ(sequence->classes().size(), 20U);
  const RgbdFrame frame = sequence->load(0);
  EXPECT_EQ(frame.semantic(0, 0), 1);   // wall
  EXPECT_EQ(frame.instance(0, 0), 0);   // Stuff has no id, though the file gives one.
  EXPECT_EQ(frame.semantic(15, 0), 5);  // armchair -> chair
  EXPECT_EQ(frame.instance(15, 0), 7);  // objectId + 1
  const RgbdFrame other = sequence->load(1);
  EXPECT_EQ(other.semantic(15, 0), 0);  // NYU40 id 40 is not evaluated.
  EXPECT_EQ(other.instance(15, 0), 0);
  ASSERT_EQ(sequence->instances().size(), 1U);
  EXPECT_EQ(sequence->instances()[0].id, 7);
  EXPECT_EQ(sequence->instances()[0].class_id, 5);
}

TEST(ScanNet, TakesASceneTableInstead) {
  const TemporaryFolder scan("scannet");
  write_scannet(scan.path());
  SequenceOptions options = as_is();
  options.label_map = scan.path() / "map.yaml";
  write_text(
      options.label_map,
      "schema: segsim.label_map\nversion: 1\nclasses:\n  - {id: 2, name: chair, thing: "
      "true}\n  - {id: 9, name: dragon, thing: true, evaluated: false}\nids:\n  - {from: "
      "[2, 23], to: 2}\n  - {from: [500], to: 9}\n");
  const auto sequence = open_sequence(scan.path(), options);
  EXPECT_EQ(sequence->load(0).semantic(0, 0), 0);
  EXPECT_EQ(sequence->load(0).semantic(15, 0), 2);
  EXPECT_EQ(sequence->load(1).semantic(15, 0), 9);
}

TEST(ScanNet, LeavesLabelsAloneWithoutATable) {
  const TemporaryFolder scan("scannet");
  write_scannet(scan.path());
  const auto sequence = open_sequence(scan.path(), as_is());
  EXPECT_FALSE(sequence->has_masks());
  EXPECT_THAT(sequence->warnings(), Contains(HasSubstr("no table")));
}

TEST(ScanNet, BringsDepthToTheColourView) {
  const TemporaryFolder scan("scannet");
  write_scannet(scan.path(), false);
  // The depth camera looks one pixel to the side: column x of ours is column x + 1 of its own.
  write_file(scan.path() / "intrinsic/intrinsic_depth.txt",
             "10 0 4.25 0\n0 10.5 2.25 0\n0 0 1 0\n0 0 0 1\n");
  cv::Mat depth(6, 8, CV_16UC1);
  for (int x = 0; x < 8; ++x) depth.col(x).setTo(cv::Scalar(1000 + x));
  cv::imwrite((scan.path() / "depth/2.png").string(), depth);
  const RgbdFrame frame = open_sequence(scan.path(), as_is())->load(0);
  // Ours: cx = 8 / 2 = 4.0; its: 4.25 + 0.5 = 4.75, so 0.75 px further.
  EXPECT_FLOAT_EQ(frame.depth_m(0, 0), 1.001F);
  EXPECT_FLOAT_EQ(frame.depth_m(6, 0), 1.007F);
  EXPECT_TRUE(std::isnan(frame.depth_m(7, 0)));
}

TEST(ScanNet, RefusesWhatIsMissingOrBroken) {
  const TemporaryFolder scan("scannet");
  write_scannet(scan.path());
  SequenceOptions nowhere = as_is(SequenceLayout::kScanNet);
  EXPECT_THAT(open_error(scan.path() / "color", nowhere), HasSubstr("SensReader"));
  write_file(scan.path() / "pose/2.txt", "1 0 0\n");
  EXPECT_THAT(open_error(scan.path(), as_is()), AllOf(HasSubstr("2.txt"), HasSubstr("16")));
  fs::remove(scan.path() / "depth/2.png");
  EXPECT_THAT(open_error(scan.path(), as_is()), HasSubstr("2.png"));
  SequenceOptions skip = as_is();
  skip.on_bad_frame = OnBadFrame::kSkip;
  EXPECT_THAT(names_of(*open_sequence(scan.path(), skip)), ElementsAre("10"));
}

TEST(LabelMap, RefusesBrokenTables) {
  const auto error_of = [](const std::string& name, const std::string& text) {
    const TemporaryFolder folder("table");
    write_text(folder.path() / name, text);
    try {
      (void)(name.ends_with("tsv") ? read_scannet_table(folder.path() / name)
                                   : read_label_map(folder.path() / name));
    } catch (const core::InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_THAT(error_of("a.tsv", "id\tcategory\n1\twall\n"),
              AllOf(HasSubstr("a.tsv:1"), HasSubstr("nyu40id")));
  EXPECT_THAT(error_of("a.tsv", "id\tnyu40id\n1\n"), HasSubstr("a.tsv:2"));
  EXPECT_THAT(error_of("a.tsv", "id\tnyu40id\none\t1\n"),
              AllOf(HasSubstr("a.tsv:2"), HasSubstr("'one'")));
  EXPECT_EQ(error_of("a.tsv", "id\tcategory\tcount\tnyuId\tnyu40id\r\n1\twall\t3\t\t1\r\n"),
            "no error");  // The old table, with DOS line ends.
  const std::string head =
      "schema: segsim.label_map\nversion: 1\nclasses:\n"
      "  - {id: 1, name: floor}\n";
  EXPECT_EQ(error_of("m.yaml", head), "no error");
  EXPECT_THAT(error_of("m.yaml", head + "ids:\n  - {from: [3], to: 2}\n"),
              AllOf(HasSubstr("m.yaml:6"), HasSubstr("class listed")));
  EXPECT_THAT(error_of("m.yaml", head + "ids:\n  - {from: [3, 3], to: 1}\n"),
              HasSubstr("not mapped above"));
  EXPECT_THAT(error_of("m.yaml", head + "colour: red\n"), HasSubstr("colour"));
}

TEST(LabelMap, KnowsWhatIsEvaluated) {
  const TemporaryFolder folder("map");
  write_text(folder.path() / "m.yaml",
             "schema: segsim.label_map\nversion: 1\nclasses:\n  - {id: 1, name: floor}\n"
             "  - {id: 9, name: object, evaluated: false}\n");
  const LabelMap map = read_label_map(folder.path() / "m.yaml");
  EXPECT_EQ(map.class_of(9), 9);  // The identity.
  EXPECT_EQ(map.class_of(8), 0);
  ASSERT_EQ(map.evaluated().size(), 1U);
  EXPECT_EQ(map.evaluated()[0].name, "floor");
}

// ---- Replica

TEST(Replica, ReadsSemanticNerfRenderings) {
  const TemporaryFolder scene("replica");
  const fs::path sequence_folder = scene.path() / "Sequence_1";
  write_replica(sequence_folder);
  write_file(scene.path() / "habitat/info_semantic.json", kReplicaClasses);
  const auto sequence = open_sequence(sequence_folder, as_is());
  EXPECT_THAT(names_of(*sequence), ElementsAre("rgb_0", "rgb_1"));
  expect_pose(sequence->pose(1), 2.0);
  const RgbdFrame frame = sequence->load(0);
  EXPECT_FLOAT_EQ(frame.depth_m(3, 3), 1.5F);
  EXPECT_EQ(frame.semantic(0, 0), 93);
  EXPECT_EQ(frame.instance(0, 0), 0);  // A wall.
  EXPECT_EQ(frame.semantic(15, 0), 20);
  EXPECT_EQ(frame.instance(15, 0), 12);
  EXPECT_EQ(sequence->instances().at(0).name, "chair_12");
}

TEST(Replica, KnowsTheCameraOfFullSizeImagesOnly) {
  const TemporaryFolder scene("replica");
  write_replica(scene.path());
  fs::remove(scene.path() / "intrinsics.txt");
  EXPECT_THAT(open_error(scene.path(), as_is()),
              AllOf(HasSubstr("640x480"), HasSubstr("found 16x12")));
  for (const int n : {0, 1}) {
    const std::string i = std::to_string(n) + ".png";
    write_rgb(scene.path() / "rgb" / ("rgb_" + i), 640, 480);
    write_depth(scene.path() / "depth" / ("depth_" + i), 1500, 640, 480);
  }
  const auto sequence = open_sequence(scene.path(), as_is());
  EXPECT_DOUBLE_EQ(sequence->intrinsics().fx_px, 320.0);
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cx_px, 320.0);  // 319.5 with integer centres.
}

TEST(Replica, ReadsNiceSlamRenderings) {
  const TemporaryFolder scene("nice");
  for (const std::string n : {"000000", "000001"}) {
    write_rgb(scene.path() / "results" / ("frame" + n + ".jpg"));
    write_depth(scene.path() / "results" / ("depth" + n + ".png"), 13107);
  }
  write_file(scene.path() / "traj.txt", pose_line(1, 2, 3) + pose_line(2, 2, 3));
  write_file(scene.path() / "intrinsics.txt", "20 21 7.5 5.5\n");
  const auto sequence = open_sequence(scene.path(), as_is());
  expect_pose(sequence->pose(0), 1.0);
  EXPECT_FLOAT_EQ(sequence->load(0).depth_m(3, 3), 2.0F);
  write_file(scene.path() / "traj.txt", pose_line(1, 2, 3));
  EXPECT_THAT(open_error(scene.path(), as_is()),
              AllOf(HasSubstr("traj.txt"), HasSubstr("image 1"), HasSubstr("1 lines")));
}

// ---- TUM RGB-D

TEST(TumRgbd, AssociatesTheNearestDepthAndPose) {
  const TemporaryFolder folder("tum");
  write_tum(folder.path());
  const auto sequence = open_sequence(folder.path(), as_is());
  EXPECT_THAT(names_of(*sequence), ElementsAre("1305031102.100000", "1305031102.200000"));
  EXPECT_THAT(sequence->notes(), Contains(HasSubstr("1 colour images without")));
  expect_pose(sequence->pose(0), 1.0);
  expect_pose(sequence->pose(1), 2.0);
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cx_px, 8.0);
  EXPECT_FLOAT_EQ(sequence->load(0).depth_m(3, 3), 1.5F);  // 7500 / 5000.
}

TEST(TumRgbd, TakesTheScalarOfAQuaternionLast) {
  const TemporaryFolder folder("tum");
  write_tum(folder.path());
  // A quarter turn about z: the camera's x axis becomes the world's y axis.
  write_file(folder.path() / "groundtruth.txt",
             "1305031102.1 1 2 3 0 0 0.70710678 0.70710678\n");
  const auto sequence = open_sequence(folder.path(), as_is());
  EXPECT_NEAR((sequence->pose(0).rotation() * glm::dvec3(1, 0, 0)).y, 1.0, 1e-7);
}

TEST(TumRgbd, KnowsThreeCamerasByTheFoldersName) {
  const TemporaryFolder root("tum");
  const fs::path folder = root.path() / "rgbd_dataset_freiburg3_office";
  write_tum(folder);
  fs::remove(folder / "intrinsics.txt");
  for (const auto& entry : fs::directory_iterator(folder / "rgb")) {
    write_rgb(entry.path(), 640, 480);
  }
  const auto sequence = open_sequence(folder, as_is());
  EXPECT_DOUBLE_EQ(sequence->intrinsics().fx_px, 535.4);
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cy_px, 248.1);
  fs::rename(folder, root.path() / "office");
  EXPECT_THAT(open_error(root.path() / "office", as_is()),
              AllOf(HasSubstr("intrinsics.txt"), HasSubstr("freiburg")));
}

TEST(TumRgbd, NamesTheLineOfAFault) {
  struct Fault {
    const char *file, *text, *place, *message;
  };
  for (const Fault& fault :
       {Fault{"rgb.txt", "# c\nx rgb/a.png\n", "rgb.txt:2", "'x'"},
        Fault{"depth.txt", "1.5\n", "depth.txt:1", "1 words behind"},
        Fault{"groundtruth.txt", "1305031102.1 1 2 3 0 0 0\n", "groundtruth.txt:1", "7 words"},
        Fault{"groundtruth.txt", "1305031102.1 1 2 3 0 0 0 5\n", "groundtruth.txt:1", "unit"},
        Fault{"groundtruth.txt", "1305031102.1 1 2 nan 0 0 0 1\n", "groundtruth.txt:1",
              "finite"}}) {
    const TemporaryFolder folder("tum");
    write_tum(folder.path());
    write_file(folder.path() / fault.file, fault.text);
    EXPECT_THAT(open_error(folder.path(), as_is()),
                AllOf(HasSubstr(fault.place), HasSubstr(fault.message)));
  }
}

// ---- nerfstudio

TEST(Nerfstudio, TurnsOpenGlAxes) {
  const TemporaryFolder folder("nerfstudio");
  write_nerfstudio(folder.path());
  const auto sequence = open_sequence(folder.path(), as_is());
  EXPECT_THAT(names_of(*sequence), ElementsAre("0", "1"));
  EXPECT_DOUBLE_EQ(sequence->intrinsics().cx_px, 8.25);  // Already at + 0.5.
  expect_pose(sequence->pose(0), 1.0);
  expect_pose(sequence->pose(1), 2.0);
  const RgbdFrame frame = sequence->load(0);
  EXPECT_EQ(frame.valid(0, 5), 0);
  EXPECT_EQ(frame.valid(15, 5), 255);
  EXPECT_TRUE(std::isnan(frame.depth_m(2, 5)));  // Masked.
  EXPECT_FLOAT_EQ(frame.depth_m(12, 5), 1.5F);
}

TEST(Nerfstudio, WorksWithoutDepth) {
  const TemporaryFolder folder("nerfstudio");
  write_nerfstudio(folder.path(), false);
  const auto sequence = open_sequence(folder.path());
  EXPECT_FALSE(sequence->has_depth());
  EXPECT_TRUE(sequence->load(0).depth_m.empty());
  EXPECT_THAT(sequence->warnings(), Contains(HasSubstr("no depth images")));
}

TEST(Nerfstudio, NamesTheKeyOfAFault) {
  const std::string good = transforms_json(kPinholeJson, false);
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    return text.replace(text.find(from), from.size(), to);
  };
  for (const auto& [text, parts] :
       std::vector<std::pair<std::string, std::vector<std::string>>>{
           {with("\"fl_y\": 21, ", ""), {"transforms.json", "fl_y"}},
           {with("\"fl_x\": 20", "\"fl_x\": \"20\""), {"fl_x", "a number"}},
           {with("\"fl_x\": 20", "\"fl_x\": -20"), {"fl_x", "> 0"}},
           {with("\"w\": 16", "\"camera_model\": \"SPHERE\", \"w\": 16"), {"'SPHERE'"}},
           {with("[1, 0, 0, 2]", "[1, 0, 2]"), {"frames[1].transform_matrix", "15 numbers"}},
           {with("[1, 0, 0, 2]", "[3, 0, 0, 2]"), {"frames[1]", "orthonormal"}},
           {with("images/1.png", "images/7.png"), {"7.png"}},
           {with("{\"file_path\": \"images/1", "{\"fl_x\": 30, \"file_path\": \"images/1"),
            {"frames[1]", "camera of the first frame"}},
           {"{\"frames\": []}", {"frames", "none"}},
           {"{\"frames\": [,]}", {"transforms.json", "line 1"}}}) {
    const TemporaryFolder folder("nerfstudio");
    write_nerfstudio(folder.path(), false);
    write_text(folder.path() / "transforms.json", text);
    for (const std::string& part : parts) {
      EXPECT_THAT(open_error(folder.path(), as_is()), HasSubstr(part)) << text;
    }
  }
}

}  // namespace
}  // namespace segsim::reconstruction
