#include "experiments/web/internal/front_door.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstring>
#include <deque>
#include <list>
#include <map>
#include <mutex>
#include <optional>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/check.h"
#include "core/error.h"
#include "experiments/web/internal/request_bytes.h"

namespace segsim::experiments::web::internal {
namespace {

using Clock = std::chrono::steady_clock;

/// Closed when it goes.
class Descriptor {
 public:
  explicit Descriptor(int value = -1) : value_(value) {}
  Descriptor(Descriptor&& other) noexcept : value_(std::exchange(other.value_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(value_, other.value_);
    return *this;
  }
  ~Descriptor() {
    if (value_ >= 0) ::close(value_);
  }
  [[nodiscard]] int get() const { return value_; }

 private:
  int value_;
};

/// Who a connection comes from: of IPv6 the network, as every machine has 2^64 addresses.
std::string origin_of(const sockaddr_storage& peer) {
  const auto text = [](const void* bytes, std::size_t size) {
    return std::string(static_cast<const char*>(bytes), size);
  };
  if (peer.ss_family == AF_INET) {
    const auto& four = reinterpret_cast<const sockaddr_in&>(peer);
    return text(&four.sin_addr, sizeof four.sin_addr);
  }
  const auto& six = reinterpret_cast<const sockaddr_in6&>(peer);
  return text(&six.sin6_addr, IN6_IS_ADDR_V4MAPPED(&six.sin6_addr) ? 16 : 8);
}

/// A listening socket; -1 if none is to be had.
Descriptor listen_on(const std::string& host, int port) {
  addrinfo wanted{};
  wanted.ai_family = AF_UNSPEC;
  wanted.ai_socktype = SOCK_STREAM;
  wanted.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &wanted, &found) != 0) {
    return Descriptor();
  }
  Descriptor listening;
  for (const addrinfo* at = found; at != nullptr && listening.get() < 0; at = at->ai_next) {
    Descriptor candidate(
        ::socket(at->ai_family, at->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    if (candidate.get() < 0) continue;
    // Not SO_REUSEPORT: it would let two programs share the port.
    const int yes = 1;
    ::setsockopt(candidate.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (::bind(candidate.get(), at->ai_addr, at->ai_addrlen) == 0 &&
        ::listen(candidate.get(), SOMAXCONN) == 0) {
      listening = std::move(candidate);
    }
  }
  ::freeaddrinfo(found);
  return listening;
}

int port_of(int listening) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  if (::getsockname(listening, reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  return ntohs(address.ss_family == AF_INET
                   ? reinterpret_cast<const sockaddr_in&>(address).sin_port
                   : reinterpret_cast<const sockaddr_in6&>(address).sin6_port);
}

/// Half of what the process may open, so that files can be opened as well.
int affordable_connections(int wanted) {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY)
    return wanted;
  const auto half = static_cast<std::int64_t>(
      std::min<rlim_t>(limit.rlim_cur / 2, static_cast<rlim_t>(wanted)));
  return static_cast<int>(std::max<std::int64_t>(half, 8));
}

std::string refusal_bytes(const char* status) {
  return std::string("HTTP/1.1 ") + status +
         "\r\nConnection: close\r\nContent-Length: 0\r\n\r\n";
}

struct Connection {
  enum class State { kReading, kAnswering, kWriting };
  Descriptor socket;
  std::string origin;
  std::string in, out;
  std::size_t sent = 0;
  State state = State::kReading;
  bool closes = false;       ///< Once `out` is sent.
  bool has_asked = false;    ///< It is not its first request.
  Clock::time_point due{};   ///< It ends then; not of kAnswering.
  std::uint32_t events = 0;  ///< Which epoll waits for.
};

}  // namespace

/// All but `answers` and `requests` belong to the thread in serve().
struct FrontDoor::Impl {
  using Key = std::uint64_t;
  static constexpr Key kListening = 0, kWake = 1, kFirst = 2;

  FrontDoorOptions options;
  Handler handler;
  Descriptor listening, epoll, wake;
  int limit = 0;
  std::atomic<bool> stopping{false};

  /// By age, as keys count up: who came first is the first.
  std::map<Key, Connection> connections;
  std::unordered_map<std::string, int> of_origin;
  Key next_key = kFirst;

  struct Piece {
    Key key;
    std::string request;
  };
  struct Answered {
    Key key;
    WireResponse response;
  };
  std::mutex mutex;  ///< Guards what follows.
  std::condition_variable arrived;
  std::deque<Piece> requests;
  std::vector<Answered> answers;
  bool closed = false;

  [[nodiscard]] bool watch(int descriptor, Key key, std::uint32_t events,
                           int operation = EPOLL_CTL_ADD) const {
    epoll_event event{};
    event.events = events;
    event.data.u64 = key;
    return ::epoll_ctl(epoll.get(), operation, descriptor, &event) == 0;
  }
  void want(Key key, Connection& connection, std::uint32_t events) const {
    if (connection.events == events) return;
    SEGSIM_CHECK(watch(connection.socket.get(), key, events, EPOLL_CTL_MOD), "epoll_ctl");
    connection.events = events;
  }
  void wake_up() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t written = ::write(wake.get(), &one, sizeof one);
  }
  [[nodiscard]] static Clock::time_point in(double seconds) {
    return Clock::now() +
           std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }

  void drop(Key key) {
    const auto found = connections.find(key);
    const auto of = of_origin.find(found->second.origin);
    if (--of->second == 0) of_origin.erase(of);
    connections.erase(found);  // Closing the socket takes it out of epoll.
  }

  /// The one that has waited longest without a whole request; else the slowest reader.
  /// @param origin  Of which address; nullptr: of any.
  [[nodiscard]] std::optional<Key> least_useful(const std::string* origin) const {
    std::optional<Key> reader;
    for (const auto& [key, connection] : connections) {
      if (origin != nullptr && connection.origin != *origin) continue;
      if (connection.state == Connection::State::kReading) return key;
      if (connection.state == Connection::State::kWriting && !reader) reader = key;
    }
    return reader;
  }

  /// @return  False if all places are taken by requests that are being answered.
  bool make_room(const std::string& origin) {
    const auto of = of_origin.find(origin);
    if (of != of_origin.end() && of->second >= options.connections_of_one) {
      const auto victim = least_useful(&origin);
      if (!victim) return false;
      drop(*victim);
    }
    if (static_cast<int>(connections.size()) >= limit) {
      const auto most =
          std::max_element(of_origin.begin(), of_origin.end(),
                           [](const auto& a, const auto& b) { return a.second < b.second; });
      auto victim = least_useful(&most->first);
      if (!victim) victim = least_useful(nullptr);
      if (!victim) return false;
      drop(*victim);
    }
    return true;
  }

  void accept_all() {
    // So many at a time: those that are in have to be served as well.
    constexpr int kAtOnce = 64;
    for (int k = 0; k < kAtOnce; ++k) {
      sockaddr_storage peer{};
      socklen_t size = sizeof peer;
      Descriptor socket(::accept4(listening.get(), reinterpret_cast<sockaddr*>(&peer), &size,
                                  SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (socket.get() < 0) {
        const bool none_left = errno == EMFILE || errno == ENFILE || errno == ENOMEM;
        const auto victim = none_left ? least_useful(nullptr) : std::nullopt;
        if (!victim) return;
        drop(*victim);
        continue;
      }
      std::string origin = origin_of(peer);
      if (!make_room(origin)) continue;
      // A response is written at once; waiting for more to send with it only delays it (by
      // 40 ms where the other side delays what it acknowledges).
      const int yes = 1;
      ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
      ++of_origin[origin];
      const Key key = next_key++;
      Connection& connection = connections[key];
      connection.socket = std::move(socket);
      connection.origin = std::move(origin);
      connection.due = in(options.request_s);
      connection.events = EPOLLIN;
      if (watch(connection.socket.get(), key, EPOLLIN)) {
        read_from(key);  // Most send at once: before others push it out.
      } else {
        drop(key);
      }
    }
  }

  void read_from(Key key) {
    Connection& connection = connections.at(key);
    std::array<char, 16384> buffer;
    const ssize_t size = ::recv(connection.socket.get(), buffer.data(), buffer.size(), 0);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (size <= 0) return drop(key);
    if (connection.has_asked && connection.in.empty()) connection.due = in(options.request_s);
    connection.in.append(buffer.data(), static_cast<std::size_t>(size));
    take_request(key, connection);
  }

  /// Hands the next request to the threads, if it is whole.
  void take_request(Key key, Connection& connection) {
    using State = RequestEnd::State;
    const RequestEnd end =
        request_end(connection.in, options.largest_head, options.largest_body);
    switch (end.state) {
      case State::kPartial:
        return;
      case State::kHeadTooLarge:
        return send(key, connection,
                    {refusal_bytes("431 Request Header Fields Too Large"), true});
      case State::kBodyTooLarge:
        return send(key, connection, {refusal_bytes("413 Payload Too Large"), true});
      case State::kMalformed:
        return send(key, connection, {refusal_bytes("400 Bad Request"), true});
      case State::kWhole:
        break;
    }
    connection.state = Connection::State::kAnswering;
    connection.has_asked = true;
    want(key, connection, 0);  // Nothing more is read until it is answered.
    Piece piece{key, connection.in.substr(0, end.size)};
    connection.in.erase(0, end.size);
    const std::lock_guard<std::mutex> lock(mutex);
    requests.push_back(std::move(piece));
    arrived.notify_one();
  }

  void send(Key key, Connection& connection, WireResponse response) {
    connection.state = Connection::State::kWriting;
    connection.out = std::move(response.bytes);
    connection.sent = 0;
    connection.closes = response.closes;
    connection.due = in(options.response_s);
    limit_waiting(key);
    write_to(key, connection);
  }

  /// Responses that nobody reads must not fill the memory: that of the slowest reader goes.
  void limit_waiting(Key newest) {
    std::size_t waiting = 0;
    for (const auto& [key, connection] : connections) waiting += connection.out.size();
    for (auto at = connections.begin();
         at != connections.end() && waiting > options.most_waiting;) {
      const Key key = at->first;
      const std::size_t size = at->second.out.size();
      ++at;
      if (size == 0 || key == newest) continue;
      waiting -= size;
      drop(key);
    }
  }

  void write_to(Key key, Connection& connection) {
    while (connection.sent < connection.out.size()) {
      const ssize_t size =
          ::send(connection.socket.get(), connection.out.data() + connection.sent,
                 connection.out.size() - connection.sent, MSG_NOSIGNAL);
      if (size < 0 && errno == EINTR) continue;
      if (size < 0 && errno == EAGAIN) return want(key, connection, EPOLLOUT);
      if (size <= 0) return drop(key);
      connection.sent += static_cast<std::size_t>(size);
      connection.due = in(options.response_s);
    }
    connection.out = {};
    if (connection.closes) return finish(key, connection);
    connection.state = Connection::State::kReading;
    connection.due = in(connection.in.empty() ? options.idle_s : options.request_s);
    want(key, connection, EPOLLIN);
    if (!connection.in.empty()) take_request(key, connection);
  }

  /// Closing with bytes unread would take back what was sent.
  void finish(Key key, Connection& connection) {
    ::shutdown(connection.socket.get(), SHUT_WR);
    std::array<char, 16384> buffer;
    for (int k = 0; k < 64; ++k) {
      if (::recv(connection.socket.get(), buffer.data(), buffer.size(), 0) <= 0) break;
    }
    drop(key);
  }

  void take_answers() {
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t got = ::read(wake.get(), &count, sizeof count);
    std::vector<Answered> ready;
    {
      const std::lock_guard<std::mutex> lock(mutex);
      ready.swap(answers);
    }
    for (Answered& answer : ready) {
      const auto found = connections.find(answer.key);  // It may have hung up.
      if (found != connections.end()) {
        send(answer.key, found->second, std::move(answer.response));
      }
    }
  }

  void drop_late() {
    const Clock::time_point now = Clock::now();
    for (auto at = connections.begin(); at != connections.end();) {
      const Key key = at->first;
      const Connection& connection = at->second;
      ++at;
      if (connection.state == Connection::State::kAnswering || now < connection.due) continue;
      drop(key);
    }
  }

  /// One of the threads that answer.
  void answer_requests() {
    std::unique_lock<std::mutex> lock(mutex);
    while (true) {
      arrived.wait(lock, [&] { return closed || !requests.empty(); });
      if (closed) return;
      const Piece piece = std::move(requests.front());
      requests.pop_front();
      lock.unlock();
      WireResponse response = handler(piece.request);
      lock.lock();
      answers.push_back({piece.key, std::move(response)});
      wake_up();
    }
  }

  void handle(const epoll_event& event) {
    const Key key = event.data.u64;
    if (key == kListening) return accept_all();
    if (key == kWake) return take_answers();
    const auto found = connections.find(key);
    if (found == connections.end()) return;  // It was pushed out in this round.
    Connection& connection = found->second;
    if (connection.state == Connection::State::kReading) return read_from(key);
    if (connection.state == Connection::State::kWriting) return write_to(key, connection);
    // It hung up while it is answered, which epoll tells unasked, and again and again.
    drop(key);
  }

  void serve() {
    std::vector<std::jthread> threads;
    threads.reserve(static_cast<std::size_t>(options.threads));
    for (int k = 0; k < options.threads; ++k)
      threads.emplace_back([this] { answer_requests(); });
    constexpr int kRound_ms = 250;  // Deadlines are kept to that.
    Clock::time_point next_look = Clock::now();
    std::array<epoll_event, 256> events;
    while (!stopping) {
      const int count = ::epoll_wait(epoll.get(), events.data(), events.size(), kRound_ms);
      for (int k = 0; k < count; ++k) handle(events[static_cast<std::size_t>(k)]);
      if (Clock::now() < next_look) continue;
      drop_late();
      next_look = in(1e-3 * kRound_ms);
    }
    {
      const std::lock_guard<std::mutex> lock(mutex);
      closed = true;
    }
    arrived.notify_all();
    threads.clear();
    connections.clear();
    listening = Descriptor();
  }
};

FrontDoor::FrontDoor(const FrontDoorOptions& options, Handler handler)
    : impl_(std::make_unique<Impl>()) {
  impl_->options = options;
  impl_->handler = std::move(handler);
  impl_->limit = affordable_connections(options.connections);
  impl_->listening = listen_on(options.host, options.port);
  if (impl_->listening.get() < 0) {
    throw core::InputError::expected(
        options.host + ":" + std::to_string(options.port),
        "an address of this machine and a port that is free (--host, --port)", "none such");
  }
  impl_->epoll = Descriptor(::epoll_create1(EPOLL_CLOEXEC));
  impl_->wake = Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  SEGSIM_CHECK(impl_->epoll.get() >= 0 && impl_->wake.get() >= 0, std::strerror(errno));
  SEGSIM_CHECK(impl_->watch(impl_->listening.get(), Impl::kListening, EPOLLIN) &&
                   impl_->watch(impl_->wake.get(), Impl::kWake, EPOLLIN),
               std::strerror(errno));
}

FrontDoor::~FrontDoor() = default;

int FrontDoor::port() const { return port_of(impl_->listening.get()); }
void FrontDoor::serve() { impl_->serve(); }
void FrontDoor::stop() {
  impl_->stopping = true;
  impl_->wake_up();
}

}  // namespace segsim::experiments::web::internal
