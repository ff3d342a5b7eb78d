// Goals of a scene: classes, and phrases that an image-text model finds in it.
#include <algorithm>
#include <cctype>

#include "experiments/specs/internal/spec_readers.h"
#include "experiments/support/numbers_in_range.h"
#include "sim/trial/goal_objects.h"

namespace segsim::experiments::specs::internal {
namespace {

namespace fs = std::filesystem;
using core::ConfigNode;

PhraseSpec read_phrase(const ConfigNode& node) {
  PhraseSpec phrase;
  phrase.text = node.text("phrase");
  const bool lines = std::any_of(phrase.text.begin(), phrase.text.end(),
                                 [](unsigned char c) { return std::iscntrl(c) != 0; });
  if (sim::phrase_word(phrase.text).empty() || lines)
    node.child("phrase").fail("words on one line", "\"" + phrase.text + "\"");
  phrase.instances = support::count_within(node, "instances", phrase.instances, 1, 1000);
  node.finish();
  return phrase;
}

bool has_phrases(const SceneSpec& scene) { return !scene.phrases.empty(); }

}  // namespace

void read_goals(const ConfigNode& node, SceneSpec& scene) {
  std::vector<std::string> names;
  for (const ConfigNode& goal : node.child("goals").as_list()) {
    if (!goal.is_map()) {
      scene.goals.push_back(goal.as_text());
      continue;
    }
    scene.phrases.push_back(read_phrase(goal));
    const std::string name = sim::phrase_word(scene.phrases.back().text);
    if (std::find(names.begin(), names.end(), name) != names.end()) {
      goal.child("phrase").fail("a phrase that differs from others in letters or digits",
                                "\"" + scene.phrases.back().text + "\" again");
    }
    names.push_back(name);
  }
  for (const std::string& name : scene.goals) {
    const std::string word = sim::phrase_word(name);
    if (std::find(names.begin(), names.end(), word) == names.end()) continue;
    node.child("goals").fail("no phrase that is the name of a class",
                             "\"" + name + "\" twice");
  }
  if (scene.goals.empty() && scene.phrases.empty()) {
    node.child("goals").fail("at least one class name or phrase", "none");
  }
}

void read_phrase_model(const ConfigNode& root, const Variables& variables,
                       ExperimentSpec& spec) {
  const auto scene = std::find_if(spec.scenes.begin(), spec.scenes.end(), has_phrases);
  const std::optional<ConfigNode> node = root.optional_child("phrases");
  if (scene == spec.scenes.end()) {
    if (node) node->fail("a scene with a goal {phrase: ...}", "none");
    return;
  }
  if (!node) {
    root.fail("a key phrases: {model: FILE}, which finds \"" + scene->phrases[0].text +
                  "\" in scene " + scene->name,
              "none");
  }
  if (spec.repetitions.reconstruct_seeds > 1) {
    node->fail("one reconstruction of each scene, because things of another have other ids",
               std::to_string(spec.repetitions.reconstruct_seeds));
  }
  spec.phrases.model = variables.expand(node->child("model"));
  if (!fs::is_regular_file(spec.phrases.model)) {
    node->child("model").fail("the description of an image-text model (docs/models.md)",
                              "no file " + spec.phrases.model.string());
  }
  spec.phrases.views = support::count_within(*node, "views", spec.phrases.views, 1, 24);
  node->finish();
}

}  // namespace segsim::experiments::specs::internal
