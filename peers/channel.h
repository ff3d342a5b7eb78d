#pragma once

/// @file
/// Messages over a connected socket or a pair of pipes: four bytes of length, little-endian,
/// then so many bytes of text.

#include <chrono>
#include <optional>
#include <string>

namespace segsim::peers {

/// A file descriptor that is closed with its owner.
class OwnedFd {
 public:
  OwnedFd() = default;
  explicit OwnedFd(int fd) : fd_(fd) {}
  OwnedFd(OwnedFd&& other) noexcept;
  OwnedFd& operator=(OwnedFd&& other) noexcept;
  ~OwnedFd();

  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool is_open() const { return fd_ >= 0; }
  void close();

 private:
  int fd_ = -1;
};

class Channel {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::size_t kLongest_bytes = std::size_t{16} << 20;

  /// @param name  Of the other side, for error messages.
  Channel(OwnedFd socket, std::string name);
  /// @param input, output  Stay open when the channel ends: standard streams.
  Channel(int input, int output, std::string name);

  /// @throws core::InputError if the other side is gone or takes nothing until `deadline`.
  void send(const std::string& text, Clock::time_point deadline = Clock::time_point::max());
  /// The next message; none if the other side has closed between two messages.
  /// @throws core::InputError if it is late, cut off, or longer than kLongest_bytes.
  [[nodiscard]] std::optional<std::string> receive(
      Clock::time_point deadline = Clock::time_point::max());

 private:
  /// Bytes read before the end of the stream.
  std::size_t read_all(char* bytes, std::size_t count, Clock::time_point deadline);
  void wait_for(int fd, short events, Clock::time_point deadline) const;

  OwnedFd socket_;
  int input_, output_;
  std::string name_;
};

}  // namespace segsim::peers
