#include "sim/ground/collision.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <glm/geometric.hpp>

#include "core/error.h"

namespace segsim::sim {
namespace {

/// Free cells around the mesh, so that its edge is seen as obstacle.
constexpr double kMargin_m = 0.1;
/// A base that touches probes its way along in steps of this size.
constexpr double kProbe_m = 0.00025;
/// Of the disc around a cell; the small term covers rounding.
const double kCellRadius_m = std::sqrt(0.5) * CollisionWorld::kCell_m + 1e-9;
/// What conservative advancement leaves of a gap.
constexpr double kLeave_m = 0.0002;

/// Base pose as axes, to go between world and base coordinates.
struct Axes {
  explicit Axes(const core::Pose2& pose)
      : origin(pose.x_m, pose.y_m),
        x(std::cos(pose.yaw_rad), std::sin(pose.yaw_rad)),
        y(-x.y, x.x) {}
  [[nodiscard]] glm::dvec2 to_base(const glm::dvec2& p) const {
    return {glm::dot(p - origin, x), glm::dot(p - origin, y)};
  }
  [[nodiscard]] glm::dvec2 to_world(const glm::dvec2& p) const {
    return origin + x * p.x + y * p.y;
  }
  glm::dvec2 origin, x, y;
};

constexpr std::array<std::array<double, 2>, 4> kCorners = {
    {{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}}};

/// Distance between a rectangle of half size `half` at `axes` and an upright square: where two
/// disjoint convex polygons are nearest, one of the two points is a corner.
Clearance rectangle_to_square(const Axes& axes, const glm::dvec2& half,
                              const glm::dvec2& center, double half_cell) {
  Clearance best;
  best.distance_m = std::numeric_limits<double>::infinity();
  const auto consider = [&best](const glm::dvec2& on_robot, const glm::dvec2& on_obstacle) {
    const double d = glm::distance(on_robot, on_obstacle);
    if (d < best.distance_m) {
      best = {d, on_obstacle, d > 0.0 ? (on_robot - on_obstacle) / d : glm::dvec2(0.0)};
    }
  };
  const glm::dvec2 c = axes.to_base(center);
  // Overlap has no corner inside if the shapes cross, so it is tested by separating axes.
  const double reach = half_cell * (std::abs(axes.x.x) + std::abs(axes.x.y));
  const glm::dvec2 extent(half.x * std::abs(axes.x.x) + half.y * std::abs(axes.y.x),
                          half.x * std::abs(axes.x.y) + half.y * std::abs(axes.y.y));
  const glm::dvec2 gap = glm::abs(center - axes.origin) - extent - half_cell;
  if (std::abs(c.x) < half.x + reach && std::abs(c.y) < half.y + reach && gap.x < 0.0 &&
      gap.y < 0.0) {
    return {0.0, center, glm::dvec2(0.0)};
  }
  for (const auto& [sx, sy] : kCorners) {
    const glm::dvec2 square_corner = center + half_cell * glm::dvec2(sx, sy);
    const glm::dvec2 p = axes.to_base(square_corner);
    consider(axes.to_world(glm::clamp(p, -half, half)), square_corner);
    const glm::dvec2 base_corner = axes.to_world(half * glm::dvec2(sx, sy));
    consider(base_corner, glm::clamp(base_corner, center - half_cell, center + half_cell));
  }
  return best;
}

/// Bilinear between cell centres; 0 outside the grid. Half a cell is taken off, because the
/// obstacle begins at its cell's edge.
double distance_at(const ObstacleLayer& layer, const GridFrame& frame, const glm::dvec2& p_m) {
  const glm::dvec2 g = (p_m - frame.origin_m) / frame.cell_m - 0.5;
  const int i = static_cast<int>(std::floor(g.x));
  const int j = static_cast<int>(std::floor(g.y));
  if (i < 0 || j < 0 || i + 1 >= frame.width || j + 1 >= frame.height) return 0.0;
  const double fx = g.x - i;
  const double fy = g.y - j;
  const auto d = [&](int di, int dj) -> double { return layer.distance_m(i + di, j + dj); };
  const double value = (1 - fy) * ((1 - fx) * d(0, 0) + fx * d(1, 0)) +
                       fy * ((1 - fx) * d(0, 1) + fx * d(1, 1));
  return std::max(0.0, value - 0.5 * frame.cell_m);
}

/// A motion as a function of its share in [0, 1], with a bound on how far any point of the
/// base moves.
struct Motion {
  core::Pose2 from;
  core::VelocityCommand velocity;  ///< Arc, if `duration_s` > 0 ...
  double duration_s = 0.0;
  glm::dvec2 shift_m{0.0};  ///< ... else a straight shift while turning.
  double turn_rad = 0.0;

  [[nodiscard]] core::Pose2 at(double share) const {
    if (duration_s > 0.0) return drive_arc(from, velocity, share * duration_s);
    return {from.x_m + share * shift_m.x, from.y_m + share * shift_m.y,
            core::wrap_angle_rad(from.yaw_rad + share * turn_rad)};
  }
  [[nodiscard]] double bound_m(double radius_m) const {
    if (duration_s > 0.0) {
      return duration_s *
             (std::abs(velocity.forward_mps) + std::abs(velocity.turn_radps) * radius_m);
    }
    return glm::length(shift_m) + std::abs(turn_rad) * radius_m;
  }
};

struct Sweep {
  double share = 1.0;  ///< That could be done.
  std::optional<Clearance> blocked_by;
};

Sweep sweep(const CollisionWorld& world, const Motion& motion) {
  const double bound_m = motion.bound_m(world.robot().circumscribed_radius_m());
  if (bound_m <= 0.0) return {};
  double share = 0.0;
  Clearance here = world.clearance(motion.from);
  while (share < 1.0) {
    // Far enough: nothing can be met before the gap is used up.
    if (here.distance_m > CollisionWorld::kContactGap_m) {
      share = std::min(1.0, share + (here.distance_m - kLeave_m) / bound_m);
      if (share < 1.0) here = world.clearance(motion.at(share));
      continue;
    }
    // Touching: go on only as long as that does not narrow the gap.
    const double next = std::min(1.0, share + kProbe_m / bound_m);
    const Clearance there = world.clearance(motion.at(next));
    constexpr double kRounding_m = 1e-9;
    if (there.distance_m < here.distance_m - kRounding_m) return {share, here};
    // Overlapping from the start: any motion is allowed, so that the base can get free.
    share = next;
    here = there;
  }
  return {};
}

}  // namespace

CollisionWorld::CollisionWorld(const TriangleMesh& mesh, const RobotModel& robot)
    : robot_(robot) {
  if (mesh.positions_m.empty()) {
    throw core::InputError::expected("collision mesh", "triangles", "none");
  }
  frame_ = grid_over(mesh, kCell_m, kMargin_m);
  GridMask floor(frame_.width, frame_.height, 0);
  mark_floor(mesh, robot.clearance_m, frame_, floor);
  if (std::find(floor.pixels().begin(), floor.pixels().end(), 1) == floor.pixels().end()) {
    throw core::InputError::expected("collision mesh", "a floor near z = 0", "none");
  }
  body_.occupied = GridMask(frame_.width, frame_.height, 0);
  for (std::size_t k = 0; k < floor.size(); ++k) {
    body_.occupied.pixels()[k] = floor.pixels()[k] == 0 ? 1 : 0;
  }
  mark_band(mesh, robot.clearance_m, robot.body_top_m, frame_, body_.occupied);
  body_.distance_m = distance_to_marked(body_.occupied, kCell_m);

  mast_.occupied = GridMask(frame_.width, frame_.height, 0);
  if (robot.mast_height_m > robot.body_top_m) {
    mark_band(mesh, robot.body_top_m, robot.mast_height_m, frame_, mast_.occupied);
  }
  mast_.distance_m = distance_to_marked(mast_.occupied, kCell_m);
}

double CollisionWorld::body_distance_m(const glm::dvec2& p_m) const {
  return distance_at(body_, frame_, p_m);
}

double CollisionWorld::mast_distance_m(const glm::dvec2& p_m) const {
  return distance_at(mast_, frame_, p_m);
}

void CollisionWorld::nearest_to_base(const core::Pose2& pose, Clearance& best) const {
  const glm::dvec2 center(pose.x_m, pose.y_m);
  const glm::ivec2 cell = frame_.cell_of(center);
  if (!frame_.contains(cell)) {
    best = {0.0, center, glm::dvec2(0.0)};
    return;
  }
  // Both ends of the centre-to-centre distance may be half a diagonal off.
  const double radius_m = robot_.circumscribed_radius_m();
  if (body_.distance_m(cell.x, cell.y) - std::sqrt(2.0) * kCell_m > radius_m + kReach_m)
    return;

  const Axes axes(pose);
  const glm::dvec2 half(0.5 * robot_.length_m, 0.5 * robot_.width_m);
  // Cells that the upright box around the base, and its reach, touches.
  const glm::dvec2 extent(half.x * std::abs(axes.x.x) + half.y * std::abs(axes.y.x),
                          half.x * std::abs(axes.x.y) + half.y * std::abs(axes.y.y));
  const glm::ivec2 low = frame_.cell_of(center - extent - kReach_m - kCell_m);
  const glm::ivec2 high = frame_.cell_of(center + extent + kReach_m + kCell_m);
  for (int j = low.y; j <= high.y; ++j) {
    for (int i = low.x; i <= high.x; ++i) {
      if (frame_.contains({i, j}) && body_.occupied(i, j) == 0) {
        // No obstacle is nearer than the distance says, so that many cells are free.
        i += std::max(0, static_cast<int>(body_.distance_m(i, j) / kCell_m) - 1);
        continue;
      }
      const glm::dvec2 c = frame_.center_m(i, j);
      // Cheap refusal before the exact test: the cell as the disc around it.
      const glm::dvec2 gap = glm::max(glm::abs(axes.to_base(c)) - half, 0.0);
      const double refused_m = best.distance_m + kCellRadius_m;
      if (glm::dot(gap, gap) > refused_m * refused_m) continue;
      const Clearance found = rectangle_to_square(axes, half, c, 0.5 * kCell_m);
      if (found.distance_m < best.distance_m) best = found;
    }
  }
}

void CollisionWorld::nearest_to_mast(const core::Pose2& pose, Clearance& best) const {
  if (robot_.mast_height_m <= robot_.body_top_m) return;
  const glm::dvec2 center(pose.x_m, pose.y_m);
  const glm::ivec2 cell = frame_.cell_of(center);
  if (!frame_.contains(cell)) return;
  const double radius_m = robot_.mast_radius_m;
  if (mast_.distance_m(cell.x, cell.y) - std::sqrt(2.0) * kCell_m > radius_m + kReach_m)
    return;

  const int span = static_cast<int>(std::ceil((radius_m + kReach_m) / kCell_m)) + 1;
  for (int j = std::max(0, cell.y - span); j <= std::min(frame_.height - 1, cell.y + span);
       ++j) {
    for (int i = std::max(0, cell.x - span); i <= std::min(frame_.width - 1, cell.x + span);
         ++i) {
      if (mast_.occupied(i, j) == 0) continue;
      const glm::dvec2 c = frame_.center_m(i, j);
      const glm::dvec2 point = glm::clamp(center, c - 0.5 * kCell_m, c + 0.5 * kCell_m);
      const double to_axis_m = glm::distance(center, point);
      const double d = std::max(0.0, to_axis_m - radius_m);
      if (d < best.distance_m) {
        best = {d, point, d > 0.0 ? (center - point) / to_axis_m : glm::dvec2(0.0)};
      }
    }
  }
}

Clearance CollisionWorld::clearance(const core::Pose2& pose) const {
  Clearance best;
  best.distance_m = kReach_m;
  nearest_to_base(pose, best);
  nearest_to_mast(pose, best);
  return best;
}

MoveResult CollisionWorld::move(const core::Pose2& pose, const core::VelocityCommand& velocity,
                                double duration_s, ContactResponse response) const {
  Motion motion;
  motion.from = pose;
  motion.velocity = velocity;
  motion.duration_s = duration_s;
  const core::Pose2 goal = motion.at(1.0);
  Sweep done = sweep(*this, motion);
  MoveResult result{done.blocked_by ? motion.at(done.share) : goal, std::nullopt};
  if (!done.blocked_by) return result;

  const glm::dvec2 heading(std::cos(result.pose.yaw_rad), std::sin(result.pose.yaw_rad));
  result.contact = Contact{
      done.blocked_by->point_m, done.blocked_by->normal,
      std::max(0.0, -velocity.forward_mps * glm::dot(heading, done.blocked_by->normal))};
  if (response == ContactResponse::kStop) return result;

  // What is left of the way, less the part that points into the obstacle; a turn that is
  // blocked is given up.
  glm::dvec2 left_m(goal.x_m - result.pose.x_m, goal.y_m - result.pose.y_m);
  double turn_rad = core::wrap_angle_rad(goal.yaw_rad - result.pose.yaw_rad);
  constexpr int kRepeats = 4;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const glm::dvec2 normal = done.blocked_by->normal;
    left_m -= normal * std::min(0.0, glm::dot(left_m, normal));
    Motion slide;
    slide.from = result.pose;
    slide.shift_m = left_m;
    slide.turn_rad = turn_rad;
    done = sweep(*this, slide);
    result.pose = slide.at(done.share);
    if (!done.blocked_by) break;
    left_m *= 1.0 - done.share;
    turn_rad = 0.0;
  }
  return result;
}

}  // namespace segsim::sim
