// `segsim serve`: runs in a browser, while they run and afterwards.
#include <memory>

#include <CLI/CLI.hpp>

#include "experiments/commands/commands.h"
#include "experiments/commands/serving.h"
#include "experiments/dashboard/dashboard.h"

namespace segsim::experiments::commands {

void add_server_flags(CLI::App& command, web::HttpOptions& options) {
  command.add_option("--host", options.host, "Address to listen on")->capture_default_str();
  command.add_option("--port", options.port, "Port (0: any that is free)")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command
      .add_option("--token", options.token,
                  "What visitors must know; needed unless the address is this machine's alone")
      ->envname("SEGSIM_TOKEN");
}

void add_serve_command(CLI::App& app) {
  auto options = std::make_shared<dashboard::DashboardOptions>();
  CLI::App* command = add_listed(app, kCommands, "serve");
  command
      ->add_option("runs", options->roots,
                   "Work folders of `segsim run`, or folders that hold some")
      ->required();
  add_server_flags(*command, *options);
  command->callback([options] {
    dashboard::Dashboard dashboard(*options);
    serve_until_interrupted(dashboard);
  });
}

}  // namespace segsim::experiments::commands
