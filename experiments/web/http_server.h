#pragma once

/// @file
/// The only file pair that knows the HTTP library: methods, tokens, headers, errors. What is
/// answered comes from a handler; internal/front_door.h has the connections.
///
/// A visitor on another address than a loopback one needs the token. On a loopback address
/// only requests for a loopback host are answered, so that a page elsewhere cannot reach in
/// through a host name of its own. What changes something (POST) must come from one of the
/// server's own pages, or from no page at all, and be JSON.

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace segsim::experiments::web {

struct HttpRequest {
  bool posts = false;  ///< POST; else GET or HEAD.
  /// Of the decoded path, between its slashes; empty for "/". A part may hold any character
  /// ("..", "/"), so it may be compared with known names and nothing else.
  std::vector<std::string> parts;
  std::map<std::string, std::string> query;
  std::string body;  ///< Of a POST: JSON, unless the sender lies.
};

struct HttpReply {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  bool keeps = false;  ///< Never changes while the server runs: a browser may keep it.
  /// Of the program itself: a browser asks each time whether it is still the same.
  bool is_file = false;
};

/// @param body  What is not UTF-8 in it has been replaced already.
[[nodiscard]] HttpReply json_reply(std::string body);
[[nodiscard]] HttpReply binary_reply(const char* type, std::string body, bool keeps);
[[nodiscard]] HttpReply file_reply(const char* type, std::string body);
[[nodiscard]] HttpReply not_found(const std::string& what);
/// {"error": why}
[[nodiscard]] HttpReply refusal(int status, const std::string& why);

using HttpHandler = std::function<HttpReply(const HttpRequest&)>;

struct HttpOptions {
  std::string host = "127.0.0.1";
  int port = 8080;           ///< 0: any that is free.
  std::string token;         ///< Empty: none is asked for on a loopback address, else made up.
  bool takes_posts = false;  ///< Else GET and HEAD are all that is answered.
};

/// A token is all that protects an open port: it holds the 128 bits of one that is made up, if
/// it was drawn from letters and digits, and is no repeated word.
inline constexpr std::size_t kShortestToken = 22, kFewestCharacters = 8;
/// Before the token in address().
inline constexpr const char* kTokenInAddress = "?token=";

/// Equal in a time that does not depend on where they differ.
[[nodiscard]] bool equal_tokens(const std::string& a, const std::string& b);
/// "127.0.0.1", "::1", "localhost": reachable from this machine only.
[[nodiscard]] bool is_loopback(const std::string& host);

class HttpServer {
 public:
  /// Takes the port.
  /// @param handler  Called by many threads at once. A core::InputError that it throws becomes
  ///     status 404, or 400 for a POST; other exceptions 500.
  /// @throws core::InputError if the address is not to be had, or the token is weak.
  HttpServer(const HttpOptions& options, HttpHandler handler);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  [[nodiscard]] int port() const;
  /// "http://127.0.0.1:8080/", with the token if there is one.
  [[nodiscard]] std::string address() const;
  /// Answers until stop() is called from another thread.
  void serve();
  void stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::experiments::web
