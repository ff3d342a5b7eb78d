#pragma once

/// @file
/// The names that the values of an enum have in files and tables: one list, read both ways.

#include <array>
#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

#include "core/error.h"

namespace segsim::core {

/// @tparam kLast  The last value of the enum, whose values count up from 0.
template <class Value, Value kLast>
class NameTable {
 public:
  static constexpr std::size_t kCount = static_cast<std::size_t>(kLast) + 1;

  /// @param what  What the values are, for error messages: "a stop reason".
  /// @param names  In the order of the values. One too few does not compile.
  consteval NameTable(const char* what, const std::array<const char*, kCount>& names)
      : what_(what), names_(names) {
    for (const char* name : names) {
      if (name == nullptr) throw std::logic_error("a value without a name");
    }
  }

  [[nodiscard]] const char* name(Value value) const {
    return names_.at(static_cast<std::size_t>(value));
  }
  /// None if no value has that name.
  [[nodiscard]] std::optional<Value> find(std::string_view name) const {
    for (std::size_t k = 0; k < kCount; ++k) {
      if (name == names_[k]) return static_cast<Value>(k);
    }
    return std::nullopt;
  }
  /// @param place  Where the name was read: the file, and the line or key in it.
  /// @throws InputError for a name that no value has.
  [[nodiscard]] Value read(std::string_view name, const std::string& place) const {
    if (const std::optional<Value> value = find(name)) return *value;
    std::string known;
    for (const char* one : names_) known += (known.empty() ? "" : ", ") + std::string(one);
    throw InputError::expected(place, std::string(what_) + " (" + known + ")",
                               "\"" + std::string(name) + "\"");
  }

 private:
  const char* what_;
  std::array<const char*, kCount> names_;
};

}  // namespace segsim::core
