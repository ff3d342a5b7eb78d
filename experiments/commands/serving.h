#pragma once

/// @file
/// What commands have in common that serve pages until they are interrupted.

#include <chrono>
#include <cstdio>
#include <thread>

#include "experiments/support/stop_signal.h"
#include "experiments/web/http_server.h"

namespace CLI {
class App;
}

namespace segsim::experiments::commands {

/// --host, --port and --token.
void add_server_flags(CLI::App& command, web::HttpOptions& options);

/// Prints the address and answers until a signal asks to stop.
/// @param server  Has address(), serve() and stop().
template <class Server>
void serve_until_interrupted(Server& server) {
  const support::StopOnSignal signals;
  std::printf("%s\n", server.address().c_str());
  std::fflush(stdout);
  std::fprintf(stderr, "segsim: serving until interrupted (Ctrl-C)\n");
  std::jthread watch([&](const std::stop_token& stop) {
    while (!stop.stop_requested() && !support::StopOnSignal::requested()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    server.stop();
  });
  server.serve();
}

}  // namespace segsim::experiments::commands
