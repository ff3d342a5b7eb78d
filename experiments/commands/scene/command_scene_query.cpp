// `segsim scene query`.
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/progress.h"
#include "core/scene_bundle.h"
#include "experiments/commands/scene/scene_commands.h"
#include "experiments/detection/scene_query.h"
#include "experiments/scenes/scene_surfels.h"
#include "perception/data/image_file.h"
#include "renderer/renderer_backend.h"

namespace segsim::experiments::commands::scene {
namespace {

namespace fs = std::filesystem;

struct Flags {
  fs::path bundle, model, picture, json;
  std::vector<std::string> phrases;
  std::string backend = "cpu";
  int most = 5;
  double height_m = 0.0;  ///< 0: the bundle's.
  detection::SceneQueryOptions options;
};

void run(Flags& flags) {
  const auto scorer = perception::load_image_text_scorer(flags.model);
  const core::SceneBundle bundle = core::load_bundle(flags.bundle);
  const scenes::SceneSurfels surfels = scenes::load_scene_surfels(bundle);
  const auto renderer = renderer::make_renderer(renderer::backend_of(flags.backend),
                                                surfels.surfels, {}, surfels.labels);
  flags.options.camera_height_m =
      flags.height_m > 0.0 ? flags.height_m : bundle.manifest.camera_height_m;
  core::Progress progress("looking at things",
                          static_cast<std::int64_t>(bundle.manifest.instances.size()));
  const std::vector<detection::QueriedInstance> instances =
      detection::query_scene(*renderer, bundle.manifest, *scorer, flags.phrases, flags.options,
                             [&](int done, int) { progress.update(done); });
  std::fputs(detection::query_text(instances, flags.phrases, flags.most).c_str(), stdout);
  int unseen = 0;
  for (const detection::QueriedInstance& q : instances) unseen += q.views == 0 ? 1 : 0;
  if (unseen > 0) std::printf("\n%d things are seen from nowhere and have no score\n", unseen);
  if (!flags.picture.empty()) {
    perception::write_image(flags.picture,
                            detection::query_picture(instances, flags.phrases, flags.most));
    std::printf("picture: %s\n", flags.picture.c_str());
  }
  if (!flags.json.empty()) {
    detection::write_query(flags.json,
                           {flags.model.filename().string(), flags.phrases, instances});
  }
}

}  // namespace

void add_scene_query(CLI::App& scene) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = scene.add_subcommand(
      "query", "Rank the things of a scene by how well they fit a phrase");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml")->required();
  command->add_option("--prompt", flags->phrases, "Phrase, for example \"a red chair\"")
      ->required();
  command
      ->add_option("--model", flags->model,
                   "Description of an image-text model: CLIP, SigLIP or BLIP-2's head "
                   "(docs/models.md)")
      ->required();
  command->add_option("--top", flags->most, "Things to print and draw of each phrase")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--views", flags->options.views, "Views of each thing that are scored")
      ->check(CLI::Range(1, 24))
      ->capture_default_str();
  command->add_option("--height", flags->height_m, "Of the camera [m] (default: the bundle's)")
      ->check(CLI::Range(0.05, 10.0));
  command->add_option("--picture", flags->picture, "Draw the best ones (PNG)");
  command->add_option("--json", flags->json, "Write all scores");
  command->add_option("--backend", flags->backend, "cpu | cuda | auto")->capture_default_str();
  command->callback([flags] { run(*flags); });
}

}  // namespace segsim::experiments::commands::scene
