/// Walls, floors, ceilings, windows, doors and lamps of a flat.

#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/common.hpp>

#include "worlds/procedural/internal/floor_plan.h"

namespace segsim::worlds::internal {
namespace {

/// A room's wall seen from inside: maps (coordinate along, depth outwards, height) to the
/// world.
struct WallFrame {
  const Room& room;
  Side side;

  [[nodiscard]] glm::vec3 at(float along, float depth, float z) const {
    glm::vec3 p(0.0F, 0.0F, z);
    const int axis = axis_along(side);
    p[axis] = along;
    p[1 - axis] = room.wall_m(side) + depth * outward(side)[1 - axis];
    return p;
  }
  /// +1 if, seen from inside, coordinates along the wall grow to the right.
  [[nodiscard]] float right() const { return side == kNorth || side == kWest ? 1.0F : -1.0F; }

  /// Face at `depth`, seen from inside.
  void add_face(MeshBuilder& mesh, float a0, float a1, float z0, float z1, float depth,
                bool stretched = false) const {
    if (a1 - a0 < 1e-3F || z1 - z0 < 1e-3F) return;
    const float from = right() > 0.0F ? a0 : a1, to = right() > 0.0F ? a1 : a0;
    mesh.add_quad(at(from, depth, z0), at(to, depth, z0) - at(from, depth, z0),
                  {0, 0, z1 - z0}, stretched);
  }
  void add_bar(MeshBuilder& mesh, float a0, float a1, float z0, float z1, float depth0,
               float depth1) const {
    if (a1 - a0 < 1e-3F || z1 - z0 < 1e-3F) return;
    const glm::vec3 p = at(a0, depth0, z0), q = at(a1, depth1, z1);
    mesh.add_box(0.5F * (p + q), glm::abs(q - p));
  }
};

struct Shell {
  MeshBuilder walls, floors, ceilings, windows;
};

std::vector<Opening> openings_of(const Room& room, Side side) {
  std::vector<Opening> openings;
  for (const Opening& opening : room.openings) {
    if (opening.side == side) openings.push_back(opening);
  }
  std::sort(openings.begin(), openings.end(),
            [](const Opening& a, const Opening& b) { return a.center_m < b.center_m; });
  return openings;
}

/// The four (or three) faces inside a hole of the wall.
void add_reveal(MeshBuilder& mesh, const WallFrame& wall, const Opening& o, float depth) {
  const float a0 = o.center_m - 0.5F * o.width_m, a1 = o.center_m + 0.5F * o.width_m;
  const glm::vec3 in = wall.at(0, depth, 0) - wall.at(0, 0, 0), up(0, 0, o.head_m - o.sill_m);
  const glm::vec3 along = wall.at(o.width_m, 0, 0) - wall.at(0, 0, 0);
  const auto facing = [&](const glm::vec3& origin, const glm::vec3& u, const glm::vec3& v,
                          const glm::vec3& normal) {
    glm::dot(glm::cross(u, v), normal) > 0.0F ? mesh.add_quad(origin, u, v)
                                              : mesh.add_quad(origin, v, u);
  };
  facing(wall.at(a0, 0, o.sill_m), in, up, along);
  facing(wall.at(a1, 0, o.sill_m), in, up, -along);
  facing(wall.at(a0, 0, o.head_m), in, along, {0, 0, -1});
  if (o.sill_m > 0.0F) facing(wall.at(a0, 0, o.sill_m), in, along, {0, 0, 1});
}

void add_window(Shell& shell, const WallFrame& wall, const Opening& o, const Surface& frame,
                const Surface& view) {
  constexpr float kDepth_m = 0.1F, kBar_m = 0.05F;
  const float a0 = o.center_m - 0.5F * o.width_m, a1 = o.center_m + 0.5F * o.width_m;
  shell.walls.set_surface(frame);
  add_reveal(shell.walls, wall, o, kDepth_m);
  wall.add_bar(shell.walls, a0 - 0.04F, a1 + 0.04F, o.sill_m - 0.03F, o.sill_m, -0.06F, 0.0F);
  shell.windows.set_surface(view);
  wall.add_face(shell.windows, a0, a1, o.sill_m, o.head_m, kDepth_m, true);
  shell.windows.set_surface(frame);
  const auto bar = [&](float b0, float b1, float z0, float z1) {
    wall.add_bar(shell.windows, b0, b1, z0, z1, kDepth_m - 0.04F, kDepth_m - 0.005F);
  };
  bar(a0, a1, o.sill_m, o.sill_m + kBar_m);
  bar(a0, a1, o.head_m - kBar_m, o.head_m);
  const int panes = o.width_m > 1.0F ? 2 : 1;
  for (int i = 0; i <= panes; ++i) {
    const float a =
        glm::mix(a0, a1 - kBar_m, static_cast<float>(i) / static_cast<float>(panes));
    bar(a, a + kBar_m, o.sill_m, o.head_m);
  }
}

void add_casing(MeshBuilder& mesh, const WallFrame& wall, const Opening& o) {
  constexpr float kWidth_m = 0.07F, kOut_m = -0.018F;
  const float a0 = o.center_m - 0.5F * o.width_m, a1 = o.center_m + 0.5F * o.width_m;
  wall.add_bar(mesh, a0 - kWidth_m, a0, 0.0F, o.head_m + kWidth_m, kOut_m, 0.0F);
  wall.add_bar(mesh, a1, a1 + kWidth_m, 0.0F, o.head_m + kWidth_m, kOut_m, 0.0F);
  wall.add_bar(mesh, a0, a1, o.head_m, o.head_m + kWidth_m, kOut_m, 0.0F);
}

class ShellBuilder {
 public:
  ShellBuilder(sim::MeshScene& scene, SurfaceLibrary& surfaces, Dice& dice,
               FurnitureStyle style)
      : scene_(scene),
        surfaces_(surfaces),
        dice_(dice),
        style_(style),
        door_seed_(dice.seed()),
        trim_(surfaces.plain(glm::vec3(dice.between(0.82F, 0.93F)))) {
    dry_floor_ =
        floor_surface(dice.chance(0.5F) ? TextureKind::kPlanks : TextureKind::kParquet);
  }

  void add_room(const Room& room) {
    const Surface wall = wall_surface(room.type), floor = room_floor(room.type);
    const glm::vec2 size = room.rect.size_m();
    const glm::vec3 low(room.rect.min_m, 0.0F);
    shell_.floors.set_surface(floor);
    shell_.floors.add_quad(low, {size.x, 0, 0}, {0, size.y, 0});
    shell_.ceilings.set_surface(surfaces_.plain(glm::vec3(0.93F)));
    shell_.ceilings.add_quad({low.x, low.y, kWallHeight_m}, {0, size.y, 0}, {size.x, 0, 0});
    for (const Side side : {kSouth, kEast, kNorth, kWest}) add_wall({room, side}, wall, floor);
    add_lights(room);
  }

  void finish(bool ceiling) {
    const auto add = [&](const MeshBuilder& mesh, ProceduralClass class_id) {
      for (sim::SubMesh& part :
           mesh.build(glm::mat4(1.0F), static_cast<std::uint16_t>(class_id), 0))
        scene_.meshes.push_back(std::move(part));
    };
    add(shell_.walls, ProceduralClass::kWall);
    add(shell_.floors, ProceduralClass::kFloor);
    if (ceiling) add(shell_.ceilings, ProceduralClass::kCeiling);
    add(shell_.windows, ProceduralClass::kWindow);
  }

 private:
  Surface floor_surface(TextureKind kind) {
    if (kind == TextureKind::kTiles) {
      const glm::vec3 a = hsv(dice_.between(0.05F, 0.6F), dice_.between(0.02F, 0.2F),
                              dice_.between(0.55F, 0.85F));
      const glm::vec3 b = dice_.chance(0.4F) ? a * dice_.between(0.45F, 0.75F) : a;
      return surfaces_.textured({kind, {a, b, glm::vec3(0.5F)}, 256, dice_.seed()},
                                dice_.between(1.2F, 1.8F));
    }
    const glm::vec3 a =
        hsv(dice_.between(0.06F, 0.1F), dice_.between(0.3F, 0.55F), dice_.between(0.5F, 0.8F));
    return surfaces_.textured({kind, {a, 0.78F * a, 0.6F * a}, 512, dice_.seed()},
                              kind == TextureKind::kPlanks ? 1.4F : 1.6F);
  }

  Surface room_floor(RoomType type) {
    if (type == RoomType::kKitchen || type == RoomType::kBathroom)
      return floor_surface(TextureKind::kTiles);
    if ((type == RoomType::kBedroom || type == RoomType::kSecondBedroom) &&
        dice_.chance(0.4F)) {
      const glm::vec3 a = hsv(dice_.between(0.0F, 1.0F), dice_.between(0.05F, 0.25F),
                              dice_.between(0.5F, 0.75F));
      return surfaces_.textured({TextureKind::kCarpet, {a, 0.8F * a, a}, 256, dice_.seed()},
                                1.0F);
    }
    return dry_floor_;
  }

  Surface wall_surface(RoomType type) {
    const glm::vec3 a = hsv(dice_.between(0.0F, 1.0F), dice_.between(0.02F, 0.25F),
                            dice_.between(0.78F, 0.93F));
    if (style_ == FurnitureStyle::kSource) return surfaces_.plain(a);
    if (type == RoomType::kBathroom) {
      return surfaces_.textured(
          {TextureKind::kTiles, {a, 0.97F * a, glm::vec3(0.7F)}, 256, dice_.seed()}, 0.8F);
    }
    const bool paper =
        type != RoomType::kKitchen && type != RoomType::kHall && dice_.chance(0.3F);
    return surfaces_.textured({paper ? TextureKind::kWallpaper : TextureKind::kPlaster,
                               {a, paper ? 0.88F * a : 0.93F * a, 0.7F * a},
                               256,
                               dice_.seed()},
                              paper ? 0.8F : 2.0F);
  }

  void add_wall(const WallFrame& wall, const Surface& surface, const Surface& floor) {
    const int along = axis_along(wall.side);
    float from = wall.room.rect.min_m[along];
    const float end = wall.room.rect.max_m[along];
    MeshBuilder& walls = shell_.walls;
    const auto solid = [&](float a0, float a1) {
      walls.set_surface(surface);
      wall.add_face(walls, a0, a1, 0.0F, kWallHeight_m, 0.0F);
      walls.set_surface(trim_);
      wall.add_bar(walls, a0, a1, 0.0F, 0.07F, -0.012F, 0.0F);
    };
    for (const Opening& o : openings_of(wall.room, wall.side)) {
      const float a0 = o.center_m - 0.5F * o.width_m, a1 = o.center_m + 0.5F * o.width_m;
      solid(from, a0);
      from = a1;
      walls.set_surface(surface);
      wall.add_face(walls, a0, a1, o.head_m, kWallHeight_m, 0.0F);
      wall.add_face(walls, a0, a1, 0.0F, o.sill_m, 0.0F);
      if (o.kind == OpeningKind::kWindow) {
        add_window(shell_, wall, o, trim_, view_surface());
        add_window_light(wall, o);
      } else {
        walls.set_surface(trim_);
        add_casing(walls, wall, o);
        if (o.kind == OpeningKind::kEntrance || o.owns_passage)
          add_reveal(walls, wall, o, kWallThickness_m);
        shell_.floors.set_surface(floor);
        if (o.owns_passage) add_threshold(wall, o);
        add_door(wall, o);
      }
    }
    solid(from, end);
  }

  void add_threshold(const WallFrame& wall, const Opening& o) {
    const glm::vec3 p = wall.at(o.center_m - 0.5F * o.width_m, 0, 0),
                    q = wall.at(o.center_m + 0.5F * o.width_m, kWallThickness_m, 0);
    const glm::vec3 low = glm::min(p, q), size = glm::abs(q - p);
    shell_.floors.add_quad(low, {size.x, 0, 0}, {0, size.y, 0});
  }

  void add_door(const WallFrame& wall, const Opening& o) {
    const bool entrance = o.kind == OpeningKind::kEntrance;
    if (!entrance && o.leaf_side == 0) return;
    const float width = entrance ? o.width_m - 0.01F : o.width_m - 0.04F;
    const Furniture leaf =
        make_furniture(FurnitureKind::kDoorLeaf, style_,
                       entrance ? door_seed_ + 1 : door_seed_, surfaces_, {width});
    if (!entrance && o.leaf_angle_rad < 0.99F * std::numbers::pi_v<float>) {
      const DoorLeaf place = door_leaf(wall.room, o);
      const glm::vec2 along = place.tip_m - place.hinge_m;
      add_instance(scene_, leaf, {0.5F * (place.hinge_m + place.tip_m), 0.0F},
                   std::atan2(along.y, along.x));
      return;
    }
    const float middle = o.center_m + static_cast<float>(o.leaf_side) * (o.width_m + 0.03F);
    const float depth = entrance ? 0.09F : -0.5F * leaf.size_m().y - 0.02F;
    add_instance(scene_, leaf, wall.at(entrance ? o.center_m : middle, depth, 0),
                 yaw_against_rad(wall.side));
  }

  Surface view_surface() {
    return surfaces_.textured(
        {TextureKind::kView,
         {glm::vec3(0.8F, 0.7F, 0.6F), glm::vec3(0.6F), glm::vec3(0.5F)},
         256,
         3 * (door_seed_ % 1000) + static_cast<std::uint64_t>(dice_.count(0, 1))},
        1.0F, glm::vec3(0.12F, 0.14F, 0.17F));
  }

  void add_window_light(const WallFrame& wall, const Opening& o) {
    sim::PointLight light;
    light.position_m = wall.at(o.center_m, -0.3F, 0.5F * (o.sill_m + o.head_m) + 0.1F);
    light.radiance = dice_.between(0.5F, 0.9F) * o.width_m * glm::vec3(0.85F, 0.94F, 1.08F);
    light.radius_m = 0.4F;
    scene_.lights.push_back(light);
  }

  void add_lights(const Room& room) {
    const glm::vec2 size = room.rect.size_m();
    const int long_axis = size.x > size.y ? 0 : 1;
    const int count = size[long_axis] > 5.0F || size.x * size.y > 19.0F ? 2 : 1;
    const glm::vec3 colour =
        dice_.pick({glm::vec3(1.0F, 0.82F, 0.62F), glm::vec3(1.0F, 0.9F, 0.76F),
                    glm::vec3(1.0F, 0.97F, 0.92F), glm::vec3(0.9F, 0.96F, 1.05F)});
    const float strength = dice_.between(2.4F, 4.2F) * (count == 2 ? 0.75F : 1.0F);
    const Furniture lamp =
        make_furniture(FurnitureKind::kCeilingLamp, style_, dice_.seed(), surfaces_);
    for (int i = 0; i < count; ++i) {
      glm::vec3 at(room.rect.center_m(), kWallHeight_m);
      if (count == 2) at[long_axis] += (static_cast<float>(i) - 0.5F) * 0.5F * size[long_axis];
      add_instance(scene_, lamp, at, 0.0F);
      sim::PointLight light;
      light.position_m = {at.x, at.y, kWallHeight_m - 0.4F};
      light.radiance = strength * colour;
      light.radius_m = 0.2F;
      scene_.lights.push_back(light);
    }
  }

  sim::MeshScene& scene_;
  SurfaceLibrary& surfaces_;
  Dice& dice_;
  FurnitureStyle style_;
  std::uint64_t door_seed_;
  Surface trim_, dry_floor_;
  Shell shell_;
};

}  // namespace

void build_shell(sim::MeshScene& scene, const std::vector<Room>& rooms,
                 SurfaceLibrary& surfaces, Dice& dice, FurnitureStyle style, bool ceiling) {
  ShellBuilder builder(scene, surfaces, dice, style);
  for (const Room& room : rooms) builder.add_room(room);
  builder.finish(ceiling);
}

}  // namespace segsim::worlds::internal
