// Instead of gazebo_bridge.cpp in a program without the transport.

#include "core/error.h"
#include "sim/gazebo/gazebo_bridge.h"

namespace segsim::sim {

struct GazeboBridge::Parts {};

GazeboBridge::GazeboBridge(GazeboBridgeOptions /*options*/, core::Renderer& /*renderer*/,
                           const core::SceneManifest& /*scene*/) {
  throw core::InputError::expected("Gazebo bridge", "a build with SEGSIM_GAZEBO=ON",
                                   "one without");
}

GazeboBridge::~GazeboBridge() = default;

void GazeboBridge::run(const std::function<bool()>& /*keep_going*/) {}

GazeboStatus GazeboBridge::status() const { return {}; }

const std::string& GazeboBridge::pose_topic() const {
  static const std::string none;
  return none;
}

std::vector<std::string> GazeboBridge::contested_topics() const { return {}; }

}  // namespace segsim::sim
