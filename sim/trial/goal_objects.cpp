#include "sim/trial/goal_objects.h"

#include <algorithm>
#include <cctype>
#include <utility>

namespace segsim::sim {

GoalObjects::GoalObjects(const core::SceneManifest& manifest, const Episode& episode)
    : GoalObjects(manifest, episode.class_name, episode.goal_instances) {}

GoalObjects::GoalObjects(const core::SceneManifest& manifest, const std::string& class_name,
                         std::vector<std::uint16_t> instances)
    : instances_(std::move(instances)) {
  const core::SceneClass* found = manifest.find_class(class_name);
  if (found != nullptr) class_id_ = found->id;
}

bool GoalObjects::named(std::uint16_t instance) const {
  return std::find(instances_.begin(), instances_.end(), instance) != instances_.end();
}

std::string phrase_word(const std::string& phrase) {
  std::string word;
  for (const char c : phrase) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 128 || std::isalnum(byte) != 0) {  // Letters beyond ASCII stay as they are.
      word += static_cast<char>(byte >= 128 ? byte : std::tolower(byte));
    } else if (!word.empty() && word.back() != '-') {
      word += '-';
    }
  }
  while (!word.empty() && word.back() == '-') word.pop_back();
  return word;
}

std::string with_article(const std::string& goal_name) {
  for (const char* article : {"a ", "an ", "the "}) {
    if (goal_name.starts_with(article)) return goal_name;
  }
  return "a " + goal_name;
}

}  // namespace segsim::sim
