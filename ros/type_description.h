#pragma once

/// @file
/// What a message is made of, as data: its text in the language of .msg files and its type
/// hash (REP 2011).

#include <string>
#include <vector>

#include "ros/message_type.h"

namespace segsim::ros {

struct FieldDescription {
  std::string name;
  int type_id = 0;           ///< Of type_description_interfaces/FieldType, arrays included.
  std::size_t capacity = 0;  ///< Of an array T[N].
  std::string message;       ///< "std_msgs/msg/Header"; empty: no message.
  std::string text;          ///< Of the type, as ros2msg schemas write it: "uint8[]".
  std::size_t string_capacity = 0;  ///< Of string<=N.
};

struct TypeDescription {
  std::string package, name;
  std::vector<FieldDescription> fields;
  [[nodiscard]] std::string full_name() const { return package + "/msg/" + name; }
};

/// A type and all types that it refers to, however deep; these by name.
struct TypeClosure {
  TypeDescription type;
  std::vector<TypeDescription> referenced;
};

/// Schema of encoding "ros2msg": the type's fields, then those of each referenced type below a
/// line of 80 "=".
[[nodiscard]] std::string ros2msg_text(const TypeClosure& closure);

/// "RIHS01_" and 64 hexadecimal digits: SHA-256 of the type's description as JSON.
[[nodiscard]] std::string rihs01(const TypeClosure& closure);

namespace internal {

/// The parts of FieldType's numbers.
inline constexpr int kMessageId = 1, kStringId = 17, kBoundedStringId = 21, kArrayIds = 48,
                     kSequenceIds = 144;

struct PrimitiveName {
  int id;
  const char* text;
};

template <class T>
constexpr PrimitiveName primitive_name() {
  if constexpr (std::is_same_v<T, bool>)
    return {15, "bool"};
  else if constexpr (std::is_same_v<T, float>)
    return {10, "float32"};
  else if constexpr (std::is_same_v<T, double>)
    return {11, "float64"};
  else if constexpr (std::is_signed_v<T>)
    return sizeof(T) == 1   ? PrimitiveName{2, "int8"}
           : sizeof(T) == 2 ? PrimitiveName{4, "int16"}
           : sizeof(T) == 4 ? PrimitiveName{6, "int32"}
                            : PrimitiveName{8, "int64"};
  else
    return sizeof(T) == 1   ? PrimitiveName{3, "uint8"}
           : sizeof(T) == 2 ? PrimitiveName{5, "uint16"}
           : sizeof(T) == 4 ? PrimitiveName{7, "uint32"}
                            : PrimitiveName{9, "uint64"};
}

/// Visits the fields of messages and writes down what they are.
class TypeCollector {
 public:
  template <Message M>
  TypeDescription describe() {
    TypeDescription type{std::string(M::kType.package), std::string(M::kType.name), {}};
    M message;
    M::visit_fields(message, [&]<class T>(const char* name, T& /*value*/) {
      type.fields.push_back(field<T>());
      type.fields.back().name = name;
    });
    return type;
  }
  /// Sorted by name, each once.
  [[nodiscard]] std::vector<TypeDescription> take_referenced();

 private:
  template <class T>
  FieldDescription field() {
    if constexpr (std::is_same_v<T, std::string>) {
      return {{}, kStringId, 0, {}, "string", 0};
    } else if constexpr (kIsBounded<T>) {
      return {{}, kBoundedStringId, 0, {}, "string<=" + std::to_string(T::kMost), T::kMost};
    } else if constexpr (Primitive<T>) {
      return {{}, primitive_name<T>().id, 0, {}, primitive_name<T>().text, 0};
    } else if constexpr (Message<T>) {
      refer(describe<T>());
      return {{}, kMessageId, 0, full_name(T::kType), short_name(T::kType), 0};
    } else {
      FieldDescription element = field<typename T::value_type>();
      if constexpr (kIsArray<T>) {
        element.type_id += kArrayIds;
        element.capacity = std::tuple_size_v<T>;
        element.text += "[" + std::to_string(element.capacity) + "]";
      } else {
        static_assert(kIsSequence<T>);
        element.type_id += kSequenceIds;
        element.text += "[]";
      }
      return element;
    }
  }
  void refer(TypeDescription type);

  std::vector<TypeDescription> referenced_;
};

}  // namespace internal

template <Message M>
[[nodiscard]] TypeClosure describe() {
  internal::TypeCollector collector;
  TypeClosure closure{collector.describe<M>(), {}};
  closure.referenced = collector.take_referenced();
  return closure;
}

}  // namespace segsim::ros
