#pragma once

/// @file
/// Messages as bytes: XCDR1 (DDS-XTypes 1.3, 7.4.3, "PLAIN_CDR") as ROS 2 uses it for its
/// final types.
///
///     bytes  00 01 00 00            encapsulation: CDR_LE, no options
///            fields one by one      numbers little-endian, aligned to their size
///
/// Alignment counts from behind the encapsulation. A bool is one byte. A string is its length
/// with the closing zero (uint32), the characters, the zero; a sequence its length (uint32)
/// and its elements; an array its elements alone; a message its fields. An empty sequence is
/// its length alone: elements that are not there are not aligned.

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "ros/message_type.h"

namespace segsim::ros {

inline constexpr std::size_t kEncapsulationBytes = 4;

namespace internal {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie");

class CdrEncoder {
 public:
  /// Appends to `bytes`, whose content is kept; the payload begins at its end.
  explicit CdrEncoder(std::vector<std::byte>& bytes) : bytes_(bytes), begin_(bytes.size()) {}

  template <class T>
  void operator()(const char* /*field*/, const T& value) {
    put(value);
  }

  template <class T>
  void put(const T& value) {
    if constexpr (std::is_same_v<T, bool>) {
      put(static_cast<std::uint8_t>(value ? 1 : 0));
    } else if constexpr (Primitive<T>) {
      align(sizeof(T));
      append(&value, sizeof(T));
    } else if constexpr (Message<T>) {
      T::visit_fields(value, *this);
    } else if constexpr (kIsBounded<T>) {
      put(static_cast<const std::string&>(value));
    } else if constexpr (kIsArray<T>) {
      put_elements(value.data(), value.size());
    } else {
      static_assert(kIsSequence<T>);
      put(length_of(value.size()));
      put_elements(value.data(), value.size());
    }
  }
  void put(const std::string& text) {
    put(length_of(text.size() + 1));
    append(text.c_str(), text.size() + 1);
  }

 private:
  template <class T>
  void put_elements(const T* elements, std::size_t count) {
    if constexpr (Primitive<T> && !std::is_same_v<T, bool>) {
      if (count == 0) return;
      align(sizeof(T));
      append(elements, count * sizeof(T));
    } else {
      for (std::size_t k = 0; k < count; ++k) put(elements[k]);
    }
  }
  void align(std::size_t size) {
    const std::size_t past = (bytes_.size() - begin_) % size;
    if (past != 0) bytes_.resize(bytes_.size() + size - past);
  }
  void append(const void* data, std::size_t size) {
    const auto* from = static_cast<const std::byte*>(data);
    bytes_.insert(bytes_.end(), from, from + size);
  }
  /// @throws core::ContractViolation beyond 32 bits.
  static std::uint32_t length_of(std::size_t size);

  std::vector<std::byte>& bytes_;
  std::size_t begin_;
};

/// Reads what CdrEncoder writes, and the same in big-endian order.
class CdrDecoder {
 public:
  /// @param place  For errors: what the bytes are.
  /// @throws core::InputError if they do not begin as plain CDR does.
  CdrDecoder(std::span<const std::byte> bytes, std::string place);

  template <class T>
  void operator()(const char* field, T& value) {
    path_.push_back(field);
    get(value);
    path_.pop_back();
  }

  template <class T>
  void get(T& value) {
    if constexpr (std::is_same_v<T, bool>) {
      value = get_bool();
    } else if constexpr (Primitive<T>) {
      align(sizeof(T));
      std::memcpy(&value, take(sizeof(T)), sizeof(T));
      if (swapped_) swap_bytes(&value, 1, sizeof(T));
    } else if constexpr (Message<T>) {
      T::visit_fields(value, *this);
    } else if constexpr (kIsBounded<T>) {
      get_bounded(value, T::kMost);
    } else if constexpr (kIsArray<T>) {
      get_elements(value.data(), value.size());
    } else {
      static_assert(kIsSequence<T>);
      get_sequence(value);
    }
  }
  void get(std::string& text);

  /// @throws core::InputError if more is left than what fills the last word.
  void finish() const;

 private:
  template <class T>
  void get_sequence(std::vector<T>& values) {
    const std::uint32_t count = get_length("elements");
    values.clear();
    if constexpr (Primitive<T> && !std::is_same_v<T, bool>) {
      if (count == 0) return;
      align(sizeof(T));
      const std::byte* from = take(std::size_t{count} * sizeof(T));
      values.resize(count);
      std::memcpy(values.data(), from, values.size() * sizeof(T));
      if (swapped_) swap_bytes(values.data(), count, sizeof(T));
    } else {
      // Each takes at least a byte, so that the list ends with the bytes, whatever was
      // claimed.
      for (std::uint32_t k = 0; k < count; ++k) {
        T value{};
        get(value);
        values.push_back(std::move(value));
      }
    }
  }
  template <class T>
  void get_elements(T* values, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) get(values[k]);
  }

  bool get_bool();
  void get_bounded(std::string& text, std::size_t most);
  /// A length, which the bytes that are left must at least hold as bytes.
  std::uint32_t get_length(const char* what);
  void align(std::size_t size);
  const std::byte* take(std::size_t size);
  static void swap_bytes(void* values, std::size_t count, std::size_t size);
  [[noreturn]] void fail(const std::string& expected, const std::string& found) const;

  std::span<const std::byte> payload_;
  std::string place_;
  std::size_t at_ = 0;
  bool swapped_ = false;
  std::vector<const char*> path_;  ///< Of the field that is read.
};

}  // namespace internal

/// Replaces what `bytes` holds, and keeps its memory, by the message with its encapsulation.
template <Message M>
void encode_cdr(const M& message, std::vector<std::byte>& bytes) {
  bytes.assign({std::byte{0}, std::byte{1}, std::byte{0}, std::byte{0}});
  internal::CdrEncoder(bytes).put(message);
}
template <Message M>
[[nodiscard]] std::vector<std::byte> encode_cdr(const M& message) {
  std::vector<std::byte> bytes;
  encode_cdr(message, bytes);
  return bytes;
}

/// @param place  For errors, "<file>: message 3 on /scan" for example.
/// @throws core::InputError that names place, field and offset if the bytes are no `M`.
template <Message M>
[[nodiscard]] M decode_cdr(std::span<const std::byte> bytes, const std::string& place) {
  M message;
  internal::CdrDecoder decoder(bytes, place);
  decoder.get(message);
  decoder.finish();
  return message;
}

}  // namespace segsim::ros
