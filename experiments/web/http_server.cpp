#include "experiments/web/http_server.h"

#include <httplib.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "core/error.h"
#include "core/file_io.h"
#include "core/system/system_random.h"
#include "experiments/web/internal/front_door.h"
#include "experiments/web/internal/request_bytes.h"

namespace segsim::experiments::web {
namespace {

using internal::WireResponse;

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
/// @return  What was given, or one that was made up.
std::string checked_token(const HttpOptions& options) {
  constexpr int kBytes = 16;  // 128 bits.
  if (options.token.empty()) {
    return is_loopback(options.host) ? std::string() : core::random_hex(kBytes);
  }
  const std::string& token = options.token;
  const bool plain =
      token.find_first_not_of(
          "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_.~") ==
      std::string::npos;
  const std::set<char> different(token.begin(), token.end());
  if (plain && token.size() >= kShortestToken && different.size() >= kFewestCharacters) {
    return token;
  }
  throw core::InputError::expected(
      "--token",
      "at least " + std::to_string(kShortestToken) + " letters, digits, - _ . ~, " +
          std::to_string(kFewestCharacters) + " of them different, or no --token, so that " +
          "one is made up for an address that other machines reach",
      std::to_string(token.size()) + " characters, " + std::to_string(different.size()) +
          " of them different" + (plain ? "" : ", some of no such kind"));
}

/// Of what is the same until another version of the program runs. Weak, as what is sent may
/// be compressed.
std::string entity_tag(const std::string& body) {
  return "W/\"" + core::sha256_hex(body).substr(0, 32) + "\"";
}

/// One request in memory for the HTTP library, and what it answers. How connections are read
/// and written is front_door.h's.
class MemoryStream : public httplib::Stream {
 public:
  explicit MemoryStream(const std::string& request) : request_(request) {}

  [[nodiscard]] bool is_readable() const override { return at_ < request_.size(); }
  [[nodiscard]] bool is_writable() const override { return true; }
  ssize_t read(char* to, std::size_t size) override {
    const std::size_t taken = request_.copy(to, size, at_);
    at_ += taken;
    return static_cast<ssize_t>(taken);
  }
  ssize_t write(const char* from, std::size_t size) override {
    response_.append(from, size);
    return static_cast<ssize_t>(size);
  }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}
  [[nodiscard]] socket_t socket() const override { return INVALID_SOCKET; }

  [[nodiscard]] std::string take_response() { return std::move(response_); }

 private:
  const std::string& request_;
  std::size_t at_ = 0;
  std::string response_;
};

/// The HTTP library as what reads the text of a request and writes that of a response.
class HttpText : public httplib::Server {
 public:
  HttpText(double idle_s,
           std::function<void(const httplib::Request&, httplib::Response&)> respond) {
    set_keep_alive_timeout(static_cast<time_t>(idle_s));  // Responses tell it.
    set_keep_alive_max_count(1000);
    set_pre_routing_handler([respond = std::move(respond)](const httplib::Request& request,
                                                           httplib::Response& response) {
      respond(request, response);
      return HandlerResponse::Handled;
    });
  }

  [[nodiscard]] WireResponse answer(std::string request) {
    // Parts of files are not served: asked for 1000 of them, the library sent the whole 1000
    // times.
    internal::drop_header(request, "Range");
    const std::string body = request.substr(request.find("\r\n\r\n") + 4);
    MemoryStream stream(request);
    bool closes = false;
    const bool done = process_request(stream, false, closes, [&](httplib::Request& parsed) {
      parsed.body = body;  // Handlers of all requests come before the library reads it.
    });
    return {stream.take_response(), closes || !done};
  }
};

}  // namespace

HttpReply json_reply(std::string body) {
  HttpReply reply;
  reply.body = std::move(body);
  return reply;
}

HttpReply binary_reply(const char* type, std::string body, bool keeps) {
  return {200, type, std::move(body), keeps};
}

HttpReply file_reply(const char* type, std::string body) {
  HttpReply reply = binary_reply(type, std::move(body), false);
  reply.is_file = true;
  return reply;
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
  HttpText text;
  internal::FrontDoor door;
  int port = 0;

  static internal::FrontDoorOptions door_of(const HttpOptions& options) {
    internal::FrontDoorOptions door;
    door.host = options.host;
    door.port = options.port;
    return door;
  }

  Impl(const HttpOptions& wanted, HttpHandler of)
      : options(wanted),
        handler(std::move(of)),
        text(internal::FrontDoorOptions().idle_s,
             [this](const httplib::Request& request, httplib::Response& response) {
               respond(request, response);
             }),
        door(door_of(wanted),
             [this](const std::string& request) { return text.answer(request); }) {
    options.token = checked_token(wanted);
    port = door.port();
  }

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
    HttpReply reply = answer(request);
    response.status = reply.status;
    response.set_header("Content-Security-Policy", kContentPolicy);
    response.set_header("X-Content-Type-Options", "nosniff");
    response.set_header("X-Frame-Options", "DENY");
    response.set_header("Referrer-Policy", "no-referrer");
    response.set_header("Cross-Origin-Resource-Policy", "same-origin");
    response.set_header("Cache-Control", reply.keeps     ? "private, max-age=3600"
                                         : reply.is_file ? "private, no-cache"
                                                         : "no-store");
    if (reply.status == 405) response.set_header("Allow", methods());
    if (reply.status == 200 && request.has_param("token") && !options.token.empty()) {
      response.set_header("Set-Cookie", cookie_name() + "=" + options.token +
                                            "; Path=/; HttpOnly; SameSite=Strict");
    }
    if (reply.status == 200 && reply.is_file) {
      const std::string tag = entity_tag(reply.body);
      response.set_header("ETag", tag);
      if (request.get_header_value("If-None-Match") == tag) {
        response.status = 304;
        return;
      }
    }
    // set_content() would copy it.
    response.set_header("Content-Type", reply.type);
    response.body = std::move(reply.body);
  }
};

HttpServer::HttpServer(const HttpOptions& options, HttpHandler handler)
    : impl_(std::make_unique<Impl>(options, std::move(handler))) {}

HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->port; }
std::string HttpServer::address() const {
  const HttpOptions& of = impl_->options;
  const bool six = of.host.find(':') != std::string::npos;
  return "http://" + (six ? "[" + of.host + "]" : of.host) + ":" + std::to_string(port()) +
         "/" + (of.token.empty() ? "" : kTokenInAddress + of.token);
}
void HttpServer::serve() { impl_->door.serve(); }
void HttpServer::stop() { impl_->door.stop(); }

}  // namespace segsim::experiments::web
