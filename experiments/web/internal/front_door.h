#pragma once

/// @file
/// The connections of the server. One thread holds all of them without blocking, and only a
/// request that has arrived whole costs a thread of those that answer; the response is sent by
/// the one thread again. So connections that say nothing, send or read slowly cost a socket
/// each and keep nobody waiting. The HTTP library alone has a thread for every connection:
/// 100 of them that sent a byte now and then stopped it for 12 s.

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

namespace segsim::experiments::web::internal {

struct FrontDoorOptions {
  std::string host;
  int port = 0;  ///< 0: any that is free.
  int threads = 8;
  std::size_t largest_head = 16384, largest_body = 4096;  ///< [bytes]

  /// At most so many connections, of one address and of all. Who comes then is let in all the
  /// same: the connection that has waited longest goes, of those that have no whole request.
  int connections_of_one = 256, connections = 1024;
  std::size_t most_waiting = std::size_t{128} << 20U;  ///< [bytes] of responses, in all.

  double request_s = 5.0;    ///< From the first byte of a request, or accept(), to its last.
  double idle_s = 15.0;      ///< Between two requests of a connection.
  double response_s = 60.0;  ///< Without reading a byte of the response.
};

/// What is sent back.
struct WireResponse {
  std::string bytes;  ///< Head and body.
  bool closes = false;
};

class FrontDoor {
 public:
  /// Called by many threads at once. @param request  Bytes of one whole request.
  using Handler = std::function<WireResponse(const std::string& request)>;

  /// Takes the port.
  /// @throws core::InputError if the address or the port is not to be had.
  FrontDoor(const FrontDoorOptions& options, Handler handler);
  ~FrontDoor();
  FrontDoor(const FrontDoor&) = delete;
  FrontDoor& operator=(const FrontDoor&) = delete;

  [[nodiscard]] int port() const;
  /// Answers until stop() is called, once, from any thread.
  void serve();
  void stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::web::internal
