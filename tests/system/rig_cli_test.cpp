// Flags for recordings whose cameras and clocks are apart.

#include <filesystem>
#include <string>

#include <gmock/gmock.h>

#include "reconstruction/datasets/color_depth.h"
#include "segsim_process.h"
#include "tests/reconstruction/rough_walk.h"
#include "tests/reconstruction/tiny_datasets.h"
#include "tests/temporary_folder.h"

namespace segsim {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using tests::expect_input_error;
using tests::ProcessOutput;
using tests::TemporaryFolder;

ProcessOutput reconstruct(const fs::path& recording, const fs::path& bundle,
                          const std::string& flags) {
  return tests::run_segsim("reconstruct " + recording.string() +
                           " --init-only --voxel 0.05 --up z --floor-height 0 " + flags +
                           " --out " + bundle.string());
}

TEST(RigCli, AnEstimateIsUsedAndSaved) {
  const TemporaryFolder folder("rig_cli");
  reconstruction::testing::RoughWalk walk;
  walk.frames = 40;
  walk.T_color_depth = {{1.0, 0.0, 0.0, 0.0}, {0.05, 0.0, 0.0}};
  walk.write(folder / "walk");
  const ProcessOutput run =
      reconstruct(folder / "walk", folder / "scene", "--color-depth estimate --sensor tof");
  ASSERT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("cm right"));
  EXPECT_THAT(run.text, HasSubstr("depth reprojected into the colour camera"));
  EXPECT_THAT(run.text, HasSubstr("sensor of kind tof"));
  const fs::path saved = folder / "scene.color_depth.yaml";
  const auto found = reconstruction::read_color_depth(saved).T_color_depth.translation_m();
  EXPECT_NEAR(found.x, 0.05, 0.01);
  // The saved file does the same.
  const ProcessOutput again = reconstruct(folder / "walk", folder / "again",
                                          "--color-depth " + saved.string() + " --sensor tof");
  EXPECT_EQ(again.exit_code, 0) << again.text;
  EXPECT_EQ(fs::file_size(folder / "again/surfels.ply"),
            fs::file_size(folder / "scene/surfels.ply"));
}

TEST(RigCli, BadInputIsOneLine) {
  const TemporaryFolder folder("rig_cli");
  reconstruction::testing::write_tum(folder / "tum");
  reconstruction::testing::write_replica(folder / "replica");
  const auto with = [&](const std::string& recording, const std::string& flags) {
    return reconstruct(folder / recording, folder / "scene", flags);
  };
  EXPECT_EQ(with("tum", "--color-depth none.yaml").exit_code, 2);
  expect_input_error(with("tum", "--color-depth estimate"), "too little to go by");
  expect_input_error(with("tum", "--pose-time-offset estimate"), "too little to go by");
  expect_input_error(with("tum", "--depth-time-offset soon"), "--depth-time-offset");
  expect_input_error(with("tum", "--depth-time-offset 4000"), "milliseconds?");
  expect_input_error(with("tum", "--sensor lidar"), "--sensor");
  expect_input_error(with("tum", "--frame-rate 10"), "--frame-rate");
  expect_input_error(with("replica", "--pose-time-offset estimate"), "--frame-rate HZ");
  expect_input_error(with("replica", "--rolling-shutter 20"), "--frame-rate HZ");
  EXPECT_EQ(with("replica", "--rolling-shutter 900").exit_code, 2);
  EXPECT_FALSE(fs::exists(folder / "scene"));
}

}  // namespace
}  // namespace segsim
