#include "experiments/web/http_server.h"

#include <httplib.h>
#include <sys/socket.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/error.h"

namespace segsim::experiments::web {
namespace {

/// An idle connection of a browser keeps its thread for a moment, and a browser has six.
constexpr std::size_t kThreads = 24;
constexpr std::size_t kLargestRequest = 4096;  // Bytes of a body.

/// Scripts, styles and pictures from here and nowhere else; no frames around the pages.
constexpr const char* kContentPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

std::vector<std::string> split(const std::string& path) {
  std::vector<std::string> parts;
  std::size_t begin = 0;
  while (begin < path.size()) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    if (end > begin) parts.push_back(path.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

std::string without_port(const std::string& host) {
  const std::size_t colon = host.rfind(':');
  const bool bare = colon == std::string::npos || host.find(']', colon) != std::string::npos;
  const std::string name = bare ? host : host.substr(0, colon);
  const bool bracketed = name.size() > 2 && name.front() == '[' && name.back() == ']';
  return bracketed ? name.substr(1, name.size() - 2) : name;
}

/// Value of one cookie; empty without it.
std::string cookie(const httplib::Request& request, const std::string& name) {
  const std::string all = request.get_header_value("Cookie");
  std::size_t begin = 0;
  while (begin < all.size()) {
    const std::size_t end = std::min(all.find(';', begin), all.size());
    const std::size_t from = all.find_first_not_of(' ', begin);
    const std::string pair = from < end ? all.substr(from, end - from) : std::string();
    if (pair.starts_with(name + "=")) return pair.substr(name.size() + 1);
    begin = end + 1;
  }
  return {};
}

/// An address that others can reach needs a token that they cannot guess.
void check_token(const HttpOptions& options) {
  const bool exposed = !is_loopback(options.host);
  if (!exposed && options.token.empty()) return;
  const bool plain =
      options.token.find_first_not_of(
          "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_.~") ==
      std::string::npos;
  if (plain && options.token.size() >= kShortestToken) return;
  throw core::InputError::expected(
      "--token",
      "at least " + std::to_string(kShortestToken) + " letters, digits, - _ . ~" +
          (exposed ? " (" + options.host + " can be reached from other machines)" : ""),
      options.token.empty() ? "none"
                            : std::to_string(options.token.size()) + " characters" +
                                  (plain ? "" : ", some of them others"));
}

}  // namespace

HttpReply json_reply(std::string body) {
  HttpReply reply;
  reply.body = std::move(body);
  return reply;
}

HttpReply binary_reply(const char* type, std::string body, bool keeps) {
  return {200, type, std::move(body), keeps};
}

HttpReply refusal(int status, const std::string& why) {
  HttpReply reply;
  reply.status = status;
  reply.body = nlohmann::json{{"error", why}}.dump(-1, ' ', false,
                                                   nlohmann::json::error_handler_t::replace);
  return reply;
}

HttpReply not_found(const std::string& what) { return refusal(404, what); }

bool equal_tokens(const std::string& a, const std::string& b) {
  // The length is no secret; the bytes are.
  unsigned difference = a.size() == b.size() ? 0U : 1U;
  for (std::size_t k = 0; k < a.size(); ++k) {
    const char other = b.empty() ? '\0' : b[k % b.size()];
    difference |= static_cast<unsigned>(static_cast<unsigned char>(a[k])) ^
                  static_cast<unsigned>(static_cast<unsigned char>(other));
  }
  return difference == 0U;
}

bool is_loopback(const std::string& host) {
  if (host == "localhost" || host == "::1") return true;
  in_addr address{};
  return inet_pton(AF_INET, host.c_str(), &address) == 1 &&
         (ntohl(address.s_addr) >> 24U) == 127U;
}

struct HttpServer::Impl {
  HttpOptions options;
  HttpHandler handler;
  httplib::Server server;
  int port = 0;

  [[nodiscard]] std::string cookie_name() const { return "segsim_" + std::to_string(port); }

  /// From the address, a header, or the cookie that the first visit left.
  [[nodiscard]] bool may_enter(const httplib::Request& request) const {
    if (options.token.empty()) return true;
    const std::string bearer = request.get_header_value("Authorization");
    return equal_tokens(request.get_param_value("token"), options.token) ||
           equal_tokens(bearer, "Bearer " + options.token) ||
           equal_tokens(cookie(request, cookie_name()), options.token);
  }

  /// A page elsewhere may point a name of its own at this address; its name is in the request.
  [[nodiscard]] bool meant_for_us(const httplib::Request& request) const {
    if (!options.token.empty()) return true;
    return is_loopback(without_port(request.get_header_value("Host")));
  }

  /// A browser names the page that posts; one from elsewhere could reach a loopback address
  /// by its number. And it asks first before it sends another page's JSON, which is refused.
  [[nodiscard]] static bool comes_from_elsewhere(const httplib::Request& request) {
    const std::string origin = request.get_header_value("Origin");
    const std::string site = request.get_header_value("Sec-Fetch-Site");
    return (!origin.empty() && origin != "http://" + request.get_header_value("Host")) ||
           (!site.empty() && site != "same-origin");
  }

  [[nodiscard]] const char* methods() const {
    return options.takes_posts ? "GET, HEAD, POST" : "GET, HEAD";
  }

  [[nodiscard]] HttpReply answer(const httplib::Request& request) const {
    const bool posts = options.takes_posts && request.method == "POST";
    if (!posts && request.method != "GET" && request.method != "HEAD") {
      return refusal(405, std::string("expected ") +
                              (options.takes_posts ? "GET, HEAD or POST" : "GET or HEAD") +
                              ", found " + request.method);
    }
    if (!meant_for_us(request)) {
      return refusal(403, "expected an address of this machine as host, found another");
    }
    if (!may_enter(request)) {
      return refusal(401, "expected the token that the server was started with, found " +
                              std::string(request.has_param("token") ? "another" : "none"));
    }
    if (posts && comes_from_elsewhere(request)) {
      return refusal(403, "expected a page of this server as origin, found another");
    }
    if (posts && !request.get_header_value("Content-Type").starts_with("application/json")) {
      return refusal(415, "expected application/json");
    }
    HttpRequest wanted;
    wanted.posts = posts;
    wanted.body = request.body;
    wanted.parts = split(request.path);
    for (const auto& [key, value] : request.params) wanted.query.emplace(key, value);
    try {
      return handler(wanted);
    } catch (const core::InputError& error) {
      return refusal(posts ? 400 : 404, error.what());
    } catch (const std::exception& error) {
      return refusal(500, error.what());
    }
  }

  void respond(const httplib::Request& request, httplib::Response& response) const {
    const HttpReply reply = answer(request);
    response.status = reply.status;
    response.set_header("Content-Security-Policy", kContentPolicy);
    response.set_header("X-Content-Type-Options", "nosniff");
    response.set_header("X-Frame-Options", "DENY");
    response.set_header("Referrer-Policy", "no-referrer");
    response.set_header("Cross-Origin-Resource-Policy", "same-origin");
    response.set_header("Cache-Control", reply.keeps ? "private, max-age=3600" : "no-store");
    if (reply.status == 405) response.set_header("Allow", methods());
    if (reply.status == 200 && request.has_param("token") && !options.token.empty()) {
      response.set_header("Set-Cookie", cookie_name() + "=" + options.token +
                                            "; Path=/; HttpOnly; SameSite=Strict");
    }
    response.set_content(reply.body, reply.type);
  }
};

HttpServer::HttpServer(const HttpOptions& options, HttpHandler handler)
    : impl_(std::make_unique<Impl>()) {
  check_token(options);
  impl_->options = options;
  impl_->handler = std::move(handler);
  httplib::Server& server = impl_->server;
  server.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  server.set_keep_alive_timeout(2);
  server.set_read_timeout(2);
  server.set_keep_alive_max_count(1000);
  server.set_payload_max_length(kLargestRequest);
  // The library's default would let two programs share the port.
  server.set_socket_options([](socket_t socket) {
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  server.set_pre_routing_handler(
      [impl = impl_.get()](const httplib::Request& request, httplib::Response& response) {
        // The body of a POST has not been read yet.
        if (impl->options.takes_posts && request.method == "POST") {
          return httplib::Server::HandlerResponse::Unhandled;
        }
        impl->respond(request, response);
        return httplib::Server::HandlerResponse::Handled;
      });
  server.Post(".*", [impl = impl_.get()](const httplib::Request& request,
                                         httplib::Response& response) {
    impl->respond(request, response);
  });
  if (options.port == 0) {
    impl_->port = server.bind_to_any_port(options.host);
  } else if (server.bind_to_port(options.host, options.port)) {
    impl_->port = options.port;
  }
  if (impl_->port <= 0) {
    throw core::InputError::expected(
        options.host + ":" + std::to_string(options.port),
        "an address of this machine and a port that is free (--host, --port)", "none such");
  }
}

HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->port; }
std::string HttpServer::address() const {
  const HttpOptions& of = impl_->options;
  const bool six = of.host.find(':') != std::string::npos;
  return "http://" + (six ? "[" + of.host + "]" : of.host) + ":" + std::to_string(port()) +
         "/" + (of.token.empty() ? "" : "?token=" + of.token);
}
void HttpServer::serve() { impl_->server.listen_after_bind(); }
void HttpServer::stop() { impl_->server.stop(); }

}  // namespace segsim::experiments::web
