#include "sim/gazebo/gazebo_world.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <memory>
#include <numbers>
#include <vector>

#include <assimp/material.h>
#include <assimp/mesh.h>
#include <assimp/scene.h>
#include <assimp/Exporter.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "sim/ground/ground_grid.h"
#include "sim/ground/world.h"

namespace segsim::sim {
namespace {

namespace fs = std::filesystem;

// The public description of the robot, jackal_description/urdf/jackal.urdf.xacro: boxes and
// cylinders of the same size, and the base this far above the floor.
constexpr double kChassisLength_m = 0.420, kChassisWidth_m = 0.310, kChassisHeight_m = 0.184;
constexpr double kWheelWidth_m = 0.040, kWheelbase_m = 0.262, kWheelMass_kg = 0.477;
constexpr double kBaseHeight_m = 0.0635;
constexpr double kTotalMass_kg = 17.0;  // Data sheet.
constexpr double kImuRate_hz = 50.0, kGpsRate_hz = 40.0;
// Its laser scanner, a Hokuyo UST-10LX.
constexpr int kLaserBeams = 720;
constexpr double kLaserHalfAngle_rad = 0.75 * std::numbers::pi;
constexpr double kLaserNear_m = 0.1, kLaserFar_m = 30.0, kLaserRate_hz = 50.0;
constexpr double kLaserNoise_m = 0.001;

/// Gazebo sends poses after whole physics steps: 240 a second serve cameras of 30 and 60 Hz
/// without beats.
constexpr double kPhysicsRate_hz = 240.0;
constexpr double kLeastPoseRate_hz = 120.0;
constexpr double kDropHeight_m = 0.01;  ///< The robot settles on the reconstructed floor.

/// Text with numbers that read back as they were.
__attribute__((format(printf, 1, 2))) std::string text(const char* format, ...) {
  std::va_list arguments;
  va_start(arguments, format);
  std::va_list again;
  va_copy(again, arguments);
  const int size = std::vsnprintf(nullptr, 0, format, arguments);
  va_end(arguments);
  std::string result(static_cast<std::size_t>(size), '\0');
  std::vsnprintf(result.data(), result.size() + 1, format, again);
  va_end(again);
  return result;
}

std::string plugin(GazeboFlavour flavour, const char* file, const char* name,
                   const std::string& content = {}) {
  const bool older = flavour == GazeboFlavour::kIgnition;
  return text(R"(<plugin filename="%s-%s-system" name="%s::systems::%s">)",
              older ? "ignition-gazebo" : "gz-sim", file,
              older ? "ignition::gazebo" : "gz::sim", name) +
         content + "</plugin>\n";
}

std::string inertial(double mass_kg, double ixx, double iyy, double izz,
                     const std::string& pose = {}) {
  return "<inertial>" + pose +
         text(
             "<mass>%.6g</mass><inertia><ixx>%.6g</ixx><ixy>0</ixy><ixz>0</ixz>"
             "<iyy>%.6g</iyy><iyz>0</iyz><izz>%.6g</izz></inertia></inertial>\n",
             mass_kg, ixx, iyy, izz);
}

/// A shape to be seen and to collide.
std::string body(const char* name, const std::string& pose, const std::string& shape,
                 const char* color) {
  return text("<collision name=\"%s_collision\">", name) + pose + "<geometry>" + shape +
         "</geometry></collision>\n" + text("<visual name=\"%s_visual\">", name) + pose +
         "<geometry>" + shape + "</geometry>" +
         text("<material><ambient>%s</ambient><diffuse>%s</diffuse></material></visual>\n",
              color, color);
}

std::string camera_sensors(const GazeboWorldOptions& options) {
  const std::string optics = text(
      "<horizontal_fov>%.17g</horizontal_fov><image><width>%d</width><height>%d</height>"
      "<format>R8G8B8</format></image><clip><near>%.9g</near><far>%.9g</far></clip>",
      options.horizontal_fov_rad, options.width_px, options.height_px, options.near_m,
      options.far_m);
  const std::string mounting = text(
      "<pose>0 0 %.9g 0 %.17g 0</pose><update_rate>%.9g</update_rate>"
      "<always_on>true</always_on>",
      options.camera_height_m - kBaseHeight_m, options.camera_pitch_down_rad, options.rate_hz);
  return R"(<sensor name="front" type="rgbd_camera">)" + mounting +
         "<topic>camera</topic><camera>" + optics + "</camera></sensor>\n" +
         R"(<sensor name="front_labels" type="segmentation">)" + mounting +
         "<topic>panoptic</topic><camera><segmentation_type>panoptic</segmentation_type>" +
         optics + "</camera></sensor>\n";
}

std::string other_sensors() {
  const std::string laser_pose =
      text("<pose>0.12 0 %.4g 0 0 0</pose>", kChassisHeight_m + 0.03);
  return R"(<sensor name="laser" type="gpu_lidar">)" + laser_pose +
         text(
             "<topic>scan</topic><update_rate>%g</update_rate><lidar><scan><horizontal>"
             "<samples>%d</samples><resolution>1</resolution><min_angle>%.17g</min_angle>"
             "<max_angle>%.17g</max_angle></horizontal></scan><range><min>%g</min>"
             "<max>%g</max><resolution>0.001</resolution></range><noise><type>gaussian</type>"
             "<mean>0</mean><stddev>%g</stddev></noise></lidar></sensor>\n",
             kLaserRate_hz, kLaserBeams, -kLaserHalfAngle_rad, kLaserHalfAngle_rad,
             kLaserNear_m, kLaserFar_m, kLaserNoise_m) +
         text(R"(<sensor name="imu" type="imu"><topic>imu</topic><always_on>true</always_on>)"
              "<update_rate>%g</update_rate></sensor>\n",
              kImuRate_hz) +
         text(R"(<sensor name="gps" type="navsat"><topic>gps</topic><always_on>true)"
              "</always_on><update_rate>%g</update_rate></sensor>\n",
              kGpsRate_hz);
}

std::string base_link(const GazeboWorldOptions& options) {
  const double mass = kTotalMass_kg - 4.0 * kWheelMass_kg;
  const double x2 = kChassisLength_m * kChassisLength_m;
  const double y2 = kChassisWidth_m * kChassisWidth_m;
  const double z2 = kChassisHeight_m * kChassisHeight_m;
  const std::string middle = text("<pose>0 0 %.6g 0 0 0</pose>", 0.5 * kChassisHeight_m);
  std::string link =
      text("<link name=\"base_link\"><pose>0 0 %.6g 0 0 0</pose>\n", kBaseHeight_m) +
      inertial(mass, mass / 12.0 * (y2 + z2), mass / 12.0 * (x2 + z2), mass / 12.0 * (x2 + y2),
               middle) +
      body("chassis", middle,
           text("<box><size>%g %g %g</size></box>", kChassisLength_m, kChassisWidth_m,
                kChassisHeight_m),
           "0.9 0.7 0.1 1");
  const double mast_m = options.robot.mast_height_m - kBaseHeight_m - kChassisHeight_m;
  if (mast_m > 0.0) {
    link += body("mast", text("<pose>0 0 %.6g 0 0 0</pose>", kChassisHeight_m + 0.5 * mast_m),
                 text("<cylinder><radius>%g</radius><length>%.6g</length></cylinder>",
                      options.robot.mast_radius_m, mast_m),
                 "0.3 0.3 0.3 1");
  }
  return link + camera_sensors(options) + other_sensors() + "</link>\n";
}

std::string wheel(const RobotModel& robot, const std::string& name, double x_m, double y_m) {
  const double r2 = robot.wheel_radius_m * robot.wheel_radius_m;
  const double across = kWheelMass_kg / 12.0 * (3.0 * r2 + kWheelWidth_m * kWheelWidth_m);
  return text(
             "<link name=\"%s_wheel\"><pose relative_to=\"base_link\">%g %.6g %.6g %.17g 0 0"
             "</pose>\n",
             name.c_str(), x_m, y_m, robot.wheel_radius_m - kBaseHeight_m,
             -0.5 * std::numbers::pi) +
         inertial(kWheelMass_kg, across, across, 0.5 * kWheelMass_kg * r2) +
         body("wheel", {},
              text("<cylinder><radius>%g</radius><length>%g</length></cylinder>",
                   robot.wheel_radius_m, kWheelWidth_m),
              "0.1 0.1 0.1 1") +
         "</link>\n" +
         text(
             "<joint name=\"%s_joint\" type=\"revolute\"><parent>base_link</parent>"
             "<child>%s_wheel</child><axis><xyz>0 0 1</xyz></axis></joint>\n",
             name.c_str(), name.c_str());
}

/// The controller reckons with a wider track, because four wheels on two axles slip in turns.
std::string drive(const GazeboWorldOptions& options) {
  const RobotModel& robot = options.robot;
  return plugin(
      options.flavour, "diff-drive", "DiffDrive",
      text("<left_joint>front_left_joint</left_joint><left_joint>rear_left_joint</left_joint>"
           "<right_joint>front_right_joint</right_joint>"
           "<right_joint>rear_right_joint</right_joint>"
           "<wheel_separation>%.9g</wheel_separation><wheel_radius>%.9g</wheel_radius>"
           "<max_linear_velocity>%g</max_linear_velocity>"
           "<min_linear_velocity>%g</min_linear_velocity>"
           "<max_angular_velocity>%g</max_angular_velocity>"
           "<min_angular_velocity>%g</min_angular_velocity>"
           "<max_linear_acceleration>%g</max_linear_acceleration>"
           "<min_linear_acceleration>%g</min_linear_acceleration>"
           "<max_angular_acceleration>%g</max_angular_acceleration>"
           "<min_angular_acceleration>%g</min_angular_acceleration>"
           "<odom_publish_frequency>50</odom_publish_frequency>",
           robot.track_m * robot.separation_multiplier, robot.wheel_radius_m,
           robot.max_forward_mps, -robot.max_forward_mps, robot.max_turn_radps,
           -robot.max_turn_radps, robot.max_acceleration_mps2, -robot.max_deceleration_mps2,
           robot.max_turn_acceleration_radps2, -robot.max_turn_acceleration_radps2));
}

/// @param pose  Of the model; empty in a file of its own.
std::string jackal(const GazeboWorldOptions& options, const std::string& pose) {
  std::string model = "<model name=\"jackal\">" + pose + "\n" + base_link(options);
  for (const double x : {1.0, -1.0}) {
    for (const double y : {1.0, -1.0}) {
      model += wheel(options.robot,
                     std::string(x > 0 ? "front" : "rear") + (y > 0 ? "_left" : "_right"),
                     x * 0.5 * kWheelbase_m, y * 0.5 * options.robot.track_m);
    }
  }
  return model + drive(options) + "</model>\n";
}

/// Where the origin lies on the earth. Gazebo's heading turns as our yaw does, from east to
/// the world's x axis (its LOCAL2 coordinates).
std::string place_on_earth(const core::GeodeticOrigin& origin) {
  return text(
      "<spherical_coordinates><surface_model>EARTH_WGS84</surface_model>"
      "<world_frame_orientation>ENU</world_frame_orientation>"
      "<latitude_deg>%.17g</latitude_deg><longitude_deg>%.17g</longitude_deg>"
      "<elevation>%.17g</elevation><heading_deg>%.17g</heading_deg>"
      "</spherical_coordinates>\n",
      origin.latitude_deg, origin.longitude_deg, origin.height_m,
      origin.yaw_rad * 180.0 / std::numbers::pi);
}

constexpr const char* kHead = "<?xml version=\"1.0\"?>\n<sdf version=\"1.9\">\n";

std::string model_config() {
  return "<?xml version=\"1.0\"?>\n<model><name>jackal</name><version>1.0</version>"
         "<sdf version=\"1.9\">model.sdf</sdf><description>A robot the size of a Clearpath "
         "Jackal with a camera on a mast.</description></model>\n";
}

void write_text(const fs::path& file, const std::string& content) {
  core::write_file_atomically(file, [&](std::ostream& out) { out << content; });
}

}  // namespace

std::string gazebo_world_name(const std::string& scene_name) {
  std::string name = scene_name.empty() ? "scene" : scene_name;
  for (char& letter : name) {
    if (std::isalnum(static_cast<unsigned char>(letter)) == 0) letter = '_';
  }
  return name;
}

std::string gazebo_world_sdf(const core::SceneManifest& scene,
                             const GazeboWorldOptions& options) {
  SEGSIM_CHECK(options.flavour != GazeboFlavour::kBoth, "a world is of one flavour");
  const GazeboFlavour flavour = options.flavour;
  std::string world = kHead;
  world += "<world name=\"" + gazebo_world_name(scene.name) + "\">\n";
  world += text(
      "<physics name=\"steps\" type=\"ignored\"><max_step_size>%.17g</max_step_size>"
      "<real_time_factor>1</real_time_factor></physics>\n",
      1.0 / kPhysicsRate_hz);
  world += plugin(flavour, "physics", "Physics");
  world += plugin(flavour, "user-commands", "UserCommands");
  world += plugin(flavour, "scene-broadcaster", "SceneBroadcaster",
                  text("<dynamic_pose_hertz>%g</dynamic_pose_hertz>",
                       std::max(kLeastPoseRate_hz, 4.0 * options.rate_hz)));
  world += plugin(flavour, "imu", "Imu");
  world += plugin(flavour, "navsat", "NavSat");
  world += place_on_earth(scene.origin);
  world +=
      "<light name=\"lamp\" type=\"directional\"><pose>0 0 10 0 0 0</pose>"
      "<direction>-0.3 0.2 -0.9</direction><diffuse>0.8 0.8 0.8 1</diffuse></light>\n";
  const std::string mesh = "<geometry><mesh><uri>meshes/collision.obj</uri></mesh></geometry>";
  world +=
      "<model name=\"place\"><static>true</static><link name=\"link\">\n"
      "<collision name=\"collision\">" +
      mesh + "</collision>\n<visual name=\"visual\">" + mesh +
      "<material><ambient>0.7 0.7 0.7 1</ambient><diffuse>0.7 0.7 0.7 1</diffuse>"
      "<double_sided>true</double_sided></material></visual>\n</link></model>\n";
  world += jackal(options, text("<pose>%.9g %.9g %g 0 0 %.9g</pose>", options.start.x_m,
                                options.start.y_m, kDropHeight_m, options.start.yaw_rad));
  return world + "</world>\n</sdf>\n";
}

void write_mesh_obj(const fs::path& file, const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) {
    throw core::InputError::expected(file.string(), "a mesh with triangles", "none");
  }
  aiScene scene;  // Owns what is hung into it.
  scene.mRootNode = new aiNode("place");
  scene.mNumMaterials = 1;
  scene.mMaterials = new aiMaterial* [1] { new aiMaterial };
  scene.mNumMeshes = 1;
  scene.mMeshes = new aiMesh* [1] { new aiMesh };
  scene.mRootNode->mNumMeshes = 1;
  scene.mRootNode->mMeshes = new unsigned int[1]{0};
  aiMesh& out = *scene.mMeshes[0];
  out.mPrimitiveTypes = aiPrimitiveType_TRIANGLE;
  out.mNumVertices = static_cast<unsigned int>(mesh.positions_m.size());
  out.mVertices = new aiVector3D[out.mNumVertices];
  std::transform(mesh.positions_m.begin(), mesh.positions_m.end(), out.mVertices,
                 [](const glm::vec3& p) { return aiVector3D(p.x, p.y, p.z); });
  out.mNumFaces = static_cast<unsigned int>(mesh.triangles.size());
  out.mFaces = new aiFace[out.mNumFaces];
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const glm::uvec3& t = mesh.triangles[i];
    out.mFaces[i].mNumIndices = 3;
    out.mFaces[i].mIndices = new unsigned int[3]{t.x, t.y, t.z};
  }
  core::write_via_temporary(file, [&](const fs::path& temporary) {
    Assimp::Exporter exporter;
    if (exporter.Export(&scene, "objnomtl", temporary.string()) != aiReturn_SUCCESS) {
      throw core::InputError::expected(file.string(), "a place for a mesh",
                                       exporter.GetErrorString());
    }
  });
}

core::Pose2 roomiest_start(const core::SceneBundle& bundle, const RobotModel& robot) {
  const World world = World::load(bundle, robot);
  const FreeSpace& space = world.free_space();
  GridMask closed(space.frame.width, space.frame.height);
  std::transform(space.island.pixels().begin(), space.island.pixels().end(),
                 closed.pixels().begin(),
                 [](std::int32_t island) { return static_cast<std::uint8_t>(island != 1); });
  const core::Image<float> room_m = distance_to_marked(closed, space.frame.cell_m);
  const auto best = std::max_element(room_m.pixels().begin(), room_m.pixels().end());
  const auto index = static_cast<int>(best - room_m.pixels().begin());
  const glm::dvec2 at =
      space.frame.center_m(index % space.frame.width, index / space.frame.width);
  return {at.x, at.y, 0.0};
}

void export_gazebo_world(const core::SceneBundle& bundle, const fs::path& folder,
                         const GazeboWorldOptions& options) {
  write_mesh_obj(folder / "meshes" / "collision.obj",
                 read_mesh_ply(bundle.collision_mesh_file()));
  const fs::path robot = folder / "models" / "jackal";
  write_text(robot / "model.sdf", kHead + jackal(options, {}) + "</sdf>\n");
  write_text(robot / "model.config", model_config());
  write_text(folder / "world.sdf", gazebo_world_sdf(bundle.manifest, options));
}

}  // namespace segsim::sim
