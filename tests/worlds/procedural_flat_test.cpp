#include "worlds/procedural/procedural_flat.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/random.h"
#include "worlds/procedural/source_domain.h"

namespace segsim::worlds {
namespace {

template <class T>
std::uint64_t hash_items(const std::vector<T>& items, std::uint64_t seed) {
  return core::hash64({reinterpret_cast<const char*>(items.data()), items.size() * sizeof(T)},
                      seed);
}

std::uint64_t hash_scene(const sim::MeshScene& scene) {
  std::uint64_t hash = scene.meshes.size();
  for (const sim::SubMesh& mesh : scene.meshes) {
    hash = hash_items(mesh.positions_m, hash);
    hash = hash_items(mesh.normals, hash);
    hash = hash_items(mesh.uvs, hash);
    hash = hash_items(mesh.triangles, hash) + mesh.class_id + 977U * mesh.instance_id +
           31U * static_cast<unsigned>(mesh.material);
  }
  hash = hash_items(scene.materials, hash);
  for (const auto& texture : scene.textures) hash = hash_items(texture.pixels(), hash);
  for (const sim::PointLight& light : scene.lights)
    hash = hash_items(std::vector<glm::vec3>{light.position_m, light.radiance}, hash);
  for (const auto& instance : scene.instances) hash = core::hash64(instance.name, hash);
  return hash;
}

std::uint16_t class_id_of(const sim::MeshScene& scene, const std::string& name) {
  for (const core::SceneClass& c : scene.classes) {
    if (c.name == name) return c.id;
  }
  ADD_FAILURE() << "no class " << name;
  return 0;
}

void expect_sound(const sim::MeshScene& scene) {
  for (const sim::SubMesh& mesh : scene.meshes) {
    ASSERT_EQ(mesh.positions_m.size(), mesh.normals.size());
    ASSERT_EQ(mesh.positions_m.size(), mesh.uvs.size());
    ASSERT_GE(mesh.material, 0);
    ASSERT_LT(mesh.material, static_cast<int>(scene.materials.size()));
    int bad_values = 0, bad_normals = 0, degenerate = 0;
    for (std::size_t i = 0; i < mesh.positions_m.size(); ++i) {
      bad_values += !std::isfinite(mesh.positions_m[i].x + mesh.positions_m[i].y +
                                   mesh.positions_m[i].z + mesh.uvs[i].x + mesh.uvs[i].y);
      bad_normals += !(std::abs(glm::length(mesh.normals[i]) - 1.0F) < 1e-3F);
    }
    for (const glm::uvec3& t : mesh.triangles) {
      ASSERT_LT(std::max({t.x, t.y, t.z}), mesh.positions_m.size());
      const auto& p = mesh.positions_m;
      degenerate += !(glm::length(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x])) > 1e-10F);
    }
    EXPECT_EQ(bad_values, 0);
    EXPECT_EQ(bad_normals, 0);
    EXPECT_EQ(degenerate, 0);
  }
  for (const sim::Material& material : scene.materials)
    ASSERT_LT(material.texture, static_cast<int>(scene.textures.size()));
  for (const auto& texture : scene.textures) {
    EXPECT_GE(texture.width_px(), 128);
    EXPECT_LE(texture.width_px(), 512);
  }
}

/// Instances and classes refer to each other, and boxes enclose the meshes.
void expect_consistent_tables(const sim::MeshScene& scene) {
  std::set<std::uint16_t> used;
  for (const sim::SubMesh& mesh : scene.meshes) {
    ASSERT_GE(mesh.class_id, 1);
    ASSERT_LE(mesh.class_id, scene.classes.size());
    EXPECT_EQ(scene.classes[mesh.class_id - 1U].id, mesh.class_id);
    EXPECT_EQ(scene.classes[mesh.class_id - 1U].thing, mesh.instance_id != 0);
    if (mesh.instance_id == 0) continue;
    used.insert(mesh.instance_id);
    ASSERT_LE(mesh.instance_id, scene.instances.size());
    const core::SceneInstance& instance = scene.instances[mesh.instance_id - 1U];
    EXPECT_EQ(instance.id, mesh.instance_id);
    EXPECT_EQ(instance.class_id, mesh.class_id);
    for (const glm::vec3& p : mesh.positions_m) {
      for (int k = 0; k < 3; ++k) {
        ASSERT_GE(p[k], instance.box_min_m[k] - 1e-5);
        ASSERT_LE(p[k], instance.box_max_m[k] + 1e-5);
      }
    }
  }
  EXPECT_EQ(used.size(), scene.instances.size()) << "every instance has a mesh";
}

/// Floor cells of 5 cm, made from the triangles alone: the oracle for what the generator
/// promises.
class FloorGrid {
 public:
  static constexpr double kCell_m = 0.05;

  explicit FloorGrid(const sim::MeshScene& scene) {
    for (const sim::SubMesh& mesh : scene.meshes) {
      for (const glm::vec3& p : mesh.positions_m) {
        low_ = glm::min(low_, glm::dvec2(p));
        high_ = glm::max(high_, glm::dvec2(p));
      }
    }
    low_ -= 0.2;
    columns_ = static_cast<int>((high_.x - low_.x + 0.2) / kCell_m) + 1;
    rows_ = static_cast<int>((high_.y - low_.y + 0.2) / kCell_m) + 1;
    blocked_.assign(static_cast<std::size_t>(columns_ * rows_), 0);
    for (const sim::SubMesh& mesh : scene.meshes) {
      for (const glm::uvec3& t : mesh.triangles) {
        block(mesh.positions_m[t.x], mesh.positions_m[t.y], mesh.positions_m[t.z]);
      }
    }
  }

  /// Cells that a disc reaches from `start_m`, by brute force over all blocked cells nearby.
  void flood(const glm::dvec2& start_m, double radius_m) {
    reached_.assign(blocked_.size(), 0);
    std::vector<std::uint8_t> too_near(blocked_.size(), 0);
    const int reach = static_cast<int>(radius_m / kCell_m);
    for (int i = 0; i < columns_ * rows_; ++i) {
      if (!blocked_[static_cast<std::size_t>(i)]) continue;
      for (int dy = -reach; dy <= reach; ++dy) {
        for (int dx = -reach; dx <= reach; ++dx) {
          const int x = i % columns_ + dx, y = i / columns_ + dy;
          if (x < 0 || y < 0 || x >= columns_ || y >= rows_ ||
              std::hypot(dx, dy) * kCell_m >= radius_m)
            continue;
          too_near[static_cast<std::size_t>(y * columns_ + x)] = 1;
        }
      }
    }
    std::vector<int> queue{cell(start_m)};
    if (too_near[static_cast<std::size_t>(queue[0])]) return;
    reached_[static_cast<std::size_t>(queue[0])] = 1;
    for (std::size_t k = 0; k < queue.size(); ++k) {
      for (const int step : {-1, 1, -columns_, columns_}) {
        const auto next = static_cast<std::size_t>(queue[k] + step);
        if (next >= reached_.size() || reached_[next] || too_near[next]) continue;
        reached_[next] = 1;
        queue.push_back(static_cast<int>(next));
      }
    }
  }

  /// Is any cell within `distance_m` of the box reached?
  [[nodiscard]] bool reached_near(const glm::dvec2& low_m, const glm::dvec2& high_m,
                                  double distance_m) const {
    return count_reached(low_m, high_m, distance_m) > 0;
  }
  [[nodiscard]] int count_reached(const glm::dvec2& low_m, const glm::dvec2& high_m,
                                  double distance_m) const {
    int count = 0;
    for (int i = 0; i < columns_ * rows_; ++i) {
      if (!reached_[static_cast<std::size_t>(i)]) continue;
      const glm::dvec2 p = center(i);
      count += glm::length(p - glm::clamp(p, low_m, high_m)) <= distance_m;
    }
    return count;
  }

 private:
  [[nodiscard]] glm::dvec2 center(int i) const {
    return low_ + kCell_m * glm::dvec2(i % columns_ + 0.5, i / columns_ + 0.5);
  }
  [[nodiscard]] int cell(const glm::dvec2& p) const {
    return static_cast<int>((p.y - low_.y) / kCell_m) * columns_ +
           static_cast<int>((p.x - low_.x) / kCell_m);
  }
  /// Marks cells that the triangle's part between 5 cm and 1.2 m covers, by dense sampling.
  void block(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    if (std::max({a.z, b.z, c.z}) < 0.05F || std::min({a.z, b.z, c.z}) > 1.2F) return;
    const float longest =
        std::max({glm::length(b - a), glm::length(c - b), glm::length(a - c)});
    const int steps = static_cast<int>(longest / 0.02F) + 1;
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; j <= steps - i; ++j) {
        const float u = static_cast<float>(i) / static_cast<float>(steps),
                    v = static_cast<float>(j) / static_cast<float>(steps);
        const glm::vec3 p = a + u * (b - a) + v * (c - a);
        if (p.z > 0.05F && p.z < 1.2F)
          blocked_[static_cast<std::size_t>(cell(glm::dvec2(p)))] = 1;
      }
    }
  }

  glm::dvec2 low_{1e9}, high_{-1e9};
  int columns_ = 0, rows_ = 0;
  std::vector<std::uint8_t> blocked_, reached_;
};

class ProceduralFlat : public testing::TestWithParam<int> {
 protected:
  /// One flat serves all tests of its seed.
  static const Flat& flat_of(int seed) {
    static std::map<int, Flat> flats;
    const auto [it, is_new] = flats.try_emplace(seed);
    if (is_new) it->second = make_flat_with_rooms({static_cast<std::uint64_t>(seed)});
    return it->second;
  }
  const Flat& flat_ = flat_of(GetParam());
};

TEST_P(ProceduralFlat, MeshesAreSoundAndWithinTheBudget) {
  expect_sound(flat_.scene);
  expect_consistent_tables(flat_.scene);
  EXPECT_LE(flat_.scene.triangle_count(), 150'000U);
  EXPECT_LE(flat_.scene.textures.size(), 60U);
  EXPECT_GE(flat_.rooms.size(), 5U);
  EXPECT_LE(flat_.rooms.size(), 7U);
  double area_m2 = 0.0;
  for (const FlatRoom& room : flat_.rooms)
    area_m2 += (room.max_m.x - room.min_m.x) * (room.max_m.y - room.min_m.y);
  EXPECT_GT(area_m2, 55.0);
  EXPECT_LT(area_m2, 115.0);
}

TEST_P(ProceduralFlat, ContainsEveryGoalClass) {
  for (const std::string& name : flat_goal_class_names()) {
    const std::uint16_t id = class_id_of(flat_.scene, name);
    EXPECT_TRUE(std::any_of(flat_.scene.instances.begin(), flat_.scene.instances.end(),
                            [&](const core::SceneInstance& i) { return i.class_id == id; }))
        << name;
  }
}

TEST_P(ProceduralFlat, RobotReachesAllRoomsAndGoals) {
  FloorGrid grid(flat_.scene);
  const FlatRoom& hall = flat_.rooms.back();
  ASSERT_EQ(hall.name, "hall");
  // Start at some free place of the hall.
  int reached = 0;
  for (float t = 0.1F; t < 0.95F && reached < 20; t += 0.05F) {
    grid.flood(
        glm::dvec2(glm::mix(hall.min_m, hall.max_m,
                            glm::vec2(hall.max_m.x - hall.min_m.x > hall.max_m.y - hall.min_m.y
                                          ? glm::vec2(t, 0.5F)
                                          : glm::vec2(0.5F, t)))),
        0.40);
    reached = grid.count_reached(glm::dvec2(hall.min_m), glm::dvec2(hall.max_m), 0.0);
  }
  for (const FlatRoom& room : flat_.rooms) {
    EXPECT_GE(grid.count_reached(glm::dvec2(room.min_m), glm::dvec2(room.max_m), 0.0), 40)
        << room.name << ": 0.1 m2";
  }
  for (const core::SceneInstance& instance : flat_.scene.instances) {
    const std::string& name = flat_.scene.classes[instance.class_id - 1U].name;
    const auto& goals = flat_goal_class_names();
    const bool on_furniture = name == "potted plant" && instance.box_min_m.z > 0.2;
    if (on_furniture || std::find(goals.begin(), goals.end(), name) == goals.end()) continue;
    EXPECT_TRUE(
        grid.reached_near(glm::dvec2(instance.box_min_m), glm::dvec2(instance.box_max_m), 0.8))
        << instance.name;
  }
}

TEST_P(ProceduralFlat, FurnitureStandsInsideRooms) {
  for (const core::SceneInstance& instance : flat_.scene.instances) {
    const glm::dvec2 middle = 0.5 * glm::dvec2(instance.box_min_m + instance.box_max_m);
    const bool door = flat_.scene.classes[instance.class_id - 1U].name == "door";
    const double slack = door ? 0.2 : 0.01;  // The entrance's leaf hangs in the wall.
    const auto holds = [&](const FlatRoom& room) {
      return instance.box_min_m.x > room.min_m.x - slack &&
             instance.box_min_m.y > room.min_m.y - slack &&
             instance.box_max_m.x < room.max_m.x + slack &&
             instance.box_max_m.y < room.max_m.y + slack;
    };
    EXPECT_TRUE(std::any_of(flat_.rooms.begin(), flat_.rooms.end(), holds))
        << instance.name << " at " << middle.x << " " << middle.y;
    EXPECT_GE(instance.box_min_m.z, -1e-4) << instance.name;
    EXPECT_LE(instance.box_max_m.z, 2.6 + 1e-4) << instance.name;
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, ProceduralFlat, testing::Range(1, 11));

TEST(ProceduralFlat, WithoutPaintItHasTheSameShapes) {
  const sim::MeshScene whole = make_flat({.seed = 4});
  const sim::MeshScene bare = make_flat({.seed = 4, .painted = false});
  ASSERT_EQ(bare.textures.size(), whole.textures.size());
  for (const auto& texture : bare.textures) EXPECT_EQ(texture.size(), 1U);
  sim::MeshScene repainted = bare;
  repainted.textures = whole.textures;
  EXPECT_EQ(hash_scene(repainted), hash_scene(whole));
}

TEST(ProceduralFlatSeeds, EqualSeedsGiveEqualFlats) {
  EXPECT_EQ(hash_scene(make_flat({7})), hash_scene(make_flat({7})));
  EXPECT_NE(hash_scene(make_flat({7})), hash_scene(make_flat({8})));
}

TEST(ProceduralFlatSeeds, NumberOfRoomsIsKept) {
  for (const int rooms : {4, 5, 6}) {
    EXPECT_EQ(make_flat_with_rooms({.seed = 3, .rooms = rooms}).rooms.size(),
              static_cast<std::size_t>(rooms) + 1U);
  }
  EXPECT_THROW((void)make_flat({.seed = 3, .rooms = 9}), core::ContractViolation);
}

TEST(ProceduralClasses, GoalNamesAreInTheTable) {
  EXPECT_EQ(goal_class_names().size(), 12U);
  EXPECT_EQ(class_name(ProceduralClass::kObject), "object");
  EXPECT_EQ(class_name(ProceduralClass::kTrashBin), "trash bin");
  EXPECT_EQ(class_name(ProceduralClass::kKitchenCabinet), "kitchen cabinet");
  for (const std::string& name : goal_class_names()) {
    EXPECT_TRUE(
        std::any_of(procedural_classes().begin(), procedural_classes().end(),
                    [&](const core::SceneClass& c) { return c.name == name && c.thing; }));
  }
}

TEST(SourceRoom, IsSoundPlainAndDeterministic) {
  std::set<std::uint16_t> seen;
  for (std::uint64_t seed = 0; seed < 24; ++seed) {
    const sim::MeshScene scene = make_source_room(seed);
    expect_sound(scene);
    expect_consistent_tables(scene);
    EXPECT_TRUE(scene.textures.empty());
    for (const core::SceneInstance& instance : scene.instances) seen.insert(instance.class_id);
    EXPECT_EQ(hash_scene(scene), hash_scene(make_source_room(seed)));
  }
  for (const std::string& name : goal_class_names()) {
    EXPECT_TRUE(seen.contains(class_id_of(make_source_room(0), name))) << name;
  }
  EXPECT_NE(hash_scene(make_source_room(1)), hash_scene(make_source_room(2)));
}

TEST(SourceRoom, CamerasStandInTheRoomOutsideObjects) {
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const sim::MeshScene scene = make_source_room(seed);
    const std::vector<core::CameraPose> poses = source_viewpoints(seed, 8);
    ASSERT_EQ(poses.size(), 8U);
    for (const core::CameraPose& pose : poses) {
      const glm::dvec3 eye = pose.translation_m();
      EXPECT_GE(eye.z, 1.1);
      EXPECT_LE(eye.z, 1.4);
      for (const core::SceneInstance& instance : scene.instances) {
        const bool inside = glm::all(glm::greaterThan(eye, instance.box_min_m)) &&
                            glm::all(glm::lessThan(eye, instance.box_max_m));
        EXPECT_FALSE(inside) << instance.name;
      }
    }
  }
}

}  // namespace
}  // namespace segsim::worlds
