// Pictures and poses alone become a scene that a robot can drive in.

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include <gmock/gmock.h>

#include "core/file_io.h"
#include "core/quantile.h"
#include "core/scene_bundle.h"
#include "renderer/files/ply_io.h"
#include "segsim_process.h"
#include "tests/reconstruction/stereo_room.h"
#include "tests/temporary_folder.h"

namespace segsim {
namespace {

namespace fs = std::filesystem;
using reconstruction::testing::StereoRoom;
using ::testing::HasSubstr;
using ::testing::Not;
using tests::expect_input_error;
using tests::ProcessOutput;
using tests::TemporaryFolder;

ProcessOutput reconstruct(const fs::path& recording, const fs::path& bundle,
                          const std::string& flags = {}) {
  return tests::run_segsim("reconstruct " + recording.string() + " --init-only --voxel 0.05 " +
                           flags + " --out " + bundle.string());
}

/// To the nearest wall, floor, ceiling or side of the furniture of StereoRoom.
double distance_m(const glm::vec3& p,
                  const std::vector<reconstruction::testing::Rectangle>& room) {
  double nearest = 1e9;
  for (const auto& r : room) {
    const glm::dvec3 off = glm::dvec3(p) - r.corner_m;
    const double u =
        std::clamp(glm::dot(off, r.side_m) / glm::dot(r.side_m, r.side_m), 0.0, 1.0);
    const double v =
        std::clamp(glm::dot(off, r.other_m) / glm::dot(r.other_m, r.other_m), 0.0, 1.0);
    nearest = std::min(nearest, glm::length(off - u * r.side_m - v * r.other_m));
  }
  return nearest;
}

TEST(StereoCli, PicturesAndPosesBecomeABundle) {
  const TemporaryFolder folder("stereo_cli");
  const StereoRoom room;
  room.write_nerfstudio(folder / "recording");
  const ProcessOutput run = reconstruct(folder / "recording", folder / "bundle");
  ASSERT_EQ(run.exit_code, 0) << run.text;
  EXPECT_THAT(run.text, HasSubstr("stereo: depth of "));
  EXPECT_THAT(run.text, Not(HasSubstr("rendering and labels only")));

  const core::SceneBundle bundle = core::load_bundle(folder / "bundle");
  EXPECT_FALSE(bundle.manifest.navmesh.name.empty());
  const auto surfels = renderer::read_surfels_ply(folder / "bundle/surfels.ply");
  std::vector<double> distances_m;
  for (const glm::vec3& p_m : surfels.position_m) {
    distances_m.push_back(distance_m(p_m, room.rectangles()));
  }
  EXPECT_GT(surfels.size(), 8000U);  // 75 m2 of surface in squares of 5 cm: 30000.
  EXPECT_LT(core::quantile(distances_m, 0.5, core::Between::kNearest), 0.012);
  EXPECT_LT(core::quantile(distances_m, 0.95, core::Between::kNearest), 0.06);

  // What was found is not looked for again, and the result is the same.
  const ProcessOutput again =
      reconstruct(folder / "recording", folder / "again",
                  "--stereo-work " + (folder.path() / "bundle.stereo").string());
  EXPECT_EQ(again.exit_code, 0) << again.text;
  EXPECT_THAT(again.text, HasSubstr("24 of 24 found in "));
  EXPECT_EQ(core::sha256_of_file(folder / "again/surfels.ply"),
            core::sha256_of_file(folder / "bundle/surfels.ply"));
}

TEST(StereoCli, BadInputIsOneLine) {
  const TemporaryFolder folder("stereo_cli");
  StereoRoom::turning(12)->write_nerfstudio(folder / "turning");
  const auto with = [&](const std::string& flags) {
    return reconstruct(folder / "turning", folder / "bundle", flags);
  };
  expect_input_error(with(""), "turning, poses");
  expect_input_error(with("--depth recorded"), "frames with depth");
  expect_input_error(with("--depth none"), "frames with depth");
  expect_input_error(with("--depth fly"), "--depth");
  expect_input_error(with("--depth-range 2 1"), "--depth-range");
  EXPECT_EQ(with("--depth-range 2").exit_code, 2);
  EXPECT_FALSE(fs::exists(folder / "bundle"));
}

}  // namespace
}  // namespace segsim
