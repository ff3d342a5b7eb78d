// `segsim serve`: runs in a browser, while they run and afterwards.
#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>

#include <CLI/CLI.hpp>

#include "experiments/commands/commands.h"
#include "experiments/dashboard/dashboard.h"
#include "experiments/support/stop_signal.h"

namespace segsim::experiments::commands {
namespace {

constexpr auto kSignalPoll = std::chrono::milliseconds(100);

void serve(const dashboard::DashboardOptions& options) {
  dashboard::Dashboard dashboard(options);
  const support::StopOnSignal signals;
  std::printf("%s\n", dashboard.address().c_str());
  std::fflush(stdout);
  std::fprintf(stderr, "segsim: serving until interrupted (Ctrl-C)\n");
  std::jthread watch([&](const std::stop_token& stop) {
    while (!stop.stop_requested() && !support::StopOnSignal::requested()) {
      std::this_thread::sleep_for(kSignalPoll);
    }
    dashboard.stop();
  });
  dashboard.serve();
}

}  // namespace

void add_serve_command(CLI::App& app) {
  auto options = std::make_shared<dashboard::DashboardOptions>();
  CLI::App* command = add_listed(app, kCommands, "serve");
  command
      ->add_option("runs", options->roots,
                   "Work folders of `segsim run`, or folders that hold some")
      ->required();
  command->add_option("--host", options->host, "Address to listen on")->capture_default_str();
  command->add_option("--port", options->port, "Port (0: any that is free)")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command
      ->add_option(
          "--token", options->token,
          "What visitors must know; needed unless the address is this machine's alone")
      ->envname("SEGSIM_TOKEN");
  command->callback([options] { serve(*options); });
}

}  // namespace segsim::experiments::commands
