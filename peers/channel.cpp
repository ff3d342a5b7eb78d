#include "peers/channel.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <utility>

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "core/error.h"

namespace segsim::peers {
namespace {

constexpr std::size_t kHeader_bytes = 4;

}  // namespace

OwnedFd::OwnedFd(OwnedFd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

OwnedFd& OwnedFd::operator=(OwnedFd&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

OwnedFd::~OwnedFd() { close(); }

void OwnedFd::close() {
  if (fd_ >= 0) ::close(fd_);
  fd_ = -1;
}

Channel::Channel(OwnedFd socket, std::string name)
    : socket_(std::move(socket)),
      input_(socket_.get()),
      output_(socket_.get()),
      name_(std::move(name)) {}

Channel::Channel(int input, int output, std::string name)
    : input_(input), output_(output), name_(std::move(name)) {}

void Channel::wait_for(int fd, short events, Clock::time_point deadline) const {
  for (;;) {
    int wait_ms = -1;
    if (deadline != Clock::time_point::max()) {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
      wait_ms = static_cast<int>(std::max<std::int64_t>(0, left.count()));
    }
    pollfd polled{fd, events, 0};
    const int ready = ::poll(&polled, 1, wait_ms);
    if (ready > 0) return;  // Also with an error, which reading or writing will tell.
    if (ready == 0) throw core::InputError::expected(name_, "an answer in time", "none");
    if (errno != EINTR) throw core::InputError(name_ + ": " + std::strerror(errno));
  }
}

void Channel::send(const std::string& text, Clock::time_point deadline) {
  std::string bytes(kHeader_bytes, '\0');
  for (std::size_t k = 0; k < kHeader_bytes; ++k) {
    bytes[k] = static_cast<char>((text.size() >> (8 * k)) & 0xFFU);
  }
  bytes += text;
  for (std::size_t sent = 0; sent < bytes.size();) {
    wait_for(output_, POLLOUT, deadline);
    const char* rest = bytes.data() + sent;
    const std::size_t count = bytes.size() - sent;
    // A socket tells a closed other side by an error, without a signal; and takes what it has
    // room for.
    const ssize_t done = socket_.is_open()
                             ? ::send(output_, rest, count, MSG_NOSIGNAL | MSG_DONTWAIT)
                             : ::write(output_, rest, count);
    if (done >= 0) {
      sent += static_cast<std::size_t>(done);
    } else if (errno != EINTR && errno != EAGAIN) {
      throw core::InputError::expected(name_, "a program that listens", std::strerror(errno));
    }
  }
}

std::size_t Channel::read_all(char* bytes, std::size_t count, Clock::time_point deadline) {
  std::size_t have = 0;
  while (have < count) {
    wait_for(input_, POLLIN, deadline);
    const ssize_t done = ::read(input_, bytes + have, count - have);
    if (done == 0) break;
    if (done > 0) {
      have += static_cast<std::size_t>(done);
    } else if (errno == ECONNRESET) {
      break;
    } else if (errno != EINTR && errno != EAGAIN) {
      throw core::InputError::expected(name_, "a program that answers", std::strerror(errno));
    }
  }
  return have;
}

std::optional<std::string> Channel::receive(Clock::time_point deadline) {
  std::array<char, kHeader_bytes> header{};
  const std::size_t have = read_all(header.data(), header.size(), deadline);
  if (have == 0) return std::nullopt;
  std::size_t count = 0;
  for (std::size_t k = 0; k < kHeader_bytes; ++k) {
    count |= std::size_t{static_cast<unsigned char>(header[k])} << (8 * k);
  }
  if (have == header.size() && count > kLongest_bytes) {
    throw core::InputError::expected(
        name_, "messages of at most " + std::to_string(kLongest_bytes) + " bytes",
        "one of " + std::to_string(count) + " (is something printed to the same stream?)");
  }
  std::string text(have == header.size() ? count : 0, '\0');
  if (have < header.size() || read_all(text.data(), count, deadline) < count) {
    throw core::InputError::expected(name_, "a whole message", "its beginning");
  }
  return text;
}

}  // namespace segsim::peers
