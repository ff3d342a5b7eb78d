#pragma once

/// @file
/// How messages of ROS 2 are described here: once, and everything else follows from it.
///
/// A message is a struct with the name of its type and one function that visits its fields in
/// the order of the .msg file:
///
///     struct Time {
///       static constexpr MessageType kType{"builtin_interfaces", "Time"};
///       std::int32_t sec = 0;
///       std::uint32_t nanosec = 0;
///       template <class Self, class Visitor>
///       static void visit_fields(Self& self, Visitor&& visit) {
///         visit("sec", self.sec);
///         visit("nanosec", self.nanosec);
///       }
///     };
///
/// Its bytes (ros/cdr.h), its ros2msg text and its type hash (ros/type_description.h) are all
/// made by visitors. Fields are numbers, bool, std::string, BoundedString, messages, and
/// std::array (T[N]) and std::vector (T[]) of these. Constants and defaults of a .msg file are
/// no part of its bytes and its hash, and are left out.

#include <array>
#include <concepts>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace segsim::ros {

/// The name of a type: package and message.
struct MessageType {
  std::string_view package, name;
};

template <class T>
concept Message = requires {
  { T::kType } -> std::convertible_to<MessageType>;
};

/// What XCDR1 stores in as many bytes as its size, aligned to it.
template <class T>
concept Primitive = std::is_arithmetic_v<T>;

/// string<=N of a .msg file: as bytes the same as a string.
template <std::size_t N>
struct BoundedString : std::string {
  using std::string::string;
  static constexpr std::size_t kMost = N;
};

template <class T>
inline constexpr bool kIsBounded = false;
template <std::size_t N>
inline constexpr bool kIsBounded<BoundedString<N>> = true;
template <class T>
inline constexpr bool kIsArray = false;
template <class T, std::size_t N>
inline constexpr bool kIsArray<std::array<T, N>> = true;
template <class T>
inline constexpr bool kIsSequence = false;
template <class T>
inline constexpr bool kIsSequence<std::vector<T>> = true;

/// "sensor_msgs/Image", as ros2msg schemas write it.
[[nodiscard]] inline std::string short_name(const MessageType& type) {
  return std::string(type.package) + "/" + std::string(type.name);
}
/// "sensor_msgs/msg/Image", as `ros2 topic info` shows it.
[[nodiscard]] inline std::string full_name(const MessageType& type) {
  return std::string(type.package) + "/msg/" + std::string(type.name);
}

}  // namespace segsim::ros
