#include "worlds/procedural/procedural_home.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/random.h"

namespace segsim::worlds {
namespace {

namespace fs = std::filesystem;

/// With the package's sizes where it is installed or SEGSIM_FURNITURE names its folder.
const std::vector<FurnitureModel>& installed_models() {
  static const std::vector<FurnitureModel> models = [] {
    const char* named = std::getenv("SEGSIM_FURNITURE");
    const fs::path folder = named != nullptr ? named : kFurnitureFolder;
    return fs::is_directory(folder) ? read_furniture_folder(folder)
                                    : std::vector<FurnitureModel>();
  }();
  return models;
}

/// Shapes without textures and, for models of the package, boxes.
Home shapes(const HomeOptions& options) { return make_home(options, blank_textures()); }

bool is_table(const std::string& name) {
  return name == "dining table" || name == "desk" || name == "coffee table";
}

/// The floor in cells of 5 cm, made of rooms, passages and boxes of pieces alone: the oracle
/// for what the generator promises. A box covers more than the piece, so it errs on the safe
/// side.
class FloorOracle {
 public:
  explicit FloorOracle(const Home& home) : home_(home) {
    for (const FlatRoom& room : home.rooms) {
      low_ = glm::min(low_, room.min_m);
      high_ = glm::max(high_, room.max_m);
    }
    low_ -= 0.3F;
    columns_ = static_cast<int>((high_.x - low_.x + 0.3F) / kCell_m) + 1;
    rows_ = static_cast<int>((high_.y - low_.y + 0.3F) / kCell_m) + 1;
    std::vector<std::uint8_t> open(cells(), 0);
    for (const auto* floors : {&home.rooms, &home.doors}) {
      for (const FlatRoom& floor : *floors) {
        // A cell belongs to the passage and the room, whose edges meet inside it.
        mark(open, floor.min_m - 0.5F * kCell_m, floor.max_m + 0.5F * kCell_m, 1);
      }
    }
    for (const core::SceneInstance& piece : home.scene.instances) {
      if (piece.box_max_m.z < 0.05 || piece.box_min_m.z > 1.2) continue;
      mark(open, glm::vec2(piece.box_min_m), glm::vec2(piece.box_max_m), 0);
    }
    free_ = open;
    // Where a disc of 0.40 m touches nothing; the rim of the floor may be a cell too wide.
    const int reach = static_cast<int>(kRadius_m / kCell_m);
    for (int i = 0; i < columns_ * rows_; ++i) {
      if (open[static_cast<std::size_t>(i)] != 0) continue;
      const bool rim = has_open_neighbour(open, i);
      if (!rim) {
        free_[static_cast<std::size_t>(i)] = 0;
        continue;
      }
      for (int dy = -reach; dy <= reach; ++dy) {
        for (int dx = -reach; dx <= reach; ++dx) {
          const int x = i % columns_ + dx, y = i / columns_ + dy;
          if (x < 0 || y < 0 || x >= columns_ || y >= rows_) continue;
          if (static_cast<float>(std::hypot(dx, dy)) * kCell_m < kRadius_m - 0.03F) {
            free_[static_cast<std::size_t>(y * columns_ + x)] = 0;
          }
        }
      }
    }
    flood();
  }

  /// Cells of the largest connected floor that lie within `distance_m` of the rectangle.
  [[nodiscard]] int reached(const glm::vec2& min_m, const glm::vec2& max_m,
                            float distance_m) const {
    int count = 0;
    for (int i = 0; i < columns_ * rows_; ++i) {
      if (island_[static_cast<std::size_t>(i)] != largest_) continue;
      const glm::vec2 p = low_ + kCell_m * glm::vec2(static_cast<float>(i % columns_) + 0.5F,
                                                     static_cast<float>(i / columns_) + 0.5F);
      count += glm::length(p - glm::clamp(p, min_m, max_m)) <= distance_m;
    }
    return count;
  }

 private:
  static constexpr float kCell_m = 0.05F, kRadius_m = 0.40F;

  [[nodiscard]] std::size_t cells() const {
    return static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  }
  void mark(std::vector<std::uint8_t>& grid, const glm::vec2& min_m, const glm::vec2& max_m,
            std::uint8_t value) const {
    const glm::vec2 a = (min_m - low_) / kCell_m, b = (max_m - low_) / kCell_m;
    for (int y = std::max(0, static_cast<int>(a.y));
         y < std::min<int>(rows_, static_cast<int>(b.y + 1)); ++y) {
      for (int x = std::max(0, static_cast<int>(a.x));
           x < std::min<int>(columns_, static_cast<int>(b.x + 1)); ++x) {
        grid[static_cast<std::size_t>(y * columns_ + x)] = value;
      }
    }
  }
  [[nodiscard]] bool has_open_neighbour(const std::vector<std::uint8_t>& open, int i) const {
    for (const int step : {-1, 1, -columns_, columns_}) {
      const int k = i + step;
      if (k >= 0 && k < columns_ * rows_ && open[static_cast<std::size_t>(k)] != 0)
        return true;
    }
    return false;
  }
  void flood() {
    island_.assign(cells(), 0);
    int islands = 0;
    std::size_t largest_size = 0;
    std::vector<int> queue;
    for (int start = 0; start < columns_ * rows_; ++start) {
      const auto s = static_cast<std::size_t>(start);
      if (free_[s] == 0 || island_[s] != 0) continue;
      island_[s] = ++islands;
      queue.assign(1, start);
      for (std::size_t k = 0; k < queue.size(); ++k) {
        for (const int step : {-1, 1, -columns_, columns_}) {
          const int next = queue[k] + step;
          if (next < 0 || next >= columns_ * rows_) continue;
          const auto n = static_cast<std::size_t>(next);
          if (free_[n] == 0 || island_[n] != 0) continue;
          island_[n] = islands;
          queue.push_back(next);
        }
      }
      if (queue.size() > largest_size) {
        largest_size = queue.size();
        largest_ = islands;
      }
    }
  }

  const Home& home_;
  glm::vec2 low_{1e9F}, high_{-1e9F};
  int columns_ = 0, rows_ = 0, largest_ = 0;
  std::vector<std::uint8_t> free_;
  std::vector<int> island_;
};

const std::string& class_of_piece(const Home& home, const core::SceneInstance& piece) {
  return home.scene.classes[piece.class_id - 1U].name;
}

/// Everything that is wrong with a home; empty if nothing is.
std::vector<std::string> faults_of(const Home& home) {
  std::vector<std::string> faults;
  const FloorOracle floor(home);
  for (const FlatRoom& room : home.rooms) {
    if (floor.reached(room.min_m, room.max_m, 0.0F) < 40) {
      faults.push_back("a robot does not get into the " + room.name);
    }
  }
  for (const FlatRoom& door : home.doors) {
    const glm::vec2 size = door.max_m - door.min_m;
    if (std::max(size.x, size.y) < 1.05F - 1e-4F) faults.push_back("a door is too narrow");
  }
  const auto& goals = flat_goal_class_names();
  const std::vector<core::SceneInstance>& pieces = home.scene.instances;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const core::SceneInstance& a = pieces[i];
    const std::string& name = class_of_piece(home, a);
    const bool stands = a.box_min_m.z < 0.05 && a.box_max_m.z > 0.06;
    if (std::find(goals.begin(), goals.end(), name) != goals.end() &&
        (stands || name != "potted plant") &&
        floor.reached(glm::vec2(a.box_min_m), glm::vec2(a.box_max_m), 0.8F) == 0) {
      faults.push_back(a.name + " cannot be reached");
    }
    const bool inside = std::any_of(home.rooms.begin(), home.rooms.end(), [&](const auto& r) {
      const double slack = name == "door" ? 0.2 : 0.01;
      return a.box_min_m.x > static_cast<double>(r.min_m.x) - slack &&
             a.box_min_m.y > static_cast<double>(r.min_m.y) - slack &&
             a.box_max_m.x < static_cast<double>(r.max_m.x) + slack &&
             a.box_max_m.y < static_cast<double>(r.max_m.y) + slack;
    });
    if (!inside) faults.push_back(a.name + " is in no room");
    if (a.box_max_m.z > 2.6 + 1e-3) faults.push_back(a.name + " goes through the ceiling");
    if (!stands) continue;
    for (std::size_t k = i + 1; k < pieces.size(); ++k) {
      const core::SceneInstance& b = pieces[k];
      if (b.box_min_m.z >= 0.05 || b.box_max_m.z <= 0.06) continue;
      const std::string& other = class_of_piece(home, b);
      // Chairs are pushed below tables.
      if ((name == "chair" && is_table(other)) || (other == "chair" && is_table(name)))
        continue;
      const glm::dvec2 overlap = glm::min(glm::dvec2(a.box_max_m), glm::dvec2(b.box_max_m)) -
                                 glm::max(glm::dvec2(a.box_min_m), glm::dvec2(b.box_min_m));
      if (std::min(overlap.x, overlap.y) > 0.02) {
        faults.push_back(a.name + " stands in " + b.name);
      }
    }
  }
  return faults;
}

double area_m2(const Home& home) {
  double area = 0.0;
  for (const FlatRoom& room : home.rooms) {
    const glm::vec2 size = room.max_m - room.min_m;
    area += static_cast<double>(size.x * size.y);
  }
  return area;
}

/// SEGSIM_HOME_SEEDS says how many; a thousand take minutes on a busy machine.
int seed_count() {
  const char* count = std::getenv("SEGSIM_HOME_SEEDS");
  return count != nullptr ? std::atoi(count) : 120;
}

TEST(ProceduralHome, EverySeedIsValid) {
  const int seeds = seed_count();
  std::vector<std::vector<std::string>> faults(static_cast<std::size_t>(seeds));
  std::vector<double> areas_m2(static_cast<std::size_t>(seeds));
  const auto check = [&](int first) {
    for (int seed = first; seed < seeds; seed += 2) {
      HomeOptions options;
      options.seed = static_cast<std::uint64_t>(seed);
      options.boxes = true;
      if (seed % 4 != 3) options.models = installed_models();
      options.pool = seed % 4 == 2 ? FurniturePool::kUnseen : FurniturePool::kTrain;
      const auto i = static_cast<std::size_t>(seed);
      try {
        const Home home = shapes(options);
        faults[i] = faults_of(home);
        areas_m2[i] = area_m2(home);
      } catch (const core::InputError& error) {
        faults[i].push_back(error.what());
      }
    }
  };
  static_cast<void>(installed_models());
  std::thread odd(check, 1);
  check(0);
  odd.join();
  for (int seed = 0; seed < seeds; ++seed) {
    const auto i = static_cast<std::size_t>(seed);
    EXPECT_THAT(faults[i], testing::IsEmpty()) << "seed " << seed;
    EXPECT_GE(areas_m2[i], 30.0) << "seed " << seed;
    EXPECT_LE(areas_m2[i], 250.0) << "seed " << seed;
  }
}

TEST(ProceduralHome, NumberOfRoomsIsKept) {
  for (int rooms = 1; rooms <= 8; ++rooms) {
    const Home home = shapes({.seed = 2, .plan = HomePlan::kApartment, .rooms = rooms});
    const auto inhabited = std::count_if(home.rooms.begin(), home.rooms.end(),
                                         [](const FlatRoom& r) { return r.name != "hall"; });
    EXPECT_EQ(inhabited, rooms);
    EXPECT_GE(static_cast<int>(home.doors.size()), rooms - 1);
  }
}

TEST(ProceduralHome, PlansHaveTheirRooms) {
  const auto names = [](const Home& home) {
    std::multiset<std::string> all;
    for (const FlatRoom& room : home.rooms) all.insert(room.name);
    return all;
  };
  const auto office = names(shapes({.seed = 1, .plan = HomePlan::kOffice}));
  EXPECT_EQ(office.count("meeting room"), 1U);
  EXPECT_GE(office.count("office"), 1U);
  const auto ward = names(shapes({.seed = 1, .plan = HomePlan::kWard}));
  EXPECT_EQ(ward.count("hall"), 2U) << "two wings";
  EXPECT_GE(ward.count("ward"), 2U);
}

TEST(ProceduralHome, WhatItHasNotIsOneLine) {
  EXPECT_THROW(static_cast<void>(shapes({.plan = HomePlan::kWard, .rooms = 2})),
               core::InputError);
  EXPECT_THROW(static_cast<void>(shapes({.rooms = 9})), core::InputError);
}

TEST(ProceduralHome, ApartmentsContainGoals) {
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const Home home = shapes({.seed = seed, .plan = HomePlan::kApartment, .rooms = 5});
    for (const std::string& goal : flat_goal_class_names()) {
      EXPECT_TRUE(
          std::any_of(home.scene.instances.begin(), home.scene.instances.end(),
                      [&](const auto& piece) { return class_of_piece(home, piece) == goal; }))
          << goal << ", seed " << seed;
    }
  }
}

TEST(ProceduralHome, SomeDoorsAreHalfOpen) {
  // Seen from above, the leaf of a half open door stands across its wall.
  int half_open = 0;
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    const Home home = shapes({.seed = seed, .plan = HomePlan::kApartment, .rooms = 6});
    for (const core::SceneInstance& piece : home.scene.instances) {
      if (class_of_piece(home, piece) != "door") continue;
      const glm::dvec3 size = piece.box_max_m - piece.box_min_m;
      const glm::vec2 middle = 0.5F * glm::vec2(piece.box_min_m + piece.box_max_m);
      const bool in_room =
          std::any_of(home.rooms.begin(), home.rooms.end(), [&](const auto& r) {
            const glm::vec2 to_wall = glm::min(middle - r.min_m, r.max_m - middle);
            return std::min(to_wall.x, to_wall.y) > 0.3F;
          });
      half_open += in_room && std::max(size.x, size.y) > 0.9 ? 1 : 0;
    }
  }
  EXPECT_GE(half_open, 5);
}

TEST(ProceduralHome, EqualSeedsGiveEqualHomes) {
  const auto hash = [](const Home& home) {
    std::uint64_t value = home.scene.meshes.size();
    for (const sim::SubMesh& mesh : home.scene.meshes) {
      value = core::hash64({reinterpret_cast<const char*>(mesh.positions_m.data()),
                            mesh.positions_m.size() * sizeof(glm::vec3)},
                           value);
    }
    return value;
  };
  EXPECT_EQ(hash(shapes({.seed = 11})), hash(shapes({.seed = 11})));
  EXPECT_NE(hash(shapes({.seed = 11})), hash(shapes({.seed = 12})));
}

TEST(ProceduralHome, ModelsOfThePackageStandInItAndAreCredited) {
  if (installed_models().empty()) GTEST_SKIP() << "sweethome3d-furniture is not installed";
  HomeOptions options{.seed = 1, .plan = HomePlan::kApartment, .rooms = 3};
  options.models = installed_models();
  const Home boxes = shapes({options.seed, options.plan, options.rooms, options.models,
                             FurniturePool::kTrain, true, true});
  const Home home = shapes(options);
  EXPECT_GT(home.credits.size(), 5U);
  for (const std::string& credit : home.credits) EXPECT_THAT(credit, testing::HasSubstr("#"));
  EXPECT_EQ(home.credits, boxes.credits);
  EXPECT_GT(home.scene.triangle_count(), 3 * boxes.scene.triangle_count());
  EXPECT_THAT(faults_of(home), testing::IsEmpty());
}

}  // namespace
}  // namespace segsim::worlds
