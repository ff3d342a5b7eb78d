#pragma once

/// @file
/// Reading JSON with messages that name the file and the key.

#include <cmath>
#include <filesystem>
#include <string>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/json_depth.h"

namespace segsim::reconstruction::internal {

/// A value in a JSON file and the way to it: "transforms.json: frames[3].file_path".
class JsonNode {
 public:
  /// @throws InputError with line and column of a syntax error.
  [[nodiscard]] static JsonNode load(const std::filesystem::path& file) {
    const std::string json = core::read_file(file);
    if (core::is_too_deep(json)) {
      throw core::InputError::expected(file.string(), "JSON",
                                       "brackets nested beyond any use");
    }
    try {
      return {nlohmann::json::parse(json), file.string() + ": "};
    } catch (const nlohmann::json::parse_error& error) {
      std::string text = error.what();
      if (const auto at = text.find("at line"); at != std::string::npos)
        text = text.substr(at);
      throw core::InputError::expected(file.string(), "JSON", "a syntax error " + text);
    } catch (const nlohmann::json::exception& error) {  // A number beyond double.
      throw core::InputError::expected(file.string(), "JSON",
                                       std::string(error.what()).substr(0, 120));
    }
  }

  [[nodiscard]] bool has(const std::string& key) const {
    return value_.is_object() && value_.contains(key);
  }
  [[nodiscard]] bool is_list() const { return value_.is_array(); }
  [[nodiscard]] std::size_t size() const { return value_.size(); }

  [[nodiscard]] JsonNode child(const std::string& key) const {
    if (!value_.is_object()) fail("an object with " + key, value_.type_name());
    if (!value_.contains(key)) fail("the key " + key, "none");
    return {value_.at(key), place_ + (place_.ends_with(": ") ? "" : ".") + key};
  }
  [[nodiscard]] JsonNode at(std::size_t i) const {
    if (!value_.is_array() || i >= value_.size()) fail("a list", value_.type_name());
    return {value_.at(i), place_ + "[" + std::to_string(i) + "]"};
  }

  [[nodiscard]] double as_number() const {
    if (!value_.is_number()) fail("a number", value_.dump());
    const auto number = value_.get<double>();
    if (!std::isfinite(number)) fail("a finite number", value_.dump());
    return number;
  }
  [[nodiscard]] std::int64_t as_integer(std::int64_t lowest, std::int64_t highest) const {
    const std::string range =
        "an integer in [" + std::to_string(lowest) + ", " + std::to_string(highest) + "]";
    if (!value_.is_number_integer()) fail(range, value_.dump());
    const auto number = value_.get<std::int64_t>();
    if (number < lowest || number > highest) fail(range, value_.dump());
    return number;
  }
  [[nodiscard]] bool as_flag() const {
    if (!value_.is_boolean()) fail("true or false", value_.dump());
    return value_.get<bool>();
  }
  [[nodiscard]] std::string as_text() const {
    if (!value_.is_string()) fail("a string", value_.dump());
    return value_.get<std::string>();
  }
  [[nodiscard]] double number(const std::string& key) const { return child(key).as_number(); }
  [[nodiscard]] double number_or(const std::string& key, double fallback) const {
    return has(key) ? number(key) : fallback;
  }
  [[nodiscard]] std::string text(const std::string& key) const { return child(key).as_text(); }

  [[noreturn]] void fail(const std::string& expected, const std::string& found) const {
    std::string place = place_;
    if (place.ends_with(": ")) place.resize(place.size() - 2);
    throw core::InputError::expected(place, expected, found.substr(0, 80));
  }

 private:
  JsonNode(nlohmann::json value, std::string place)
      : value_(std::move(value)), place_(std::move(place)) {}

  nlohmann::json value_;
  std::string place_;
};

}  // namespace segsim::reconstruction::internal
