#pragma once

/// @file
/// Policies by name. A spec chooses one by its name, or by a map with its settings:
///
///     policy: frontier
///     policy: {type: frontier, follower: dwa}
///
/// A program adds its own with one call, before it reads its first spec:
///
///     struct Settings { double speed_mps = 0.3; };
///     PolicyRegistry::instance().add<Settings>(
///         "mine",
///         [](const SettingsNode& node, Settings& settings) {
///           settings.speed_mps = node.number_or("speed_mps", settings.speed_mps);
///         },
///         [](const Settings& settings, const PolicyContext& context) {
///           return std::make_unique<Mine>(settings, context.robot);
///         });
///
/// Keys that the reader does not ask for are refused.

#include <any>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/config.h"
#include "core/process/peer_command.h"
#include "core/robot_base.h"
#include "core/stages.h"
#include "nav/policies/baseline_policies.h"

namespace segsim::nav {

class DepthInference;
class ImageTextScorer;
class Segmenter;

struct PolicyContext;
struct Ros2Settings;

/// Networks and programs of others that settings may name. Whoever makes policies hands them
/// in, because a policy does not read networks or start programs itself.
struct PolicyModels {
  /// @param model  Description (docs/models.md). @param prompt  "{}" stands for the target.
  /// @throws core::InputError if it cannot be used.
  std::function<std::shared_ptr<ImageTextScorer>(const std::filesystem::path& model,
                                                 const std::string& prompt)>
      scorer;
  /// @throws core::InputError if it cannot be used.
  std::function<std::shared_ptr<Segmenter>(const std::filesystem::path& model)> segmenter;
  /// @throws core::InputError if it cannot be used.
  std::function<std::shared_ptr<DepthInference>(const std::filesystem::path& model)> depth;
  /// A policy in another process, of this trial.
  /// @throws core::InputError if it cannot be started.
  std::function<std::unique_ptr<core::Policy>(const core::PeerCommand& command,
                                              const PolicyContext& context)>
      process;
  /// A stack on a ROS 2 network, of this trial.
  /// @throws core::InputError if this program cannot speak to it.
  std::function<std::unique_ptr<core::Policy>(const Ros2Settings& settings,
                                              const PolicyContext& context)>
      ros2;
};

/// What a policy may know of the trial besides its observations.
struct PolicyContext {
  std::vector<std::string> class_names;  ///< Of the detector.
  core::RobotBase robot;                 ///< It plans for this one.
  double camera_height_m = 1.2;          ///< Of the robot in this scene.
  PathOracle oracle;                     ///< Null but for "oracle-path".
  PolicyModels models;                   ///< Null where no policy may use any.
};

using MakePolicy = std::function<std::unique_ptr<core::Policy>(const PolicyContext&)>;
/// Path of a node, with the spec's variables replaced.
using ExpandPath = std::function<std::filesystem::path(const core::ConfigNode&)>;

/// The map of a policy in a spec, with a reader for paths.
class SettingsNode : public core::ConfigNode {
 public:
  SettingsNode(core::ConfigNode node, ExpandPath expand)
      : ConfigNode(std::move(node)), expand_(std::move(expand)) {}
  [[nodiscard]] std::filesystem::path path(const std::string& key) const {
    return expand_(child(key));
  }
  /// The path of a node inside this one.
  [[nodiscard]] std::filesystem::path expanded(const core::ConfigNode& node) const {
    return expand_(node);
  }
  /// A map inside this one.
  [[nodiscard]] SettingsNode map(const std::string& key) const {
    return {child(key), expand_};
  }

 private:
  ExpandPath expand_;
};

/// A policy as a spec chooses it: its name and its settings.
class PolicyChoice {
 public:
  PolicyChoice(std::string name, std::any settings, MakePolicy make)
      : name_(std::move(name)), settings_(std::move(settings)), make_(std::move(make)) {}

  [[nodiscard]] const std::string& name() const { return name_; }
  /// Null if the policy has settings of another type.
  template <class Settings>
  [[nodiscard]] const Settings* settings() const {
    return std::any_cast<Settings>(&settings_);
  }
  /// @throws core::InputError if a file that the settings name is wrong.
  [[nodiscard]] std::unique_ptr<core::Policy> make(const PolicyContext& context) const {
    return make_(context);
  }

 private:
  std::string name_;
  std::any settings_;
  MakePolicy make_;
};

class PolicyRegistry {
 public:
  /// With the built-in policies (nav/policies/built_in_policies.h).
  PolicyRegistry();
  /// The one that specs are read with. Adding to it is not for several threads at once.
  [[nodiscard]] static PolicyRegistry& instance();

  /// Adds a policy without settings.
  /// @throws ContractViolation if the name is taken.
  void add(const std::string& name, MakePolicy make);
  /// Adds a policy with settings. `Settings{}` holds the defaults.
  /// @param read  Takes what the map gives; throws core::InputError by node.fail().
  /// @param required  Keys without which it cannot be chosen, for the message: "actions:
  /// [...]".
  /// @throws ContractViolation if the name is taken.
  template <class Settings>
  void add(
      const std::string& name, std::function<void(const SettingsNode&, Settings&)> read,
      std::function<std::unique_ptr<core::Policy>(const Settings&, const PolicyContext&)> make,
      const std::string& required = {}) {
    add_entry({name, required, [name, read, make](const SettingsNode* node) {
                 Settings settings = Settings();
                 if (node != nullptr) read(*node, settings);
                 return PolicyChoice(name, settings,
                                     [make, settings](const PolicyContext& context) {
                                       return make(settings, context);
                                     });
               }});
  }

  /// In the order in which they were added.
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  /// A policy with its default settings.
  /// @throws ContractViolation if there is none of this name or it has required keys.
  [[nodiscard]] PolicyChoice usual(const std::string& name) const;
  /// Reads a name or a map.
  /// @throws core::InputError with file, line and key.
  [[nodiscard]] PolicyChoice read(const core::ConfigNode& node,
                                  const ExpandPath& expand) const;

 private:
  struct Entry {
    std::string name, required;
    /// Null: with the default settings.
    std::function<PolicyChoice(const SettingsNode*)> choose;
  };
  void add_entry(Entry entry);
  [[nodiscard]] const Entry* find(const std::string& name) const;

  std::vector<Entry> entries_;
  std::vector<std::string> names_;
};

}  // namespace segsim::nav
