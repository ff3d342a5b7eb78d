#pragma once

/// @file
/// The robot's footprint against the floor plan of the collision mesh.
///
/// Obstacles are 2 cm cells: what the mesh holds between the robot's ground clearance and its
/// top, and every cell without floor. The base is an oriented rectangle, the camera mast a
/// thin disc that meets what is higher than the base. A motion is swept by conservative
/// advancement (Mirtich 1996): the clearance bounds how far the fastest point may move unseen,
/// so nothing is tunnelled, and rotation is tested like translation.

#include <optional>

#include <glm/vec2.hpp>

#include "core/frames.h"
#include "core/stages.h"
#include "sim/ground/ground_grid.h"
#include "sim/ground/robot.h"

namespace segsim::sim {

/// One layer of obstacle cells.
struct ObstacleLayer {
  GridMask occupied;
  core::Image<float> distance_m;  ///< Centre to nearest occupied centre.
};

/// Where base or mast are nearest to an obstacle.
struct Clearance {
  double distance_m = 0.0;  ///< 0 if they overlap; capped at CollisionWorld::kReach_m.
  glm::dvec2 point_m{0.0};  ///< On the obstacle.
  glm::dvec2 normal{
      0.0};  ///< Unit, from the obstacle to the robot; 0 when out of reach or overlapping.
};

enum class ContactResponse : std::uint8_t { kStop, kSlide };

struct Contact {
  glm::dvec2 point_m{0.0}, normal{0.0};
  double approach_mps = 0.0;  ///< Speed of the footprint's origin towards the obstacle, >= 0.
};

struct MoveResult {
  core::Pose2 pose;
  std::optional<Contact> contact;  ///< The first one.
};

class CollisionWorld {
 public:
  static constexpr double kCell_m = 0.02;
  /// A move ends with a gap below this to the obstacle.
  static constexpr double kContactGap_m = 0.0005;
  static constexpr double kReach_m = 0.10;

  /// @param mesh  Must hold some floor near z = 0. @throws core::InputError if it holds none.
  CollisionWorld(const TriangleMesh& mesh, const RobotModel& robot);

  [[nodiscard]] Clearance clearance(const core::Pose2& pose) const;
  [[nodiscard]] bool collides(const core::Pose2& pose) const {
    return clearance(pose).distance_m <= 0.0;
  }
  /// Drives the arc until it ends or the gap to an obstacle closes. Motion that widens the gap
  /// is never blocked, so that a robot can leave a wall.
  [[nodiscard]] MoveResult move(const core::Pose2& pose, const core::VelocityCommand& velocity,
                                double duration_s,
                                ContactResponse response = ContactResponse::kStop) const;

  /// From a point to the nearest obstacle of the base's layer, about (bilinear, within 5 mm);
  /// 0 outside the grid.
  [[nodiscard]] double body_distance_m(const glm::dvec2& p_m) const;
  /// Likewise for the mast's layer; infinity without a mast.
  [[nodiscard]] double mast_distance_m(const glm::dvec2& p_m) const;

  [[nodiscard]] const GridFrame& frame() const { return frame_; }
  [[nodiscard]] const ObstacleLayer& body_layer() const { return body_; }
  [[nodiscard]] const RobotModel& robot() const { return robot_; }

 private:
  void nearest_to_base(const core::Pose2& pose, Clearance& best) const;
  void nearest_to_mast(const core::Pose2& pose, Clearance& best) const;

  RobotModel robot_;
  GridFrame frame_;
  ObstacleLayer body_, mast_;
};

}  // namespace segsim::sim
