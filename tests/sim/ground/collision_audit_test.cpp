// The swept footprint against a library: FCL's box-mesh test on the triangles themselves,
// where sim/ground/collision.h works on 2 cm cells.
#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include <fcl/fcl.h>
#include <gtest/gtest.h>

#include "core/random.h"
#include "sim/ground/collision.h"
#include "sim/ground/robot.h"
#include "worlds/mesh/plain_mesh.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::sim {
namespace {

using Mesh = fcl::BVHModel<fcl::OBBRSSd>;

/// What can touch a robot, as FCL wants it.
std::shared_ptr<Mesh> fcl_mesh(const TriangleMesh& mesh) {
  std::vector<fcl::Vector3d> vertices;
  for (const glm::vec3& p : mesh.positions_m) vertices.emplace_back(p.x, p.y, p.z);
  std::vector<fcl::Triangle> triangles;
  for (const glm::uvec3& t : mesh.triangles) triangles.emplace_back(t.x, t.y, t.z);
  auto model = std::make_shared<Mesh>();
  model->beginModel();
  model->addSubModel(vertices, triangles);
  model->endModel();
  return model;
}

/// The base between its clearance and its top, and the mast above it.
class Audit {
 public:
  Audit(const TriangleMesh& mesh, const RobotModel& robot)
      : robot_(robot), world_(fcl_mesh(mesh)) {}

  /// Whether base or mast, grown by that much on all sides in plan, meet a triangle.
  [[nodiscard]] bool touches(const core::Pose2& pose, double grown_m) const {
    const double base_m = robot_.body_top_m - robot_.clearance_m;
    const auto base = std::make_shared<fcl::Boxd>(robot_.length_m + 2.0 * grown_m,
                                                  robot_.width_m + 2.0 * grown_m, base_m);
    if (meets(base, pose, robot_.clearance_m + 0.5 * base_m)) return true;
    const double mast_m = robot_.mast_height_m - robot_.body_top_m;
    if (mast_m <= 0.0) return false;
    const auto mast = std::make_shared<fcl::Cylinderd>(robot_.mast_radius_m + grown_m, mast_m);
    return meets(mast, pose, robot_.body_top_m + 0.5 * mast_m);
  }

 private:
  [[nodiscard]] bool meets(const std::shared_ptr<fcl::CollisionGeometryd>& shape,
                           const core::Pose2& pose, double z_m) const {
    fcl::Transform3d place = fcl::Transform3d::Identity();
    place.translation() = fcl::Vector3d(pose.x_m, pose.y_m, z_m);
    place.linear() =
        Eigen::AngleAxisd(pose.yaw_rad, fcl::Vector3d::UnitZ()).toRotationMatrix();
    const fcl::CollisionObjectd robot(shape, place);
    const fcl::CollisionRequestd request;
    fcl::CollisionResultd result;
    return fcl::collide(&robot, &world_, request, result) > 0;
  }

  RobotModel robot_;
  fcl::CollisionObjectd world_;
};

TriangleMesh flat_without_ceiling() {
  worlds::FlatOptions options;
  options.seed = 1;
  options.ceiling = false;
  return worlds::plain_mesh(worlds::make_flat(options));
}

core::Pose2 free_pose(const CollisionWorld& world, core::RandomStream& random) {
  core::Pose2 pose;
  do {
    pose = {random.uniform(-4.5, 4.5), random.uniform(-4.5, 4.5), random.uniform(-3.1, 3.1)};
  } while (world.collides(pose));
  return pose;
}

/// Never into a triangle; never stopped by nothing. Cells cover what they hold, so a contact
/// may come a cell's diagonal (2.8 cm) early, but not late.
TEST(CollisionAudit, RandomDrivesInAFlatAgreeWithBoxesAgainstTriangles) {
  const TriangleMesh mesh = flat_without_ceiling();
  const RobotModel robot = RobotModel::jackal_gentle();
  const CollisionWorld world(mesh, robot);
  const Audit audit(mesh, robot);
  constexpr double kEarly_m = 1.4143 * CollisionWorld::kCell_m + CollisionWorld::kContactGap_m;
  core::RandomStream random(8, "collision_audit");
  int contacts = 0, audited = 0;
  for (int drive = 0; drive < 100; ++drive) {
    core::Pose2 pose = free_pose(world, random);
    const ContactResponse response =
        drive % 2 == 0 ? ContactResponse::kStop : ContactResponse::kSlide;
    core::VelocityCommand velocity;
    bool touched = false;
    for (int step = 0; step < 600; ++step) {
      if (step % 120 == 0) {
        velocity = {random.uniform(-0.4, 0.8), random.uniform(-1.5, 1.5)};
      }
      const MoveResult moved = world.move(pose, velocity, 0.005, response);
      pose = moved.pose;
      const bool first = moved.contact.has_value() && !touched;
      touched = moved.contact.has_value();
      if (!first && step % 20 != 0) continue;
      ++audited;
      ASSERT_FALSE(audit.touches(pose, 0.0)) << "drive " << drive << ", step " << step;
      if (first && response == ContactResponse::kStop) {
        ++contacts;
        ASSERT_TRUE(audit.touches(pose, kEarly_m)) << "drive " << drive << ", step " << step;
      }
    }
  }
  EXPECT_GT(audited, 1500);
  EXPECT_GT(contacts, 20);
}

/// Poses alone: what FCL finds in a triangle collides; what collides is near a triangle.
TEST(CollisionAudit, RandomPosesAgree) {
  const TriangleMesh mesh = flat_without_ceiling();
  const RobotModel robot = RobotModel::jackal_gentle();
  const CollisionWorld world(mesh, robot);
  const Audit audit(mesh, robot);
  constexpr double kDiagonal_m = 1.4143 * CollisionWorld::kCell_m + 1e-6;
  core::RandomStream random(9, "collision_audit");
  int inside = 0, outside = 0, undecided = 0;
  for (int k = 0; k < 2000; ++k) {
    const core::Pose2 pose{random.uniform(-4.4, 4.4), random.uniform(-4.5, 4.5),
                           random.uniform(-3.1, 3.1)};
    const bool collides = world.collides(pose);
    if (audit.touches(pose, 0.0)) {
      ++inside;
      ASSERT_TRUE(collides) << "pose " << k;
    } else if (!audit.touches(pose, kDiagonal_m)) {
      // A base that lies wholly inside of something touches none of its surfaces.
      if (collides) ++undecided;
      ++outside;
    }
  }
  EXPECT_GT(inside, 300);
  EXPECT_GT(outside, 300);
  EXPECT_LE(undecided, 5);
}

}  // namespace
}  // namespace segsim::sim
