// `segsim serve`: runs in a browser, while they run and afterwards.
#include <unistd.h>

#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
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
      .add_option(
          "--token", options.token,
          "What visitors must know, at least 22 characters; default: none on an address "
          "that is this machine's alone, else one that is made up")
      ->envname("SEGSIM_TOKEN");
}

void tell_address(const std::string& address, const web::HttpOptions& options) {
  const std::size_t token = address.find(web::kTokenInAddress);
  const bool shown = token == std::string::npos || ::isatty(STDOUT_FILENO) == 1;
  std::printf("%s\n", (shown ? address : address.substr(0, token)).c_str());
  std::fflush(stdout);
  if (shown) return;
  if (::isatty(STDERR_FILENO) == 1) {
    std::fprintf(stderr, "segsim: with the token: %s\n", address.c_str());
  } else if (options.token.empty()) {
    throw core::InputError::expected(
        "--token",
        "one of your own (or SEGSIM_TOKEN), as output that is redirected shows none", "none");
  }
}

void add_serve_command(CLI::App& app) {
  auto options = std::make_shared<dashboard::DashboardOptions>();
  CLI::App* command = light::add_listed(app, light::kCommands, "serve");
  command
      ->add_option("runs", options->roots,
                   "Work folders of `segsim run`, or folders that hold some")
      ->required();
  add_server_flags(*command, *options);
  command->callback([options] {
    dashboard::Dashboard dashboard(*options);
    serve_until_interrupted(dashboard, *options);
  });
}

}  // namespace segsim::experiments::commands
