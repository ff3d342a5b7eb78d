#pragma once

/// @file
/// Which objects of a scene end an episode: those that success is judged by.

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene_bundle.h"
#include "sim/trial/trial.h"

namespace segsim::sim {

/// All objects of the episode's class, or those among them that its phrase means.
class GoalObjects {
 public:
  GoalObjects(const core::SceneManifest& manifest, const Episode& episode);
  /// @param instances  Empty: all objects of the class.
  GoalObjects(const core::SceneManifest& manifest, const std::string& class_name,
              std::vector<std::uint16_t> instances = {});

  /// Whether the scene has no such class.
  [[nodiscard]] bool empty() const { return class_id_ == 0; }
  [[nodiscard]] bool holds(std::uint16_t class_id, std::uint16_t instance) const {
    return class_id == class_id_ && class_id != 0 && (instances_.empty() || named(instance));
  }
  [[nodiscard]] bool holds(const core::SceneInstance& instance) const {
    return holds(instance.class_id, instance.id);
  }

 private:
  [[nodiscard]] bool named(std::uint16_t instance) const;

  std::uint16_t class_id_ = 0;
  std::vector<std::uint16_t> instances_;  ///< Empty: all of the class.
};

/// "a couch" for a couch; a phrase that brings its article keeps it.
[[nodiscard]] std::string with_article(const std::string& goal_name);

/// A phrase as a part of names and files: "a-red-chair"; empty without a letter or digit.
[[nodiscard]] std::string phrase_word(const std::string& phrase);

}  // namespace segsim::sim
