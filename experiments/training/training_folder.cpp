#include "experiments/training/training_folder.h"

#include <fstream>
#include <sstream>

#include "renderer/files/ply_io.h"

namespace segsim::experiments::training {

namespace fs = std::filesystem;

void write_so_far(const fs::path& work, const renderer::SurfelCloud& surfels,
                  const reconstruction::TrainingSet& set,
                  const std::vector<core::CameraPose>& poses) {
  core::CameraPath cameras{set.intrinsics, {}};
  for (std::size_t i = 0; i < set.training.size(); ++i) {
    const reconstruction::TrainingView& view = set.training[i];
    cameras.views.push_back({poses.empty() ? view.T_world_camera : poses[i], view.name});
  }
  core::write_camera_path(work / kCamerasSoFar, cameras);
  renderer::write_surfels_ply(work / kSurfelsSoFar, surfels);
}

bool is_training_folder(const fs::path& folder) {
  return !fs::exists(folder / "scene.yaml") && fs::exists(folder / kSurfelsSoFar) &&
         fs::exists(folder / kLosses);
}

std::string training_progress(const fs::path& work) {
  std::ifstream in(work / kLosses);
  std::string line, last;
  std::getline(in, line);  // The names of the columns.
  while (std::getline(in, line)) last = line;
  std::istringstream columns(last);
  std::string stage, iteration, seconds;
  std::getline(columns, stage, ',');
  std::getline(columns, iteration, ',');
  std::getline(columns, seconds, ',');
  if (seconds.empty()) return "not begun";
  return stage + ", iteration " + iteration + ", " + seconds + " s";
}

core::CameraPath cameras_so_far(const fs::path& work) {
  return core::read_camera_path(work / kCamerasSoFar);
}

}  // namespace segsim::experiments::training
