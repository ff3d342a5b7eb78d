// `segsim scene label`: labels of a bundle corrected in a browser.
#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "experiments/commands/scene/scene_commands.h"
#include "experiments/commands/serving.h"
#include "experiments/scene_labels/label_server.h"

namespace segsim::experiments::commands::scene {

void add_scene_label(CLI::App& scene) {
  struct Flags {
    std::filesystem::path bundle;
    web::HttpOptions server;
  };
  auto flags = std::make_shared<Flags>();
  CLI::App* command = scene.add_subcommand(
      "label", "Correct labels in a browser: name, merge, split and delete objects");
  command->footer(
      "Every edit is saved at once and can be undone, also after a restart\n"
      "(label_journal.jsonl in the bundle). The page says which keys do what.");
  command->add_option("bundle", flags->bundle, "Folder with scene.yaml; it is changed")
      ->required();
  add_server_flags(*command, flags->server);
  command->callback([flags] {
    scene_labels::LabelServer server(flags->bundle, flags->server);
    serve_until_interrupted(server, flags->server);
  });
}

}  // namespace segsim::experiments::commands::scene
