#pragma once

/// @file
/// What the makers of single pieces share. Private to sim/furniture_*.cpp.

#include <array>
#include <initializer_list>

#include <glm/vec3.hpp>

#include "core/random.h"
#include "worlds/procedural/procedural_furniture.h"

namespace segsim::worlds::internal {

/// Random choices in single precision.
class Dice {
 public:
  Dice(std::uint64_t seed, std::string_view name) : random_(seed, name) {}

  float between(float lo, float hi) { return static_cast<float>(random_.uniform(lo, hi)); }
  int count(int lo, int hi) {
    return lo + static_cast<int>(random_.index(static_cast<std::uint32_t>(hi - lo + 1)));
  }
  bool chance(float p) { return random_.chance(p); }
  template <class T>
  T pick(std::initializer_list<T> choices) {
    return *(choices.begin() + random_.index(static_cast<std::uint32_t>(choices.size())));
  }
  std::uint64_t seed() { return random_.next_u32(); }

 private:
  core::RandomStream random_;
};

/// sRGB of hue, saturation, value, all in [0, 1].
[[nodiscard]] glm::vec3 hsv(float hue, float saturation, float value);

/// One piece under construction.
struct Workshop {
  Furniture piece;
  Dice dice;
  SurfaceLibrary& surfaces;
  FurnitureSize size;

  MeshBuilder& mesh() { return piece.mesh; }
  void use(const Surface& surface) { piece.mesh.set_surface(surface); }
  void use_plain(const glm::vec3& srgb) { use(surfaces.plain(srgb)); }

  // Random materials; each call draws a new one.
  Surface wood();
  Surface painted();
  Surface metal();
  Surface fabric();
  Surface ceramic_white();

  /// Four legs at the corners of a w x d rectangle around (x, y); `kind` 0 square, 1 round, 2
  /// turned out.
  void legs(float width_m, float depth_m, float height_m, float thickness_m, int kind);
  /// Doors or drawers on the front (-y) plane: gaps between them, each with a handle.
  void fronts(const glm::vec3& min_m, const glm::vec3& max_m, int columns, int rows,
              const Surface& front, const Surface& handle, bool knobs);
};

// Target style. Each fills the workshop's piece.
void make_dining_chair(Workshop& w);
void make_office_chair(Workshop& w);
void make_armchair(Workshop& w);
void make_stool(Workshop& w);
void make_couch(Workshop& w, bool corner);
void make_bed(Workshop& w, bool single);
void make_dining_table(Workshop& w, bool round);
void make_coffee_table(Workshop& w);
void make_desk(Workshop& w);
void make_nightstand(Workshop& w);
void make_tv_stand(Workshop& w);
void make_wardrobe(Workshop& w);
void make_bookshelf(Workshop& w);
void make_kitchen_counter(Workshop& w);
void make_kitchen_sink(Workshop& w);
void make_refrigerator(Workshop& w);
void make_plant(Workshop& w, bool small);
void make_tv(Workshop& w);
void make_toilet(Workshop& w);
void make_washbasin(Workshop& w);
void make_stove(Workshop& w);
void make_washing_machine(Workshop& w);
void make_bathtub(Workshop& w);
void make_trash_bin(Workshop& w);
void make_door_leaf(Workshop& w);
void make_lamp(Workshop& w, FurnitureKind kind);
void make_rug(Workshop& w);
void make_wall_panel(Workshop& w, bool mirror);
void make_clutter(Workshop& w, FurnitureKind kind);

/// Source style. @returns false if the kind has none.
bool make_source_piece(Workshop& w, FurnitureKind kind);

}  // namespace segsim::worlds::internal
