#include "sim/gazebo/gazebo_cameras.h"

#include <cmath>
#include <cstddef>
#include <utility>

#include <ignition/math/Pose3.hh>
#include <sdf/sdf.hh>

#include "core/error.h"

namespace segsim::sim {
namespace {

/// A sensor looks along +x with z up; the optical frame along +z with y down.
const glm::dquat kR_sensor_camera(0.5, -0.5, 0.5, -0.5);

using LinkPose = core::Transform<GazeboLinkFrame, GazeboLinkFrame>;

LinkPose transform(const ignition::math::Pose3d& pose) {
  return {glm::dquat(pose.Rot().W(), pose.Rot().X(), pose.Rot().Y(), pose.Rot().Z()),
          {pose.X(), pose.Y(), pose.Z()}};
}

/// The way down to a link.
struct Scope {
  std::vector<std::string> path;
  LinkPose T_world_here;  ///< As the file says; holds for static models only.
  bool fixed = false;     ///< In a static model.

  [[nodiscard]] std::string joined(const std::string& between) const {
    std::string text;
    for (const std::string& name : path) text += (text.empty() ? "" : between) + name;
    return text;
  }
};

class Reader {
 public:
  Reader(std::string place, std::string world) : place_(std::move(place)) {
    found_.world = std::move(world);
  }

  void read_model(const sdf::Model& model, Scope scope) {
    scope.path.push_back(model.Name());
    scope.fixed = scope.fixed || model.Static();
    ignition::math::Pose3d pose;
    resolve(model.SemanticPose(), pose, scope);
    scope.T_world_here = scope.T_world_here * transform(pose);
    for (std::uint64_t i = 0; i < model.LinkCount(); ++i) {
      read_link(*model.LinkByIndex(i), scope);
    }
    for (std::uint64_t i = 0; i < model.ModelCount(); ++i) {
      read_model(*model.ModelByIndex(i), scope);
    }
  }

  GazeboCameras take() {
    if (found_.cameras.empty()) {
      throw core::InputError::expected(
          place_, "a sensor of type camera, depth_camera, rgbd_camera or segmentation",
          "none");
    }
    return std::move(found_);
  }

 private:
  void resolve(const sdf::SemanticPose& semantic, ignition::math::Pose3d& pose,
               const Scope& scope) const {
    if (!semantic.Resolve(pose).empty()) {
      throw core::InputError::expected(place_ + ": " + scope.joined("::"),
                                       "a pose relative to a known frame", "another");
    }
  }

  void read_link(const sdf::Link& link, Scope scope) {
    scope.path.push_back(link.Name());
    ignition::math::Pose3d pose;
    resolve(link.SemanticPose(), pose, scope);
    scope.T_world_here = scope.T_world_here * transform(pose);
    for (std::uint64_t i = 0; i < link.SensorCount(); ++i) {
      const sdf::Sensor& sensor = *link.SensorByIndex(i);
      switch (sensor.Type()) {
        case sdf::SensorType::CAMERA:
        case sdf::SensorType::DEPTH_CAMERA:
        case sdf::SensorType::RGBD_CAMERA:
        case sdf::SensorType::SEGMENTATION_CAMERA:
          read_sensor(sensor, scope);
          break;
        default:
          break;
      }
    }
  }

  void read_sensor(const sdf::Sensor& sensor, const Scope& link) {
    GazeboCamera camera;
    camera.frame_id = link.joined("::") + "::" + sensor.Name();
    ignition::math::Pose3d pose;
    resolve(sensor.SemanticPose(), pose, link);
    const LinkPose T_link_sensor =
        link.fixed ? link.T_world_here * transform(pose) : transform(pose);
    camera.T_link_camera = {T_link_sensor.rotation() * kR_sensor_camera,
                            T_link_sensor.translation_m()};
    if (!link.fixed) camera.link_path = link.path;
    camera.rate_hz = sensor.UpdateRate();
    read_optics(sensor, camera);
    name_topics(sensor, link, camera);
    found_.cameras.push_back(std::move(camera));
  }

  void read_optics(const sdf::Sensor& sensor, GazeboCamera& camera) {
    const std::string place = place_ + ": " + camera.frame_id;
    const sdf::Camera* optics = sensor.CameraSensor();
    if (optics == nullptr) throw core::InputError::expected(place, "a <camera>", "none");
    constexpr std::uint32_t kMaxSize_px = 65535;
    if (optics->ImageWidth() < 1 || optics->ImageHeight() < 1 ||
        optics->ImageWidth() > kMaxSize_px || optics->ImageHeight() > kMaxSize_px) {
      throw core::InputError::expected(place, "an image of 1 ... 65535 pixels a side",
                                       std::to_string(optics->ImageWidth()) + " x " +
                                           std::to_string(optics->ImageHeight()));
    }
    const double fov_rad = optics->HorizontalFov().Radian();
    if (!(fov_rad > 0.0 && fov_rad < 3.1)) {
      throw core::InputError::expected(place, "a horizontal_fov in (0, 3.1) rad",
                                       std::to_string(fov_rad));
    }
    if (!(camera.rate_hz >= 0.0 && std::isfinite(camera.rate_hz))) {
      throw core::InputError::expected(place, "an update_rate of 0 or more",
                                       std::to_string(camera.rate_hz));
    }
    camera.intrinsics =
        core::CameraIntrinsics::from_fov(static_cast<int>(optics->ImageWidth()),
                                         static_cast<int>(optics->ImageHeight()), fov_rad);
    if (optics->HasLensIntrinsics()) {
      camera.intrinsics.fx_px = optics->LensIntrinsicsFx();
      camera.intrinsics.fy_px = optics->LensIntrinsicsFy();
      camera.intrinsics.cx_px = optics->LensIntrinsicsCx();
      camera.intrinsics.cy_px = optics->LensIntrinsicsCy();
      if (!(camera.intrinsics.fx_px > 0.0 && camera.intrinsics.fy_px > 0.0)) {
        throw core::InputError::expected(place, "positive focal lengths",
                                         std::to_string(camera.intrinsics.fx_px));
      }
    }
    camera.near_m = optics->NearClip();
    camera.far_m = optics->FarClip();
    for (const double k :
         {optics->DistortionK1(), optics->DistortionK2(), optics->DistortionK3(),
          optics->DistortionP1(), optics->DistortionP2()}) {
      if (k != 0.0) {
        found_.warnings.push_back(camera.frame_id + ": lens distortion is left out");
        break;
      }
    }
    if (optics->ImageNoise().Type() != sdf::NoiseType::NONE) {
      found_.warnings.push_back(camera.frame_id + ": image noise is left out");
    }
  }

  void name_topics(const sdf::Sensor& sensor, const Scope& link, GazeboCamera& camera) const {
    std::string scoped = "/world/" + found_.world;
    for (std::size_t i = 0; i + 1 < link.path.size(); ++i) scoped += "/model/" + link.path[i];
    scoped += "/link/" + link.path.back() + "/sensor/" + sensor.Name();
    std::string topic = sensor.Topic();
    if (!topic.empty() && topic.front() != '/') topic.insert(topic.begin(), '/');
    const auto or_default = [&](const char* suffix) {
      return topic.empty() ? scoped + suffix : topic;
    };
    switch (sensor.Type()) {
      case sdf::SensorType::CAMERA:
        camera.rgb_topic = or_default("/image");
        camera.info_topic = beside(camera.rgb_topic);
        break;
      case sdf::SensorType::DEPTH_CAMERA:
        camera.depth_topic = or_default("/depth_image");
        camera.info_topic = beside(camera.depth_topic);
        break;
      case sdf::SensorType::RGBD_CAMERA:
        camera.rgb_topic = or_default("") + "/image";
        camera.depth_topic = or_default("") + "/depth_image";
        camera.info_topic = or_default("") + "/camera_info";
        break;
      default:
        camera.labels_topic = or_default("/segmentation") + "/labels_map";
        camera.colored_topic = or_default("/segmentation") + "/colored_map";
        camera.info_topic = or_default("/segmentation") + "/camera_info";
        camera.labels = label_coding(sensor, camera.frame_id);
    }
  }

  [[nodiscard]] GazeboLabels label_coding(const sdf::Sensor& sensor,
                                          const std::string& frame_id) const {
    std::string type = "semantic";
    if (sensor.CameraSensor()->HasSegmentationType()) {
      type = sensor.CameraSensor()->SegmentationType();
    } else if (sensor.Element() && sensor.Element()->HasElement("segmentation_type")) {
      type = sensor.Element()->Get<std::string>("segmentation_type");  // As Fortress had it.
    }
    if (type == "semantic") return GazeboLabels::kSemantic;
    if (type == "panoptic" || type == "instance") return GazeboLabels::kPanoptic;
    throw core::InputError::expected(place_ + ": " + frame_id,
                                     "segmentation_type semantic, panoptic or instance", type);
  }

  /// The info topic of a plain camera.
  static std::string beside(const std::string& topic) {
    return topic.substr(0, topic.rfind('/')) + "/camera_info";
  }

  std::string place_;
  GazeboCameras found_;
};

/// Errors of the parser that leave the world readable are Gazebo's business.
GazeboCameras read_world(const sdf::Root& root, const sdf::Errors& errors,
                         const std::string& place) {
  const sdf::World* world = root.WorldCount() > 0 ? root.WorldByIndex(0) : nullptr;
  if (world == nullptr) {
    throw core::InputError::expected(place, "an SDF file with a world",
                                     errors.empty() ? "none" : errors.front().Message());
  }
  Reader reader(place, world->Name());
  for (std::uint64_t i = 0; i < world->ModelCount(); ++i) {
    reader.read_model(*world->ModelByIndex(i), {});
  }
  return reader.take();
}

sdf::ParserConfig quiet_parser() {
  sdf::ParserConfig config;
  config.SetWarningsPolicy(sdf::EnforcementPolicy::LOG);
  config.SetDeprecatedElementsPolicy(sdf::EnforcementPolicy::LOG);
  config.SetUnrecognizedElementsPolicy(sdf::EnforcementPolicy::LOG);
  return config;
}

}  // namespace

GazeboCameras read_gazebo_cameras(const std::filesystem::path& world_file) {
  if (!std::filesystem::is_regular_file(world_file)) {
    throw core::InputError::expected(world_file.string(), "an SDF world file", "no such file");
  }
  sdf::ParserConfig config = quiet_parser();
  const std::filesystem::path folder = std::filesystem::absolute(world_file).parent_path();
  config.AddURIPath("model://", (folder / "models").string());
  config.AddURIPath("model://", (folder.parent_path() / "models").string());
  sdf::Root root;
  const sdf::Errors errors = root.Load(world_file.string(), config);
  return read_world(root, errors, world_file.string());
}

GazeboCameras parse_gazebo_cameras(const std::string& sdf_text, const std::string& place) {
  sdf::Root root;
  const sdf::Errors errors = root.LoadSdfString(sdf_text, quiet_parser());
  return read_world(root, errors, place);
}

}  // namespace segsim::sim
