#include "tests/system/gazebo/gazebo_dart.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include <ignition/common/Mesh.hh>
#include <ignition/common/SubMesh.hh>
#include <ignition/physics/ForwardStep.hh>
#include <ignition/physics/FrameSemantics.hh>
#include <ignition/physics/FreeGroup.hh>
#include <ignition/physics/GetEntities.hh>
#include <ignition/physics/Joint.hh>
#include <ignition/physics/RequestEngine.hh>
#include <ignition/physics/mesh/MeshShape.hh>
#include <ignition/physics/sdf/ConstructWorld.hh>
#include <ignition/plugin/Loader.hh>
#include <sdf/sdf.hh>

namespace segsim::tests {
namespace {

namespace physics = ignition::physics;

struct Features
    : physics::FeatureList<
          physics::ForwardStep, physics::sdf::ConstructSdfWorld, physics::GetEntities,
          physics::LinkFrameSemantics, physics::FindFreeGroupFeature,
          physics::SetFreeGroupWorldPose, physics::SetFreeGroupWorldVelocity,
          physics::SetJointVelocityCommandFeature, physics::mesh::AttachMeshShapeFeature> {};
using World = physics::World3dPtr<Features>;
using Link = physics::Link3dPtr<Features>;
using Joint = physics::Joint3dPtr<Features>;

// Of sim/gazebo/gazebo_world.cpp.
constexpr double kWheelRadius_m = 0.098, kSeparation_m = 0.563385, kBaseHeight_m = 0.0635;
constexpr double kMost_mps2 = 2.0, kMost_radps2 = 4.0;

/// Vertices and triangles of an .obj without texture.
void read_obj(const std::string& file, ignition::common::SubMesh& mesh) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error(file + ": no such file");
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    if (kind == "v") {
      double x = 0.0, y = 0.0, z = 0.0;
      words >> x >> y >> z;
      mesh.AddVertex({x, y, z});
      mesh.AddNormal({0.0, 0.0, 1.0});
    } else if (kind == "f") {
      for (std::string corner; words >> corner;) {
        mesh.AddIndex(static_cast<unsigned>(std::stoul(corner)) - 1U);
      }
    }
  }
}

double towards(double now, double wanted, double most) {
  return now + std::clamp(wanted - now, -most, most);
}

}  // namespace

struct DartWorld::Parts {
  ignition::plugin::Loader loader;
  World world;
  Link base;
  std::array<Joint, 2> left, right;
  physics::ForwardStep::Output output;
  physics::ForwardStep::State state;
  physics::ForwardStep::Input input;
  double forward_mps = 0.0, turn_radps = 0.0;  ///< After the limits.
};

DartWorld::DartWorld(const std::string& sdf_file) : parts_(std::make_unique<Parts>()) {
  Parts& parts = *parts_;
  const auto names = parts.loader.LoadLib(SEGSIM_DART_PLUGIN);
  if (names.empty()) throw std::runtime_error(std::string(SEGSIM_DART_PLUGIN) + ": no plugin");
  const auto engine =
      physics::RequestEngine3d<Features>::From(parts.loader.Instantiate(*names.begin()));
  if (!engine) throw std::runtime_error("the DART engine lacks features");
  sdf::Root root;
  if (const auto errors = root.Load(sdf_file); !errors.empty()) {
    throw std::runtime_error(errors.front().Message());
  }
  parts.world = engine->ConstructWorld(*root.WorldByIndex(0));
  // The engine makes no collision shapes of meshes by itself.
  ignition::common::SubMesh place("place");
  read_obj(sdf_file.substr(0, sdf_file.rfind('/')) + "/meshes/collision.obj", place);
  ignition::common::Mesh mesh;
  mesh.AddSubMesh(place);
  parts.world->GetModel("place")->GetLink("link")->AttachMeshShape("collision_mesh", mesh);
  const auto jackal = parts.world->GetModel("jackal");
  parts.base = jackal->GetLink("base_link");
  parts.left = {jackal->GetJoint("front_left_joint"), jackal->GetJoint("rear_left_joint")};
  parts.right = {jackal->GetJoint("front_right_joint"), jackal->GetJoint("rear_right_joint")};
  parts.input.Get<std::chrono::steady_clock::duration>() =
      std::chrono::duration_cast<std::chrono::steady_clock::duration>(
          std::chrono::duration<double>(kStep_s));
}

DartWorld::~DartWorld() = default;

void DartWorld::set_pose(double x_m, double y_m, double z_m, double yaw_rad) {
  Parts& parts = *parts_;
  parts.forward_mps = parts.turn_radps = 0.0;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = Eigen::Vector3d(x_m, y_m, z_m + kBaseHeight_m);
  pose.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const auto group = parts.world->GetModel("jackal")->FindFreeGroup();
  group->SetWorldPose(pose);
  group->SetWorldLinearVelocity(Eigen::Vector3d::Zero());
  group->SetWorldAngularVelocity(Eigen::Vector3d::Zero());
}

void DartWorld::step(double forward_mps, double turn_radps) {
  Parts& parts = *parts_;
  parts.forward_mps = towards(parts.forward_mps, forward_mps, kMost_mps2 * kStep_s);
  parts.turn_radps = towards(parts.turn_radps, turn_radps, kMost_radps2 * kStep_s);
  const double turn_mps = 0.5 * kSeparation_m * parts.turn_radps;
  for (const Joint& wheel : parts.left) {
    wheel->SetVelocityCommand(0, (parts.forward_mps - turn_mps) / kWheelRadius_m);
  }
  for (const Joint& wheel : parts.right) {
    wheel->SetVelocityCommand(0, (parts.forward_mps + turn_mps) / kWheelRadius_m);
  }
  parts.world->Step(parts.output, parts.state, parts.input);
}

BodyPose DartWorld::pose() const {
  const Eigen::Isometry3d base = parts_->base->FrameDataRelativeToWorld().pose;
  const Eigen::Vector3d origin = base * Eigen::Vector3d(0.0, 0.0, -kBaseHeight_m);
  const Eigen::Quaterniond q(base.linear());
  return {origin.x(), origin.y(), origin.z(), q.w(), q.x(), q.y(), q.z()};
}

}  // namespace segsim::tests
