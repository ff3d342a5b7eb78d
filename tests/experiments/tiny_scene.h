#pragma once

// Two rooms with a couch and a chair as a complete scene bundle: made of surfels and boxes in
// milliseconds, for tests of episodes and runs.

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>

#include "core/scene_bundle.h"
#include "renderer/files/ply_io.h"
#include "renderer/scene/surfels.h"
#include "sim/ground/robot.h"
#include "sim/ground/triangle_mesh.h"
#include "tests/box_mesh.h"
#include "tests/temporary_folder.h"
#include "worlds/surface/bundle_files.h"

namespace segsim::experiments {

class TinyScene {
 public:
  static constexpr std::uint16_t kFloor = 1, kWall = 2, kCouch = 3, kChair = 4;

  static constexpr std::uint16_t kCouch1 = 1, kRedChair = 2, kBlueChair = 3;  ///< Instances.
  enum class Chairs { kOne, kTwo };

  /// @param chairs  The second one is blue and stands in the room of the couch, which is green
  /// then.
  explicit TinyScene(Chairs chairs = Chairs::kOne) : chairs_(chairs) {
    // Rooms of 4 m x 5 m on both sides of a wall that leaves a passage of 1.7 m.
    sim::append_floor(mesh_, -4.2F, -2.7F, 4.2F, 2.7F);
    for (float y = -2.5F; y < 2.5F; y += kStep) {
      for (float x = -4.0F; x < 4.0F; x += kStep) add_disc({x, y, 0.0F}, 2, kFloor, 0);
    }
    add_box({-4.2F, -2.7F, 0.0F}, {-4.0F, 2.7F, 2.2F}, kWall, 0);
    add_box({4.0F, -2.7F, 0.0F}, {4.2F, 2.7F, 2.2F}, kWall, 0);
    add_box({-4.0F, -2.7F, 0.0F}, {4.0F, -2.5F, 2.2F}, kWall, 0);
    add_box({-4.0F, 2.5F, 0.0F}, {4.0F, 2.7F, 2.2F}, kWall, 0);
    add_box({-0.1F, -2.5F, 0.0F}, {0.1F, 0.8F, 2.2F}, kWall, 0);
    add_box({2.0F, -2.4F, 0.0F}, {3.9F, -1.5F, 0.8F}, kCouch, 1);
    add_box({-3.4F, 1.6F, 0.0F}, {-2.9F, 2.1F, 0.9F}, kChair, kRedChair);
    if (chairs == Chairs::kTwo) {
      add_box({2.9F, 1.6F, 0.0F}, {3.4F, 2.1F, 0.9F}, kChair, kBlueChair);
      paint(kBlueChair, {0.03F, 0.03F, 0.9F});
      paint(kCouch1, {0.1F, 0.6F, 0.1F});  // Nothing else is blue.
    }
  }

  /// Writes the bundle. @return  Its folder.
  std::filesystem::path write(const std::filesystem::path& folder) const {
    std::filesystem::create_directories(folder);
    renderer::write_surfels_ply(folder / "surfels.ply", surfels_);
    core::SceneManifest manifest;
    manifest.name = "tiny";
    manifest.created_by = "test";
    manifest.source = "two rooms";
    manifest.origin = {49.9, 8.9, 0.0, 0.0};
    manifest.camera_height_m = 1.0;
    manifest.classes = {{kFloor, "floor", false},
                        {kWall, "wall", false},
                        {kCouch, "couch", true},
                        {kChair, "chair", true}};
    manifest.instances = {{1, kCouch, "couch_1", {2.0, -2.4, 0.0}, {3.9, -1.5, 0.8}},
                          {2, kChair, "chair_1", {-3.4, 1.6, 0.0}, {-2.9, 2.1, 0.9}}};
    if (chairs_ == Chairs::kTwo) {
      manifest.instances.push_back(
          {kBlueChair, kChair, "chair_2", {2.9, 1.6, 0.0}, {3.4, 2.1, 0.9}});
    }
    manifest.surfels.name = "surfels.ply";
    worlds::write_collision_files(folder, mesh_, sim::RobotModel::jackal_gentle(), manifest);
    core::write_bundle_manifest(folder, manifest);
    return folder;
  }

  [[nodiscard]] const renderer::SurfelCloud& surfels() const { return surfels_; }

 private:
  static constexpr float kStep = 0.06F;

  void paint(std::uint16_t instance_id, const glm::vec3& colour) {
    for (std::size_t i = 0; i < surfels_.size(); ++i) {
      if (surfels_.instance_id[i] != instance_id) continue;
      surfels_.sh[i] = (colour - 0.5F) / renderer::kShC0;
    }
  }

  /// A disc whose normal is the given axis.
  void add_disc(const glm::vec3& p_m, int normal_axis, std::uint16_t class_id,
                std::uint16_t instance_id) {
    const float h = std::sqrt(0.5F);
    const glm::quat turns[] = {
        {h, 0.0F, h, 0.0F}, {h, -h, 0.0F, 0.0F}, {1.0F, 0.0F, 0.0F, 0.0F}};
    const glm::vec3 colors[] = {{},
                                {0.55F, 0.45F, 0.35F},
                                {0.9F, 0.9F, 0.85F},
                                {0.2F, 0.3F, 0.7F},
                                {0.7F, 0.3F, 0.2F}};
    surfels_.position_m.push_back(p_m);
    surfels_.R_world_surfel.push_back(turns[normal_axis]);
    surfels_.scale_m.emplace_back(0.045F, 0.045F);
    surfels_.opacity.push_back(0.95F);
    surfels_.sh.push_back((colors[class_id] - 0.5F) / renderer::kShC0);
    surfels_.semantic_id.push_back(class_id);
    surfels_.instance_id.push_back(instance_id);
  }

  /// A box in the collision mesh, its sides and top in surfels.
  void add_box(const glm::vec3& low, const glm::vec3& high, std::uint16_t class_id,
               std::uint16_t instance_id) {
    sim::append_box(mesh_, low, high);
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (const float at : {low[axis], high[axis]}) {
        if (axis == 2 && at == low.z) continue;
        for (float a = low[u]; a <= high[u] + 1e-4F; a += kStep) {
          for (float b = low[v]; b <= high[v] + 1e-4F; b += kStep) {
            glm::vec3 p;
            p[axis] = at;
            p[u] = a;
            p[v] = b;
            add_disc(p, axis, class_id, instance_id);
          }
        }
      }
    }
  }

  Chairs chairs_;
  renderer::SurfelCloud surfels_;
  sim::TriangleMesh mesh_;
};

using tests::TemporaryFolder;

}  // namespace segsim::experiments
