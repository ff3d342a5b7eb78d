#include "worlds/procedural/internal/room_placer.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>

namespace segsim::worlds::internal {
namespace {

constexpr float kWallGap_m = 0.02F;   // Behind furniture: the skirting.
constexpr float kDoorZone_m = 0.95F;  // Kept free inside each doorway.
constexpr float kPosition_m = 0.1F;   // Between candidate places.
constexpr float kHalfPi = 0.5F * std::numbers::pi_v<float>;
constexpr float kStraight_rad = 0.99F * std::numbers::pi_v<float>;

glm::vec2 turned(const glm::vec2& v, float yaw_rad) {
  const float c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  return {c * v.x - s * v.y, s * v.x + c * v.y};
}

Rect grown(const Rect& rect, float by_m) { return {rect.min_m - by_m, rect.max_m + by_m}; }

Rect joined(const Rect& a, const Rect& b) {
  return {glm::min(a.min_m, b.min_m), glm::max(a.max_m, b.max_m)};
}

/// Part of the floor in front of an opening.
Rect zone_of(const Room& room, const Opening& opening, float width_m, float depth_m,
             float center_m) {
  const int along = axis_along(opening.side), across = 1 - along;
  Rect zone;
  zone.min_m[along] = center_m - 0.5F * width_m;
  zone.max_m[along] = center_m + 0.5F * width_m;
  const float wall = room.wall_m(opening.side),
              inside = wall - depth_m * outward(opening.side)[across];
  zone.min_m[across] = std::min(wall, inside);
  zone.max_m[across] = std::max(wall, inside);
  return zone;
}

/// Where one stands after coming in.
glm::vec2 entry_of(const Room& room, const Opening& opening) {
  const int along = axis_along(opening.side), across = 1 - along;
  glm::vec2 entry(0.0F);
  entry[along] = opening.center_m;
  entry[across] = room.wall_m(opening.side) - 0.5F * outward(opening.side)[across];
  return entry;
}

template <class T>
void shuffle(std::vector<T>& items, Dice& dice) {
  for (std::size_t i = items.size(); i > 1; --i) {
    std::swap(items[i - 1],
              items[static_cast<std::size_t>(dice.count(0, static_cast<int>(i) - 1))]);
  }
}

}  // namespace

Piece& Group::add(Furniture furniture, const glm::vec3& position_m, float yaw_rad,
                  bool blocks) {
  const bool goal = blocks && [&] {
    const auto& names = flat_goal_class_names();
    return std::find(names.begin(), names.end(), class_name(furniture.class_id)) !=
           names.end();
  }();
  pieces.push_back({std::move(furniture), position_m, yaw_rad, blocks, goal});
  return pieces.back();
}

Rect Group::footprint() const {
  Rect all{glm::vec2(1e9F), glm::vec2(-1e9F)};
  for (const Piece& piece : pieces) {
    if (piece.blocks) all = joined(all, footprint_of(piece));
  }
  return all;
}

float Group::height_m() const {
  float height = 0.0F;
  for (const Piece& piece : pieces)
    height = std::max(height, piece.position_m.z + piece.furniture.mesh.max_m().z);
  return height;
}

Rect footprint_of(const Piece& piece, const glm::vec2& offset_m, float yaw_rad) {
  const glm::vec3 low = piece.furniture.mesh.min_m(), high = piece.furniture.mesh.max_m();
  Rect rect{glm::vec2(1e9F), glm::vec2(-1e9F)};
  for (const float x : {low.x, high.x}) {
    for (const float y : {low.y, high.y}) {
      const glm::vec2 in_group = turned({x, y}, piece.yaw_rad) + glm::vec2(piece.position_m);
      const glm::vec2 p = turned(in_group, yaw_rad) + offset_m;
      rect = joined(rect, {p, p});
    }
  }
  return rect;
}

RoomPlacer::RoomPlacer(sim::MeshScene& scene, const Room& room, Dice& dice)
    : scene_(scene),
      room_(room),
      dice_(dice),
      columns_(static_cast<int>(room.rect.size_m().x / kGridCell_m)),
      rows_(static_cast<int>(room.rect.size_m().y / kGridCell_m)) {
  for (int y = 0; y < rows_; ++y) {
    for (int x = 0; x < columns_; ++x) {
      const glm::vec2 p = cell_center_m(x, y);
      const glm::vec2 to_wall = glm::min(p - room.rect.min_m, room.rect.max_m - p);
      clearance_m_.push_back(std::min(to_wall.x, to_wall.y));
    }
  }
  for (const Opening& o : room.openings) {
    if (o.kind == OpeningKind::kWindow) continue;
    reserved_.push_back(zone_of(room, o, o.width_m + 0.1F, kDoorZone_m, o.center_m));
    if (o.kind == OpeningKind::kDoorway) {
      entries_m_.push_back(entry_of(room, o));
    }
    if (o.leaf_side != 0 && o.leaf_angle_rad < kStraight_rad) {
      const Rect leaf = door_leaf(room, o).footprint();
      blocked_.push_back(leaf);
      heights_.emplace_back(leaf, kDoorHeight_m);
    } else if (o.leaf_side != 0) {
      const float middle = o.center_m + static_cast<float>(o.leaf_side) * (o.width_m + 0.03F);
      const Rect leaf = zone_of(room, o, o.width_m, 0.17F, middle);
      blocked_.push_back(leaf);
      heights_.emplace_back(leaf, kDoorHeight_m);
    }
  }
  // A home of one room is entered from outside.
  for (const Opening& o : room.openings) {
    if (o.kind == OpeningKind::kEntrance && entries_m_.empty()) {
      entries_m_.push_back(entry_of(room, o));
    }
  }
  for (const Rect& rect : blocked_) lower_clearance(rect);
}

void RoomPlacer::lower_clearance(const Rect& rect) {
  for (int k = 0; k < columns_ * rows_; ++k) {
    float& clearance = clearance_m_[static_cast<std::size_t>(k)];
    clearance =
        std::min(clearance, rect.distance_m(cell_center_m(k % columns_, k / columns_)));
  }
}

glm::vec2 RoomPlacer::cell_center_m(int x, int y) const {
  return room_.rect.min_m +
         kGridCell_m * glm::vec2(static_cast<float>(x) + 0.5F, static_cast<float>(y) + 0.5F);
}

/// Calls `visit` for all cells whose centre may be so near to the rectangle, and a few others.
template <class Visit>
void RoomPlacer::for_cells_near(const Rect& rect, float distance_m, const Visit& visit) const {
  const glm::vec2 low = (rect.min_m - distance_m - room_.rect.min_m) / kGridCell_m - 1.0F,
                  high = (rect.max_m + distance_m - room_.rect.min_m) / kGridCell_m + 1.0F;
  const int x_end = std::min(columns_, static_cast<int>(high.x) + 1),
            y_end = std::min(rows_, static_cast<int>(high.y) + 1);
  for (int y = std::max(0, static_cast<int>(low.y)); y < y_end; ++y) {
    for (int x = std::max(0, static_cast<int>(low.x)); x < x_end; ++x) visit(x, y);
  }
}

/// With `rects` added: are all doorways connected and all goals reachable?
bool RoomPlacer::walkable(const std::vector<Rect>& rects,
                          const std::vector<Rect>& goals) const {
  std::vector<std::uint8_t> state(clearance_m_.size(), 0);  // 1 = free, 2 = reached.
  for (std::size_t i = 0; i < state.size(); ++i) state[i] = clearance_m_[i] >= kPassRadius_m;
  for (const Rect& rect : rects) {
    for_cells_near(rect, kPassRadius_m, [&](int x, int y) {
      if (rect.distance_m(cell_center_m(x, y)) < kPassRadius_m) {
        state[static_cast<std::size_t>(y * columns_ + x)] = 0;
      }
    });
  }
  std::vector<int> stack;
  for (std::size_t e = 0; e < entries_m_.size(); ++e) {
    const glm::vec2 cell = (entries_m_[e] - room_.rect.min_m) / kGridCell_m;
    const int index = std::clamp(static_cast<int>(cell.y), 0, rows_ - 1) * columns_ +
                      std::clamp(static_cast<int>(cell.x), 0, columns_ - 1);
    std::uint8_t& s = state[static_cast<std::size_t>(index)];
    if (e > 0) {
      if (s != 2) return false;
      continue;
    }
    if (s != 1) return false;
    s = 2;
    stack.push_back(index);
    while (!stack.empty()) {
      const int i = stack.back();
      stack.pop_back();
      const int x = i % columns_, y = i / columns_;
      const auto visit = [&](int nx, int ny) {
        if (nx < 0 || ny < 0 || nx >= columns_ || ny >= rows_) return;
        std::uint8_t& neighbour = state[static_cast<std::size_t>(ny * columns_ + nx)];
        if (neighbour != 1) return;
        neighbour = 2;
        stack.push_back(ny * columns_ + nx);
      };
      visit(x - 1, y);
      visit(x + 1, y);
      visit(x, y - 1);
      visit(x, y + 1);
    }
  }
  const auto reachable = [&](const Rect& goal) {
    bool found = false;
    for_cells_near(goal, kReach_m, [&](int x, int y) {
      found = found || (state[static_cast<std::size_t>(y * columns_ + x)] == 2 &&
                        goal.distance_m(cell_center_m(x, y)) <= kReach_m);
    });
    return found;
  };
  return std::all_of(goals_.begin(), goals_.end(), reachable) &&
         std::all_of(goals.begin(), goals.end(), reachable);
}

bool RoomPlacer::try_place(const Group& group, const glm::vec2& offset_m, float yaw_rad,
                           float front_m) {
  std::vector<Rect> rects, goals;
  for (const Piece& piece : group.pieces) {
    const Rect rect = footprint_of(piece, offset_m, yaw_rad);
    if ((piece.blocks || room_.all_inside) && !room_.rect.contains(rect)) return false;
    if (!piece.blocks) {
      // Seen from the end of a long stand, a television is far away.
      const bool is_tv = piece.furniture.class_id == ProceduralClass::kTv;
      if (is_tv && room_.all_inside) goals.push_back(rect);
      continue;
    }
    const auto hits = [&](const Rect& other) { return rect.overlaps(other); };
    if (std::any_of(blocked_.begin(), blocked_.end(), hits) ||
        std::any_of(reserved_.begin(), reserved_.end(), hits))
      return false;
    rects.push_back(rect);
    if (piece.goal) goals.push_back(rect);
  }
  Rect front;
  if (front_m > 0.0F) {
    const Rect body = group.footprint();
    const Rect local{{body.min_m.x, body.min_m.y - front_m}, {body.max_m.x, body.min_m.y}};
    const glm::vec2 a = turned(local.min_m, yaw_rad) + offset_m,
                    b = turned(local.max_m, yaw_rad) + offset_m;
    front = {glm::min(a, b) + 0.01F, glm::max(a, b) - 0.01F};
    if (!room_.rect.contains(front)) return false;
    if (std::any_of(blocked_.begin(), blocked_.end(),
                    [&](const Rect& other) { return front.overlaps(other); }))
      return false;
  }
  if (!walkable(rects, goals)) return false;

  for (const Rect& rect : rects) {
    blocked_.push_back(rect);
    lower_clearance(rect);
  }
  goals_.insert(goals_.end(), goals.begin(), goals.end());
  if (front_m > 0.0F) reserved_.push_back(front);
  for (const Piece& piece : group.pieces) {
    const glm::vec2 at = turned(glm::vec2(piece.position_m), yaw_rad) + offset_m;
    add_instance(scene_, piece.furniture, {at.x, at.y, piece.position_m.z},
                 yaw_rad + piece.yaw_rad);
    heights_.emplace_back(footprint_of(piece, offset_m, yaw_rad),
                          piece.position_m.z + piece.furniture.mesh.max_m().z);
    if (!piece.furniture.credit.empty()) credits_.push_back(piece.furniture.credit);
  }
  last_m_ = offset_m;
  return true;
}

bool RoomPlacer::at_wall(const Group& group, const WallPlace& place, Side* side_used) {
  std::vector<Side> sides = place.sides;
  if (place.shuffle) shuffle(sides, dice_);
  const Rect body = group.footprint();
  const bool tall = group.height_m() > 1.0F;
  for (const Side side : sides) {
    const int along = axis_along(side), across = 1 - along;
    const float yaw = yaw_against_rad(side);
    // The body's middle and back after turning, relative to the group's origin.
    const float half = 0.5F * body.size_m().x;
    const glm::vec2 middle = turned({body.center_m().x, body.max_m.y}, yaw);
    std::vector<float> places;
    const float lo = room_.rect.min_m[along] + half + 0.03F,
                hi = room_.rect.max_m[along] - half - 0.03F;
    for (float t = lo; t <= hi; t += kPosition_m) places.push_back(t);
    if (hi >= lo) places.push_back(hi);
    shuffle(places, dice_);
    if (place.corner) {
      std::stable_sort(places.begin(), places.end(), [&](float a, float b) {
        return std::min(a - lo, hi - a) < std::min(b - lo, hi - b);
      });
    } else if (place.near_m > -1e8F) {
      std::stable_sort(places.begin(), places.end(), [&](float a, float b) {
        return std::abs(a - place.near_m) < std::abs(b - place.near_m);
      });
    }
    for (const float t : places) {
      const bool hides_window =
          tall &&
          std::any_of(room_.openings.begin(), room_.openings.end(), [&](const Opening& o) {
            return o.kind == OpeningKind::kWindow && o.side == side &&
                   std::abs(o.center_m - t) < 0.5F * o.width_m + half;
          });
      if (hides_window) continue;
      glm::vec2 offset(0.0F);
      offset[along] = t - middle[along];
      offset[across] =
          room_.wall_m(side) - kWallGap_m * outward(side)[across] - middle[across];
      if (!try_place(group, offset, yaw, place.front_m)) continue;
      if (side_used != nullptr) *side_used = side;
      return true;
    }
  }
  return false;
}

bool RoomPlacer::in_middle(const Group& group) {
  struct Candidate {
    glm::vec2 at;
    float yaw, distance;
  };
  std::vector<Candidate> candidates;
  const int first = dice_.count(0, 1);
  for (int turn = 0; turn < 2; ++turn) {
    for (float y = room_.rect.min_m.y; y < room_.rect.max_m.y; y += 0.15F) {
      for (float x = room_.rect.min_m.x; x < room_.rect.max_m.x; x += 0.15F) {
        const glm::vec2 at(x, y);
        candidates.push_back({at, kHalfPi * static_cast<float>((turn + first) % 2),
                              glm::length(at - room_.rect.center_m())});
      }
    }
  }
  std::stable_sort(
      candidates.begin(), candidates.end(),
      [](const Candidate& a, const Candidate& b) { return a.distance < b.distance; });
  return std::any_of(candidates.begin(), candidates.end(),
                     [&](const Candidate& c) { return try_place(group, c.at, c.yaw, 0.0F); });
}

bool RoomPlacer::on_wall(const Furniture& piece, float z_m, float clear_below_m) {
  const glm::vec3 size = piece.size_m();
  for (int attempt = 0; attempt < 40; ++attempt) {
    const Side side = static_cast<Side>(dice_.count(0, 3));
    const int along = axis_along(side), across = 1 - along;
    const float lo = room_.rect.min_m[along] + 0.5F * size.x + 0.2F,
                hi = room_.rect.max_m[along] - 0.5F * size.x - 0.2F;
    if (hi < lo) continue;
    const float t = dice_.between(lo, hi);
    Opening place;
    place.side = side;
    const Rect zone = zone_of(room_, place, size.x + 0.1F, 0.3F, t);
    const bool opening =
        std::any_of(room_.openings.begin(), room_.openings.end(), [&](const Opening& o) {
          return o.side == side &&
                 std::abs(o.center_m - t) < 0.5F * (o.width_m + size.x) + 0.12F;
        });
    const bool covered = std::any_of(heights_.begin(), heights_.end(), [&](const auto& other) {
      return other.second > z_m - clear_below_m && zone.overlaps(other.first);
    });
    if (opening || covered) continue;
    glm::vec3 at(0.0F, 0.0F, z_m);
    at[along] = t;
    at[across] = room_.wall_m(side) - 0.002F * outward(side)[across];
    add_instance(scene_, piece, at, yaw_against_rad(side));
    heights_.emplace_back(grown(zone, 0.05F), z_m + size.z);
    return true;
  }
  return false;
}

}  // namespace segsim::worlds::internal
