#pragma once

/// @file
/// The only file pair that knows the HTTP library: methods, tokens, headers, errors. What is
/// answered comes from a handler.

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace segsim::experiments::dashboard::internal {

struct HttpRequest {
  /// Of the decoded path, between its slashes; empty for "/". A part may hold any character
  /// ("..", "/"), so it may be compared with known names and nothing else.
  std::vector<std::string> parts;
  std::map<std::string, std::string> query;
};

struct HttpReply {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  bool keeps = false;  ///< Never changes while the server runs: a browser may keep it.
};

[[nodiscard]] HttpReply not_found(const std::string& what);

using HttpHandler = std::function<HttpReply(const HttpRequest&)>;

struct HttpOptions {
  std::string host;
  int port = 0;
  std::string token;
};

/// Equal in a time that does not depend on where they differ.
[[nodiscard]] bool equal_tokens(const std::string& a, const std::string& b);
/// "127.0.0.1", "::1", "localhost": reachable from this machine only.
[[nodiscard]] bool is_loopback(const std::string& host);

class HttpServer {
 public:
  /// @param handler  Called by many threads at once; what it throws becomes status 500.
  /// @throws core::InputError if the address is not to be had.
  HttpServer(const HttpOptions& options, HttpHandler handler);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  [[nodiscard]] int port() const;
  void serve();
  void stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::dashboard::internal
