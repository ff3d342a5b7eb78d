#include "worlds/mesh/gazebo/internal/ceiling.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/gtc/matrix_transform.hpp>

#include "core/image.h"
#include "worlds/mesh/class_names.h"
#include "worlds/mesh/gazebo/internal/primitive_shapes.h"

namespace segsim::worlds::internal {
namespace {

constexpr double kCell_m = 0.1;
constexpr float kBand_m = 0.3F;       ///< Below the ceiling; a wall that ends there encloses.
constexpr double kLeastInside = 0.2;  ///< Share of the floor plan that walls must enclose.
constexpr double kThickness_m = 0.02;
constexpr std::uint8_t kUnknown = 0, kWall = 1, kOutside = 2;

struct Box {
  glm::dvec3 low{std::numeric_limits<double>::max()};
  glm::dvec3 high{std::numeric_limits<double>::lowest()};

  [[nodiscard]] bool empty() const { return low.x > high.x; }
  [[nodiscard]] double area_m2() const {
    return empty() ? 0.0 : (high.x - low.x) * (high.y - low.y);
  }
};

/// Class id of that name; 0 if the scene has none.
std::uint16_t id_of(const sim::MeshScene& scene, const std::string& name) {
  for (const core::SceneClass& known : scene.classes) {
    if (known.name == name) return known.id;
  }
  return 0;
}

/// Of all meshes of a class; of everything for class 0.
Box bounds(const sim::MeshScene& scene, std::uint16_t class_id) {
  Box box;
  for (const sim::SubMesh& mesh : scene.meshes) {
    if (class_id != 0 && mesh.class_id != class_id) continue;
    for (const glm::vec3& vertex : mesh.positions_m) {
      box.low = glm::min(box.low, glm::dvec3(vertex));
      box.high = glm::max(box.high, glm::dvec3(vertex));
    }
  }
  return box;
}

/// The floor plan as seen from above: where walls reach into the band, and what is outside.
class EnclosedArea {
 public:
  EnclosedArea(const sim::MeshScene& scene, std::uint16_t wall, const Box& plan,
               double height_m)
      : low_m_(glm::dvec2(plan.low) - 2.0 * kCell_m),
        cells_(static_cast<int>((plan.high.x - plan.low.x) / kCell_m) + 5,
               static_cast<int>((plan.high.y - plan.low.y) / kCell_m) + 5, kUnknown) {
    for (const sim::SubMesh& mesh : scene.meshes) {
      if (mesh.class_id != wall) continue;
      for (const glm::uvec3& t : mesh.triangles) {
        mark(mesh.positions_m[t.x], mesh.positions_m[t.y], mesh.positions_m[t.z],
             static_cast<float>(height_m));
      }
    }
    flood();
  }

  [[nodiscard]] double share_inside() const {
    const auto inside = std::count_if(cells_.data(), cells_.data() + cells_.size(),
                                      [](std::uint8_t cell) { return cell == kUnknown; });
    return static_cast<double>(inside) / static_cast<double>(cells_.size());
  }

  /// Calls `visit(low, high)` with rectangles that cover all but the outside [m].
  template <class Visit>
  void for_each_rectangle(const Visit& visit) const {
    core::Image<std::uint8_t> left = cells_;
    for (int y = 0; y < left.height_px(); ++y) {
      for (int x = 0; x < left.width_px(); ++x) {
        if (left(x, y) == kOutside) continue;
        int right = x;
        while (right < left.width_px() && left(right, y) != kOutside) ++right;
        int top = y + 1;
        const auto row_is_covered = [&](int row) {
          for (int i = x; i < right; ++i) {
            if (left(i, row) == kOutside) return false;
          }
          return true;
        };
        while (top < left.height_px() && row_is_covered(top)) ++top;
        for (int j = y; j < top; ++j) {
          for (int i = x; i < right; ++i) left(i, j) = kOutside;
        }
        visit(low_m_ + kCell_m * glm::dvec2(x, y), low_m_ + kCell_m * glm::dvec2(right, top));
      }
    }
  }

 private:
  /// Samples the triangle, as its part inside the band is what counts.
  void mark(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c, float height_m) {
    if (std::max({a.z, b.z, c.z}) < height_m - kBand_m) return;
    const float longest =
        std::max({glm::distance(a, b), glm::distance(b, c), glm::distance(c, a)});
    const int steps = std::max(1, static_cast<int>(longest / (0.5F * kCell_m)));
    for (int i = 0; i <= steps; ++i) {
      for (int j = 0; i + j <= steps; ++j) {
        const glm::vec3 p =
            a + (static_cast<float>(i) * (b - a) + static_cast<float>(j) * (c - a)) /
                    static_cast<float>(steps);
        if (p.z < height_m - kBand_m || p.z > height_m + kBand_m) continue;
        const glm::ivec2 cell(glm::floor((glm::dvec2(p) - low_m_) / kCell_m));
        if (cells_.contains(cell.x, cell.y)) cells_(cell.x, cell.y) = kWall;
      }
    }
  }

  void flood() {
    std::vector<glm::ivec2> stack{{0, 0}};
    cells_(0, 0) = kOutside;
    while (!stack.empty()) {
      const glm::ivec2 cell = stack.back();
      stack.pop_back();
      for (const glm::ivec2 step : {glm::ivec2(1, 0), {-1, 0}, {0, 1}, {0, -1}}) {
        const glm::ivec2 next = cell + step;
        if (!cells_.contains(next.x, next.y) || cells_(next.x, next.y) != kUnknown) continue;
        cells_(next.x, next.y) = kOutside;
        stack.push_back(next);
      }
    }
  }

  glm::dvec2 low_m_;
  core::Image<std::uint8_t> cells_;
};

}  // namespace

bool has_ceiling(const sim::MeshScene& scene) {
  const std::uint16_t ceiling = id_of(scene, "ceiling");
  return ceiling != 0 && bounds(scene, ceiling).area_m2() >= 0.5 * bounds(scene, 0).area_m2();
}

double ceiling_height_m(const sim::MeshScene& scene) {
  if (has_ceiling(scene)) return bounds(scene, id_of(scene, "ceiling")).low.z;
  return bounds(scene, id_of(scene, "wall")).high.z;
}

void add_flat_ceiling(sim::MeshScene& scene, double height_m) {
  const std::uint16_t wall = id_of(scene, "wall");
  const Box plan = bounds(scene, wall);
  if (plan.empty()) return;
  LabelTable labels(scene);
  const LabelTable::Ids ids = labels.add("ceiling");
  scene.materials.push_back({glm::vec3(0.8F), -1, {}});
  const auto add = [&](const glm::dvec2& low_m, const glm::dvec2& high_m) {
    MeshPart part = box({high_m - low_m, kThickness_m});
    part.material = static_cast<int>(scene.materials.size()) - 1;
    const glm::dvec3 centre(0.5 * (low_m + high_m), height_m + 0.5 * kThickness_m);
    place_part(scene, part, glm::translate(glm::dmat4(1.0), centre), ids);
  };
  if (wall != 0) {
    const EnclosedArea inside(scene, wall, plan, height_m);
    if (inside.share_inside() >= kLeastInside) return inside.for_each_rectangle(add);
  }
  add(glm::dvec2(plan.low), glm::dvec2(plan.high));
}

}  // namespace segsim::worlds::internal
