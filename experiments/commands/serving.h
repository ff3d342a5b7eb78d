#pragma once

/// @file
/// What commands have in common that serve pages until they are interrupted.

#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include "experiments/support/stop_signal.h"
#include "experiments/web/http_server.h"

namespace CLI {  // NOLINT(readability-identifier-naming): theirs
class App;
}

namespace segsim::experiments::commands {

/// --host, --port and --token.
void add_server_flags(CLI::App& command, web::HttpOptions& options);

/// Prints the address. Its token is shown on a terminal alone: what is redirected ends in
/// files and logs that others read.
/// @throws core::InputError if the token was made up and there is no terminal to tell it on.
void tell_address(const std::string& address, const web::HttpOptions& options);

/// Prints the address and answers until a signal asks to stop.
/// @param server  Has address(), serve() and stop().  @param options  It was made with.
template <class Server>
void serve_until_interrupted(Server& server, const web::HttpOptions& options) {
  const support::StopOnSignal signals;
  tell_address(server.address(), options);
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
