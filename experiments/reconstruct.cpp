#include "experiments/reconstruct.h"

#include <unistd.h>

#include <cstdio>
#include <memory>

#include <glm/gtc/quaternion.hpp>

#include "core/error.h"
#include "core/progress.h"
#include "core/version.h"
#include "renderer/ply_io.h"
#include "sim/bundle_files.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

renderer::LiftResult lift_with_progress(const renderer::RgbdSequence& sequence,
                                        const renderer::LiftOptions& options) {
  std::unique_ptr<core::Progress> progress;
  std::string current;
  return renderer::lift(
      sequence, options, [&](const std::string& stage, std::int64_t done, std::int64_t total) {
        if (stage != current) {
          current = stage;
          progress = std::make_unique<core::Progress>("lift: " + stage, total);
        }
        progress->update(done);
      });
}

std::vector<glm::vec3> surfel_normals(const renderer::SurfelCloud& surfels) {
  std::vector<glm::vec3> normals;
  normals.reserve(surfels.size());
  for (const glm::quat& R_world_surfel : surfels.R_world_surfel) {
    normals.push_back(R_world_surfel * glm::vec3(0.0F, 0.0F, 1.0F));
  }
  return normals;
}

}  // namespace

core::SceneBundle reconstruct_bundle(const renderer::RgbdSequence& sequence,
                                     const ReconstructOptions& options,
                                     const fs::path& folder) {
  for (const std::string& warning : sequence.warnings()) {
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  }
  const renderer::LiftResult lifted = lift_with_progress(sequence, options.lift);

  const fs::path temporary = folder.string() + ".tmp" + std::to_string(::getpid());
  fs::remove_all(temporary);
  fs::create_directories(temporary);
  try {
    core::SceneManifest manifest;
    manifest.name = options.name;
    manifest.created_by = std::string("segsim ") + core::version();
    manifest.source = options.source;
    manifest.source_sha256 = options.source_sha256;
    manifest.origin = options.origin;
    manifest.camera_height_m = options.camera_height_m;
    manifest.classes = lifted.classes;
    manifest.instances = lifted.instances;
    manifest.surfels.name = "surfels.ply";
    manifest.statistics = lifted.statistics.listing();
    manifest.statistics.emplace_back("surfels", static_cast<double>(lifted.surfels.size()));
    manifest.statistics.emplace_back("frames_skipped",
                                     static_cast<double>(sequence.warnings().size()));

    renderer::write_surfels_ply(temporary / manifest.surfels.name, lifted.surfels);
    const sim::CollisionMeshResult collision = sim::write_collision_files(
        temporary, lifted.surfels.position_m, surfel_normals(lifted.surfels),
        lifted.camera_positions_m, options.robot, options.collision, manifest);
    for (const std::string& warning : collision.warnings) {
      std::fprintf(stderr, "warning: %s\n", warning.c_str());
    }
    core::write_bundle_manifest(temporary, manifest);
    fs::remove_all(folder);
    fs::rename(temporary, folder);
  } catch (...) {
    fs::remove_all(temporary);
    throw;
  }
  return core::load_bundle(folder);
}

}  // namespace segsim::experiments
