// Attacks on a real server: others are answered meanwhile.
#include "experiments/web/http_server.h"

#include <sys/resource.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <gmock/gmock.h>

#include "tests/experiments/raw_http.h"

namespace segsim::experiments::web {
namespace {

using testing::HasSubstr;
using testing::Not;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kLarge_bytes = 5'000'000;  ///< No socket keeps as much for later.
constexpr double kPatience_s = 1.0;              ///< Within which others are answered.

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Memory of this process.
double resident_mb() {
  std::ifstream statm("/proc/self/statm");
  double pages = 0.0, resident = 0.0;
  statm >> pages >> resident;
  return 1e-6 * resident * static_cast<double>(::sysconf(_SC_PAGESIZE));
}

/// Of pages of a few words, and one large file.
class Served {
 public:
  explicit Served(const HttpOptions& options = on_any_port())
      : server_(options,
                [](const HttpRequest& request) {
                  if (request.posts) return json_reply(request.body);
                  if (!request.parts.empty() && request.parts[0] == "large") {
                    return binary_reply("application/octet-stream",
                                        std::string(kLarge_bytes, 'x'), true);
                  }
                  if (!request.parts.empty() && request.parts[0] == "page") {
                    return file_reply("text/html", "a page");
                  }
                  return json_reply("{}");
                }),
        thread_([this] { server_.serve(); }) {}
  ~Served() {
    server_.stop();
    thread_.join();
  }
  Served(const Served&) = delete;
  Served& operator=(const Served&) = delete;

  [[nodiscard]] int port() const { return server_.port(); }
  [[nodiscard]] std::string address() const { return server_.address(); }
  [[nodiscard]] Answer get(const std::string& path, const std::string& headers = {}) const {
    return send_raw(port(), request_head("GET", path, headers));
  }
  static HttpOptions on_any_port() {
    HttpOptions options;
    options.port = 0;
    options.takes_posts = true;
    return options;
  }

 private:
  HttpServer server_;
  std::thread thread_;
};

/// A connection that is held.
class Held {
 public:
  explicit Held(int port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const int small = 4096;  // What is not read stays with the server.
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ =
        ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }
  Held(Held&& other) noexcept
      : socket_(std::exchange(other.socket_, -1)), connected_(other.connected_) {}
  ~Held() {
    if (socket_ >= 0) ::close(socket_);
  }
  [[nodiscard]] bool connected() const { return connected_; }
  bool send(const std::string& bytes) const {
    return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
           static_cast<ssize_t>(bytes.size());
  }
  /// Up to the end of a head whose body has no bytes.
  [[nodiscard]] std::string receive_until(const std::string& end) const {
    std::string text;
    char byte = 0;
    while (text.find(end) == std::string::npos && ::recv(socket_, &byte, 1, 0) == 1) {
      text += byte;
    }
    return text;
  }
  /// The other side has closed.
  [[nodiscard]] bool is_closed() const {
    char byte = 0;
    const ssize_t size = ::recv(socket_, &byte, 1, MSG_DONTWAIT);
    return size == 0 || (size < 0 && errno == ECONNRESET);
  }

 private:
  int socket_;
  bool connected_ = false;
};

/// The longest that a visitor waits, of so many.
double longest_wait_s(const Served& served, int visitors = 10) {
  double longest = 0.0;
  for (int k = 0; k < visitors; ++k) {
    const Clock::time_point start = Clock::now();
    EXPECT_EQ(served.get("/").status, 200);
    longest = std::max(longest, seconds_since(start));
  }
  std::printf("longest wait %.3f s\n", longest);
  return longest;
}

/// As many connections as there may be, up to `count`.
std::vector<Held> connect(int port, int count) {
  rlimit limit{};
  ::getrlimit(RLIMIT_NOFILE, &limit);
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
  const int most =
      static_cast<int>(std::min<rlim_t>(static_cast<rlim_t>(count), limit.rlim_cur / 2));
  std::vector<Held> held;
  for (int k = 0; k < most; ++k) {
    held.emplace_back(port);
    if (!held.back().connected()) break;
  }
  return held;
}

TEST(HttpServer, ConnectionsThatTrickleKeepNobodyWaiting) {
  const Served served;
  const std::vector<Held> slow = connect(served.port(), 100);
  for (const Held& one : slow) EXPECT_TRUE(one.send("GET / HTTP/1.1\r\nX: "));
  std::atomic<bool> ends{false};
  std::thread trickle([&] {
    while (!ends) {
      for (const Held& one : slow) (void)one.send("x");
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
  });
  EXPECT_LT(longest_wait_s(served), kPatience_s);
  // And they end, however often they send.
  const Clock::time_point start = Clock::now();
  const auto closed = [](const Held& one) { return one.is_closed(); };
  while (!std::all_of(slow.begin(), slow.end(), closed) && seconds_since(start) < 20.0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  EXPECT_LT(seconds_since(start), 7.0);
  ends = true;
  trickle.join();
}

TEST(HttpServer, IdleConnectionsKeepNobodyWaiting) {
  const Served served;
  const std::vector<Held> idle = connect(served.port(), 10'000);
  std::printf("%zu connections\n", idle.size());
  EXPECT_LT(longest_wait_s(served), kPatience_s);
}

TEST(HttpServer, WhoDoesNotReadKeepsNobodyWaiting) {
  const Served served;
  const std::vector<Held> silent = connect(served.port(), 30);
  const double before_mb = resident_mb();
  for (const Held& one : silent) one.send("GET /large HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_LT(longest_wait_s(served), kPatience_s);
  EXPECT_LT(resident_mb() - before_mb, 600.0);
}

TEST(HttpServer, ManyRangesAreOneFile) {
  const Served served;
  std::string ranges = "Range: bytes=0-";
  for (int k = 1; k < 1000; ++k) ranges += ",0-";
  const double before_mb = resident_mb();
  const Answer answer = served.get("/large", ranges + "\r\n");
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(answer.body.size(), kLarge_bytes);
  EXPECT_LT(resident_mb() - before_mb, 200.0);
}

TEST(HttpServer, EndlessRequestsAreCutShort) {
  const Served served;
  const auto status_of = [&](const std::string& bytes) {
    return send_raw(served.port(), bytes).status;
  };
  EXPECT_EQ(status_of("GET / HTTP/1.1\r\nX: " + std::string(20'000, 'x')), 431);
  const std::string post =
      "POST / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n"
      "Content-Type: application/json\r\n";
  EXPECT_EQ(status_of(post + "Content-Length: 2\r\n\r\n{}"), 200);
  EXPECT_EQ(status_of(post + "Content-Length: 5000\r\n\r\n"), 413);
  EXPECT_EQ(status_of(post + "Content-Length: 99999999999999999999\r\n\r\n"), 400);
  EXPECT_EQ(status_of(post + "Content-Length: -1\r\n\r\n"), 400);
  EXPECT_EQ(status_of(post + "Content-Length: 2\r\nContent-length: 3\r\n\r\n{}"), 400);
  EXPECT_EQ(status_of(post + "Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n"), 400);
  EXPECT_LT(longest_wait_s(served), kPatience_s);
}

/// What comes in pieces, or two at once, is the same request.
TEST(HttpServer, RequestsAreFoundInTheBytes) {
  const Served served;
  const Held one(served.port());
  const std::string get = "GET /page HTTP/1.1\r\nHost: localhost\r\n\r\n";
  for (const char byte : get) EXPECT_TRUE(one.send(std::string(1, byte)));
  EXPECT_THAT(one.receive_until("a page"), HasSubstr("200 OK"));
  EXPECT_TRUE(one.send(get + get));
  EXPECT_THAT(one.receive_until("a page"), HasSubstr("200 OK"));
  EXPECT_THAT(one.receive_until("a page"), HasSubstr("200 OK"));
}

/// 44 ms each, while the last piece of a response waited for the other side.
TEST(HttpServer, RequestsOfOneConnectionFollowAtOnce) {
  const Served served;
  const Held one(served.port());
  constexpr int kRequests = 50;
  const Clock::time_point start = Clock::now();
  for (int k = 0; k < kRequests; ++k) {
    EXPECT_TRUE(one.send("GET /page HTTP/1.1\r\nHost: localhost\r\n\r\n"));
    EXPECT_THAT(one.receive_until("a page"), HasSubstr("200 OK"));
  }
  const double each_ms = 1e3 * seconds_since(start) / kRequests;
  std::printf("%.2f ms a request\n", each_ms);
  EXPECT_LT(each_ms, 20.0);
}

TEST(HttpServer, FilesThatABrowserHasAreNotSentAgain) {
  const Served served;
  const Answer first = served.get("/page");
  const std::size_t at = first.head.find("ETag: ") + 6;
  const std::string tag = first.head.substr(at, first.head.find('\r', at) - at);
  const Answer again = served.get("/page", "If-None-Match: " + tag + "\r\n");
  EXPECT_EQ(again.status, 304);
  EXPECT_EQ(again.body, "");
  EXPECT_EQ(served.get("/page", "If-None-Match: \"other\"\r\n").status, 200);
  EXPECT_THAT(served.get("/").head, Not(HasSubstr("ETag")));  // It may change.
}

TEST(HttpServer, TokensThatAreMadeUpDiffer) {
  HttpOptions open = Served::on_any_port();
  open.host = "0.0.0.0";
  const Served one(open), other(open);
  const auto token = [](const Served& served) {
    const std::string address = served.address();
    return address.substr(address.find(kTokenInAddress) + 7);
  };
  EXPECT_EQ(token(one).size(), 32U);  // 128 bits.
  EXPECT_NE(token(one), token(other));
  EXPECT_EQ(one.get("/").status, 401);
  EXPECT_EQ(one.get("/?token=" + token(other)).status, 401);
  EXPECT_EQ(one.get("/?token=" + token(one)).status, 200);
}

}  // namespace
}  // namespace segsim::experiments::web
