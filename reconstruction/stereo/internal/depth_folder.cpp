#include "reconstruction/stereo/internal/depth_folder.h"

#include <span>

#include "core/error.h"
#include "core/file_io.h"
#include "core/render.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "renderer/files/exr_io.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;

fs::path matched_file(const fs::path& folder, std::size_t frame) {
  return folder / ("inverse-" + own_depth_name(frame));
}

void write_z(const fs::path& file, const core::Image<float>& z,
             const core::CameraIntrinsics& camera, const core::CameraPose& T_world_camera) {
  core::Frame image;
  image.intrinsics = camera;
  image.T_world_camera = T_world_camera;
  image.depth_m = z;
  renderer::write_frame_exr(file, image);
}

bool is_ours(const fs::path& file) {
  const std::string name = file.filename().string();
  const std::string digits = name.starts_with("inverse-") ? name.substr(8) : name;
  return digits.ends_with(".exr") &&
         digits.find_first_not_of("0123456789") == digits.size() - 4;
}

}  // namespace

std::string digest_of(const core::Image<std::uint16_t>& grey) {
  return core::sha256_hex(std::as_bytes(std::span(grey.pixels())));
}

void DepthFolder::begin(const std::string& recipe) const {
  const fs::path file = folder_ / "recipe.txt";
  if (fs::exists(file) && core::read_file(file) == recipe) return;
  if (fs::is_directory(folder_)) {
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_)) {
      if (is_ours(entry.path())) fs::remove(entry.path());
    }
  }
  core::write_file_atomically(file, [&](std::ostream& out) { out << recipe; });
}

std::optional<core::Image<float>> DepthFolder::read_matched(std::size_t frame) const {
  const fs::path file = matched_file(folder_, frame);
  if (!fs::exists(file)) return std::nullopt;
  try {
    return renderer::read_depth_exr(file);
  } catch (const core::InputError&) {
    return std::nullopt;
  }
}

void DepthFolder::write_matched(std::size_t frame, const core::Image<float>& inverse_m,
                                const core::CameraIntrinsics& camera,
                                const core::CameraPose& T_world_camera) const {
  write_z(matched_file(folder_, frame), inverse_m, camera, T_world_camera);
}

void DepthFolder::write_depth(std::size_t frame, const core::Image<float>& depth_m,
                              const core::CameraIntrinsics& camera,
                              const core::CameraPose& T_world_camera) const {
  write_z(folder_ / own_depth_name(frame), depth_m, camera, T_world_camera);
}

}  // namespace segsim::reconstruction::internal
