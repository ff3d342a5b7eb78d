// cameras.txt of a bundle (core/camera_path.h).
#include "core/camera_path.h"

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) { (void)core::read_camera_path(in_file(bytes)).poses(); }

std::vector<std::string> seeds() {
  core::CameraPath path;
  path.intrinsics = core::CameraIntrinsics::from_fov(64, 48, 1.2);
  path.views.resize(2);
  path.views[0].frame = "frame-000000";
  path.views[1].frame = "frame 1";
  return {written([&](const auto& file) { core::write_camera_path(file, path); })};
}

}  // namespace segsim::fuzz
