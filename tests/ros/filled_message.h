#pragma once

#include <cstdint>
#include <string>

#include "ros/message_type.h"

namespace segsim::ros {

/// Gives every field a value of its own, and lists 0 to 3 elements.
class MessageFiller {
 public:
  explicit MessageFiller(std::uint32_t seed = 0) : next_(seed) {}

  template <class T>
  void operator()(const char* /*field*/, T& value) {
    fill(value);
  }
  template <class T>
  void fill(T& value) {
    ++next_;
    if constexpr (std::is_same_v<T, bool>) {
      value = next_ % 2 == 0;
    } else if constexpr (std::is_base_of_v<std::string, T>) {
      static_cast<std::string&>(value) = std::string(next_ % 7, 'a') + std::to_string(next_);
    } else if constexpr (std::is_floating_point_v<T>) {
      value = static_cast<T>(next_) / T{8} - T{3};
    } else if constexpr (Primitive<T>) {
      value = static_cast<T>(next_ * 2654435761U);  // Knuth's multiplicative hash.
    } else if constexpr (Message<T>) {
      T::visit_fields(value, *this);
    } else {
      if constexpr (kIsSequence<T>) value.resize(next_ % 4);
      for (auto& element : value) fill(element);
    }
  }

 private:
  std::uint32_t next_;
};

template <Message M>
[[nodiscard]] M filled_message(std::uint32_t seed = 0) {
  M message;
  MessageFiller(seed).fill(message);
  return message;
}

}  // namespace segsim::ros
