#include "experiments/trials/internal/scene_phrases.h"

#include <cstdio>
#include <string>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "experiments/detection/scene_query.h"
#include "experiments/support/step_record.h"
#include "perception/data/image_file.h"
#include "perception/models/image_text_scorer.h"
#include "perception/models/model_description.h"

namespace segsim::experiments::trials {
namespace {

namespace fs = std::filesystem;

constexpr int kShown = 5;  // Of each phrase, printed and drawn.

std::vector<std::string> texts_of(const specs::SceneSpec& scene) {
  std::vector<std::string> texts;
  for (const specs::PhraseSpec& phrase : scene.phrases) texts.push_back(phrase.text);
  return texts;
}

std::string recipe(const specs::PhraseModelSpec& spec, const specs::SceneSpec& scene,
                   const core::SceneBundle& bundle) {
  std::string text = "phrases v1: scene " + bundle.scene_sha256 + ", camera " +
                     core::print("%g m, %d views; model ", scene.camera_height_m, spec.views) +
                     core::sha256_of_file(spec.model);
  for (const auto& [role, file] : perception::read_model_description(spec.model).files) {
    text += ", " + role + " " + core::sha256_of_file(file);
  }
  for (const std::string& phrase : texts_of(scene)) text += "; " + phrase;
  return text;
}

/// Asks the model, and tells and keeps what it says.
void ask(const specs::PhraseModelSpec& spec, const specs::SceneSpec& scene,
         const core::SceneBundle& bundle, core::Renderer& renderer, const fs::path& file) {
  std::printf("finding what phrases mean in scene %s\n", scene.name.c_str());
  const auto scorer = perception::load_image_text_scorer(spec.model);
  detection::SceneQueryOptions options;
  options.views = spec.views;
  options.camera_height_m = scene.camera_height_m;
  core::Progress progress("looking at things",
                          static_cast<std::int64_t>(bundle.manifest.instances.size()));
  detection::SceneQuery query{spec.model.filename().string(), texts_of(scene), {}};
  query.instances =
      detection::query_scene(renderer, bundle.manifest, *scorer, query.phrases, options,
                             [&](int done, int) { progress.update(done); });
  progress.finish();
  const std::string text = detection::query_text(query.instances, query.phrases, kShown);
  std::printf("%s\n", text.c_str());
  fs::path picture = file;
  picture.replace_extension(".png");
  perception::write_image(picture,
                          detection::query_picture(query.instances, query.phrases, kShown));
  detection::write_query(file, query);
}

episodes::PhraseGoal goal_of(const detection::SceneQuery& query, std::size_t phrase,
                             const specs::PhraseSpec& wanted, const std::string& scene) {
  episodes::PhraseGoal goal{wanted.text, {}, {}};
  for (const std::size_t i : detection::meant_by(query.instances, phrase, wanted.instances)) {
    goal.class_name = query.instances[i].class_name;
    goal.instances.push_back(query.instances[i].id);
  }
  if (static_cast<int>(goal.instances.size()) < wanted.instances) {
    const std::string of =
        goal.class_name.empty() ? "" : " of class " + goal.class_name + ", that of the best";
    throw core::InputError::expected(
        "scene " + scene + ": phrase \"" + wanted.text + "\"",
        std::to_string(wanted.instances) + " things" + of + ", that a camera sees",
        std::to_string(goal.instances.size()));
  }
  return goal;
}

}  // namespace

std::vector<episodes::PhraseGoal> scene_phrases(
    const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
    const core::SceneBundle& bundle, const fs::path& work,
    const std::function<std::unique_ptr<core::Renderer>()>& make_eye) {
  std::vector<episodes::PhraseGoal> goals;
  if (scene.phrases.empty()) return goals;
  const fs::path file = work / "phrases" / (scene.name + ".json");
  const support::StepRecord step(file.string() + ".step", recipe(spec.phrases, scene, bundle));
  if (!fs::exists(file) || !step.is_current()) {
    fs::create_directories(file.parent_path());
    ask(spec.phrases, scene, bundle, *make_eye(), file);
    step.mark_done();
  }
  const detection::SceneQuery query = detection::read_query(file);
  if (query.phrases != texts_of(scene)) {
    throw core::InputError::expected(file.string(), "the phrases of scene " + scene.name,
                                     "others (remove the file)");
  }
  for (std::size_t k = 0; k < scene.phrases.size(); ++k) {
    goals.push_back(goal_of(query, k, scene.phrases[k], scene.name));
  }
  return goals;
}

}  // namespace segsim::experiments::trials
