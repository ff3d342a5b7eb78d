#pragma once

/// @file
/// Networks of others (perception/models), programs of others (peers) and stacks on a ROS 2
/// network (ros) behind the interfaces of policies (nav): the modules do not know each other,
/// and meet here.

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "experiments/ros2/robot_node.h"
#include "nav/policies/built_in_policies.h"
#include "nav/policies/policy_registry.h"
#include "peers/peer.h"

namespace segsim::experiments::trials {

/// The descriptions of models that the settings of a built-in policy name.
[[nodiscard]] std::vector<std::filesystem::path> model_files(const nav::PolicyChoice& policy);

/// Loads each model, and starts each program, once, for all policies of one thread.
class LoadedPolicyModels {
 public:
  /// What policies load by. Outlived by this object.
  [[nodiscard]] nav::PolicyModels loaders();

  /// Loads or starts what the settings of a built-in policy name, so that a mistake is told
  /// before any trial. @throws core::InputError
  void load(const nav::PolicyChoice& policy);

 private:
  [[nodiscard]] std::shared_ptr<peers::Peer> process(const core::PeerCommand& command);
  [[nodiscard]] std::shared_ptr<ros2::RobotNode> robot(const nav::Ros2Settings& settings);

  std::map<std::pair<std::filesystem::path, std::string>,
           std::shared_ptr<nav::ImageTextScorer>>
      scorers_;
  std::map<std::filesystem::path, std::shared_ptr<nav::Segmenter>> segmenters_;
  std::map<std::filesystem::path, std::shared_ptr<nav::DepthInference>> depths_;
  std::vector<std::pair<core::PeerCommand, std::shared_ptr<peers::Peer>>> processes_;
  std::vector<std::pair<nav::Ros2Settings, std::shared_ptr<ros2::RobotNode>>> robots_;
};

}  // namespace segsim::experiments::trials
