#pragma once

/// @file
/// A client that sends exactly what it is told to.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>

#include <nlohmann/json.hpp>

namespace segsim::experiments {

struct Answer {
  int status = 0;
  std::string head, body;
  [[nodiscard]] nlohmann::json json() const { return nlohmann::json::parse(body); }
};

/// Sends the bytes and reads until the other side closes.
inline Answer send_raw(int port, const std::string& bytes) {
  const int connection = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string text;
  if (::connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) ==
          0 &&
      ::send(connection, bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
          static_cast<ssize_t>(bytes.size())) {
    char buffer[65536];
    for (ssize_t size = 1; size > 0;) {
      size = ::recv(connection, buffer, sizeof buffer, 0);
      if (size > 0) text.append(buffer, static_cast<std::size_t>(size));
    }
  }
  ::close(connection);
  Answer answer;
  const std::size_t end = text.find("\r\n\r\n");
  if (end == std::string::npos || text.size() < 12) return answer;
  answer.status = std::stoi(text.substr(9, 3));
  answer.head = text.substr(0, end + 2);
  answer.body = text.substr(end + 4);
  return answer;
}

/// @param headers  Each with its end of line.
inline std::string request_head(const std::string& method, const std::string& path,
                                const std::string& headers,
                                const std::string& host = "localhost") {
  return method + " " + path + " HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n" +
         headers + "\r\n";
}

}  // namespace segsim::experiments
