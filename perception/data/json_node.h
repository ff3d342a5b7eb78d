#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/input/json_depth.h"
#include "perception/data/checked_json.h"

namespace segsim::perception {

using Json = OrderedCheckedJson;

/// @throws core::InputError that starts with `place`.
[[nodiscard]] inline Json parse_json(const std::string& text, const std::string& place) {
  if (core::is_too_deep(text)) {
    throw core::InputError::expected(place, "JSON", "brackets nested beyond any use");
  }
  try {
    return Json::parse(text);
  } catch (const nlohmann::json::exception& error) {
    throw core::InputError(place + ": not JSON: " + error.what());
  }
}

/// A JSON value with its place in the file, for errors.
class JsonNode {
 public:
  JsonNode(const Json& json, std::string place) : json_(json), place_(std::move(place)) {}

  [[nodiscard]] const Json& json() const { return json_; }
  [[nodiscard]] bool has(const std::string& key) const { return json_.contains(key); }
  [[nodiscard]] JsonNode at(const std::string& key) const {
    if (!json_.is_object()) fail("an object");
    if (!json_.contains(key)) {
      throw core::InputError::expected(place_ + "." + key, "a value", "nothing");
    }
    return {json_.at(key), place_ + "." + key};
  }
  [[nodiscard]] std::vector<JsonNode> items() const {
    if (!json_.is_array()) fail("a list");
    std::vector<JsonNode> nodes;
    for (std::size_t i = 0; i < json_.size(); ++i) {
      nodes.emplace_back(json_[i], place_ + "[" + std::to_string(i) + "]");
    }
    return nodes;
  }
  /// Whether it is one that 64 bits hold with a sign.
  [[nodiscard]] bool is_integer() const {
    constexpr std::uint64_t kMost = std::numeric_limits<std::int64_t>::max();
    return json_.is_number_unsigned() ? json_.get<std::uint64_t>() <= kMost
                                      : json_.is_number_integer();
  }
  [[nodiscard]] std::int64_t integer(std::int64_t lo, std::int64_t hi) const {
    const bool fits =
        is_integer() && json_.get<std::int64_t>() >= lo && json_.get<std::int64_t>() <= hi;
    if (!fits) {
      fail("an integer in [" + std::to_string(lo) + ", " + std::to_string(hi) + "]");
    }
    return json_.get<std::int64_t>();
  }
  [[nodiscard]] double number(double lo, double hi, const std::string& expected) const {
    const bool fits =
        json_.is_number() && json_.get<double>() >= lo && json_.get<double>() <= hi;
    if (!fits) fail(expected);
    return json_.get<double>();
  }
  [[nodiscard]] double finite() const {
    if (!json_.is_number() || !std::isfinite(json_.get<double>())) fail("a finite number");
    return json_.get<double>();
  }
  [[nodiscard]] std::string text() const {
    if (!json_.is_string() || json_.get<std::string>().empty()) fail("text");
    return json_.get<std::string>();
  }
  [[noreturn]] void fail(const std::string& expected) const {
    std::string found = json_.dump(-1, ' ', false, Json::error_handler_t::replace);
    if (found.size() > 60) found = found.substr(0, 57) + "...";
    throw core::InputError::expected(place_, expected, found);
  }

 private:
  const Json& json_;
  std::string place_;
};

}  // namespace segsim::perception
