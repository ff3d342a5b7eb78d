// The whole server, over a connection of its own for each input
// (experiments/web/http_server.h).
#include "experiments/web/http_server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <thread>

#include "core/error.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

using namespace experiments;

class Served {
 public:
  Served() : server_(options(), &answer), thread_([this] { server_.serve(); }) {}
  ~Served() {
    server_.stop();
    thread_.join();
  }
  [[nodiscard]] int port() const { return server_.port(); }

 private:
  static web::HttpOptions options() {
    web::HttpOptions options;
    options.port = 0;
    options.takes_posts = true;
    return options;
  }
  static web::HttpReply answer(const web::HttpRequest& request) {
    if (request.parts.empty()) throw core::InputError("nothing is asked for");
    return web::json_reply(request.parts.front() + request.body);
  }

  web::HttpServer server_;
  std::thread thread_;
};

/// The connection ends with a reset, so that none is left waiting for its time to be over.
std::string exchange(int port, const std::string& bytes) {
  const int connection = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const linger reset{1, 0};
  ::setsockopt(connection, SOL_SOCKET, SO_LINGER, &reset, sizeof reset);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string answer;
  if (::connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) ==
      0) {
    (void)::send(connection, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    ::shutdown(connection, SHUT_WR);
    char buffer[4096];
    for (ssize_t size = 1; size > 0;) {
      size = ::recv(connection, buffer, sizeof buffer, 0);
      if (size > 0) answer.append(buffer, static_cast<std::size_t>(size));
    }
  }
  ::close(connection);
  return answer;
}

}  // namespace

void parse(const std::string& bytes) {
  static const Served served;
  const std::string answer = exchange(served.port(), bytes);
  if (!answer.empty() && !answer.starts_with("HTTP/1.1 ")) std::abort();
  if (!answer.starts_with("HTTP/1.1 200")) throw core::InputError(answer.substr(0, 40));
}

std::vector<std::string> seeds() {
  const std::string post =
      "Content-Type: application/json\r\nContent-Length: 2\r\nOrigin: http://localhost\r\n";
  return {"GET /a/b%20c?d=e HTTP/1.1\r\nHost: localhost\r\nCookie: token=x\r\n\r\n",
          "POST /a HTTP/1.1\r\nHost: localhost\r\n" + post + "\r\n{}",
          "HEAD /a HTTP/1.1\r\nHost: 127.0.0.1:80\r\nIf-None-Match: \"x\"\r\n\r\n"};
}

}  // namespace segsim::fuzz
