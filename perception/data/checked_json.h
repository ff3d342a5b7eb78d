#pragma once

/// @file
/// JSON whose whole numbers are what the file says or an error. nlohmann::json itself makes an
/// integer of any number: of 3.7, of 5e9 for 32 bits, and of 1e30, which is undefined
/// behaviour.

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <type_traits>
#include <vector>

#include <nlohmann/json.hpp>

namespace segsim::perception {

/// How values become types of C++: as in nlohmann::json, but for integers.
template <class Value, class = void>
struct CheckedNumbers : nlohmann::adl_serializer<Value, void> {};

/// 3.0 is an integer, too, and `true` is 1.
template <class Integer>
struct CheckedNumbers<
    Integer, std::enable_if_t<std::is_integral_v<Integer> && !std::is_same_v<Integer, bool>>>
    : nlohmann::adl_serializer<Integer, void> {
  using Limits = std::numeric_limits<Integer>;

  /// @throws Json::type_error
  template <class Json>
  static void from_json(const Json& json, Integer& value) {
    bool fits = false;
    if (json.is_number_unsigned()) {
      const auto number = *json.template get_ptr<const std::uint64_t*>();
      fits = number <= static_cast<std::uint64_t>(Limits::max());
      value = static_cast<Integer>(number);
    } else if (json.is_number_integer()) {  // Below 0.
      const auto number = *json.template get_ptr<const std::int64_t*>();
      fits = std::is_signed_v<Integer> && number >= static_cast<std::int64_t>(Limits::min());
      value = static_cast<Integer>(number);
    } else if (json.is_number_float()) {
      const auto number = *json.template get_ptr<const double*>();
      // One above the largest is a power of two, and so exact.
      const double end = 2.0 * static_cast<double>(Limits::max() / 2 + 1);
      fits = number >= static_cast<double>(Limits::min()) && number < end;
      value = fits ? static_cast<Integer>(number) : Integer{0};
      fits = fits && static_cast<double>(value) == number;
    } else if (json.is_boolean()) {
      fits = true;
      value = *json.template get_ptr<const bool*>() ? 1 : 0;
    }
    if (fits) return;
    throw Json::type_error::create(
        302,
        "expected a whole number from " + std::to_string(Limits::min()) + " to " +
            std::to_string(Limits::max()) + ", found " + found_in(json),
        &json);
  }

 private:
  template <class Json>
  static std::string found_in(const Json& json) {
    return json.is_number() ? json.dump() : json.type_name();
  }
};

template <template <class, class, class...> class Object>
using BasicCheckedJson =
    nlohmann::basic_json<Object, std::vector, std::string, bool, std::int64_t, std::uint64_t,
                         double, std::allocator, CheckedNumbers>;

/// In place of nlohmann::json and nlohmann::ordered_json.
using CheckedJson = BasicCheckedJson<std::map>;
using OrderedCheckedJson = BasicCheckedJson<nlohmann::ordered_map>;

}  // namespace segsim::perception
