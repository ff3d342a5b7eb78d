#include "experiments/web/internal/request_bytes.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <optional>
#include <string_view>

namespace segsim::experiments::web::internal {
namespace {

constexpr std::string_view kEndOfHead = "\r\n\r\n";

bool equal_names(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char x, char y) {
    return std::tolower(static_cast<unsigned char>(x)) ==
           std::tolower(static_cast<unsigned char>(y));
  });
}

std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

/// Of a head with its last end of line; nullopt if it is malformed.
std::optional<std::size_t> body_size(std::string_view head) {
  std::optional<std::size_t> size;
  std::size_t at = head.find("\r\n");  // Behind the request line.
  while (at != std::string_view::npos && at + 2 < head.size()) {
    const std::size_t begin = at + 2;
    at = head.find("\r\n", begin);
    const std::string_view line = head.substr(begin, at - begin);
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) continue;
    const std::string_view name = trimmed(line.substr(0, colon));
    if (equal_names(name, "Transfer-Encoding")) return std::nullopt;
    if (!equal_names(name, "Content-Length")) continue;
    const std::string_view digits = trimmed(line.substr(colon + 1));
    std::size_t value = 0;
    const auto [end, error] =
        std::from_chars(digits.data(), digits.data() + digits.size(), value);
    if (size || error != std::errc() || end != digits.data() + digits.size()) {
      return std::nullopt;
    }
    size = value;
  }
  return size.value_or(0);
}

}  // namespace

RequestEnd request_end(const std::string& bytes, std::size_t largest_head,
                       std::size_t largest_body) {
  using State = RequestEnd::State;
  const std::size_t end = bytes.find(kEndOfHead);
  if (end == std::string::npos) {
    return {bytes.size() > largest_head ? State::kHeadTooLarge : State::kPartial, 0};
  }
  const std::size_t head = end + kEndOfHead.size();
  if (head > largest_head) return {State::kHeadTooLarge, 0};
  const auto body = body_size(std::string_view(bytes).substr(0, end + 2));
  if (!body) return {State::kMalformed, 0};
  if (*body > largest_body) return {State::kBodyTooLarge, 0};
  if (bytes.size() < head + *body) return {State::kPartial, 0};
  return {State::kWhole, head + *body};
}

void drop_header(std::string& request, std::string_view name) {
  std::size_t begin = request.find("\r\n") + 2;
  for (std::size_t end = request.find("\r\n", begin); end != begin;
       end = request.find("\r\n", begin)) {
    const std::string_view line = std::string_view(request).substr(begin, end - begin);
    if (equal_names(trimmed(line.substr(0, line.find(':'))), name)) {
      request.erase(begin, end + 2 - begin);
    } else {
      begin = end + 2;
    }
  }
}

}  // namespace segsim::experiments::web::internal
