#pragma once

/// @file
/// Reads a Python pickle as plain data. Nothing is executed: a class or function is a name, a
/// call is a node with the name and its arguments. Names outside a list of harmless packages
/// and instructions outside the list below are refused.
///
/// Instructions: those of protocol 2 that torch.save() and TorchScript write, and the few that
/// protocols 3 and 4 put in their place. Limits: 64 MiB, a million values.

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace segsim::perception {

using ValueId = std::uint32_t;
inline constexpr ValueId kNoValue = 0xFFFFFFFF;

struct PickleValue {
  enum class Kind {
    kNone,
    kBool,        ///< integer
    kInt,         ///< integer
    kFloat,       ///< real
    kText,        ///< text: string or bytes
    kTuple,       ///< items
    kList,        ///< items
    kDict,        ///< pairs
    kName,        ///< text: "package.module name" of a class or function
    kObject,      ///< call of `callable` with the tuple `arguments`; state, items, pairs
    kPersistent,  ///< items[0]: what torch calls the identity of a storage
  };
  Kind kind = Kind::kNone;
  std::int64_t integer = 0;
  double real = 0.0;
  std::string text;
  std::vector<ValueId> items;
  std::vector<std::pair<ValueId, ValueId>> pairs;  ///< In the order of the file.
  ValueId callable = kNoValue, arguments = kNoValue, state = kNoValue;
};

/// Values refer to one another by index, so cycles do no harm to memory; who walks them must
/// bound the depth.
class Pickle {
 public:
  /// @throws core::InputError that starts with `place`.
  static Pickle read(std::string_view bytes, const std::string& place);

  [[nodiscard]] ValueId root() const { return root_; }
  [[nodiscard]] const PickleValue& at(ValueId id) const;
  /// The value of a text key of a dict (or of an object's own entries); kNoValue if absent.
  [[nodiscard]] ValueId find(ValueId dict, std::string_view key) const;
  /// Whether the value is an object made by that name, "module name".
  [[nodiscard]] bool is_call(ValueId id, std::string_view name) const;

 private:
  friend class PickleMachine;
  std::vector<PickleValue> values_;
  ValueId root_ = kNoValue;
};

}  // namespace segsim::perception
