#include "perception/checkpoint/pickle.h"

#include <algorithm>
#include <bit>
#include <unordered_map>

#include "core/check.h"
#include "perception/checkpoint/byte_reader.h"

namespace segsim::perception {
namespace {

using Kind = PickleValue::Kind;

constexpr std::size_t kMaxBytes = std::size_t{64} << 20U;
constexpr std::size_t kMaxValues = 1'000'000;
constexpr std::size_t kLongestName = 1024;

/// Packages whose names may appear. They are never imported; the list tells a model file from
/// one that was made to run something in readers less careful than this one.
constexpr std::string_view kPackages[] = {"torch",       "ultralytics", "__torch__",
                                          "collections", "numpy",       "pathlib",
                                          "datetime",    "argparse",    "types"};
/// Harmless names of packages that also hold harmful ones, "module name".
constexpr std::string_view kNames[] = {
    "__builtin__ set",       "__builtin__ frozenset", "__builtin__ dict",
    "__builtin__ list",      "__builtin__ object",    "__builtin__ slice",
    "__builtin__ range",     "__builtin__ bytearray", "builtins set",
    "builtins frozenset",    "builtins dict",         "builtins list",
    "builtins object",       "builtins slice",        "builtins range",
    "builtins bytearray",    "_codecs encode",        "copy_reg _reconstructor",
    "copyreg _reconstructor"};

bool is_allowed(std::string_view module, const std::string& name) {
  const std::string_view package = module.substr(0, module.find('.'));
  return std::find(std::begin(kPackages), std::end(kPackages), package) !=
             std::end(kPackages) ||
         std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
}

}  // namespace

/// The stack machine of the format.
class PickleMachine {
 public:
  PickleMachine(std::string_view bytes, const std::string& place) : in_(bytes, place) {}

  Pickle run() {
    while (!done_) step(in_.number<std::uint8_t>());
    return std::move(pickle_);
  }

 private:
  [[noreturn]] void refuse(const std::string& expected, const std::string& found) const {
    throw core::InputError::expected(
        in_.place() + " at byte " + std::to_string(in_.position()), expected, found);
  }

  ValueId add(PickleValue value) {
    if (pickle_.values_.size() >= kMaxValues) refuse("at most a million values", "more");
    pickle_.values_.push_back(std::move(value));
    return static_cast<ValueId>(pickle_.values_.size() - 1);
  }
  void push(PickleValue value) { stack_.push_back(add(std::move(value))); }
  void push_kind(Kind kind) {
    PickleValue value;
    value.kind = kind;
    push(std::move(value));
  }
  void push_integer(Kind kind, std::int64_t integer) {
    PickleValue value;
    value.kind = kind;
    value.integer = integer;
    push(std::move(value));
  }
  void push_text(std::string_view text) {
    PickleValue value;
    value.kind = Kind::kText;
    value.text = std::string(text);
    push(std::move(value));
  }

  /// Takes the top of the stack, which does not reach below the last mark.
  ValueId pop() {
    const std::size_t floor = marks_.empty() ? 0 : marks_.back();
    if (stack_.size() <= floor) refuse("a value on the stack", "none");
    const ValueId id = stack_.back();
    stack_.pop_back();
    return id;
  }
  std::vector<ValueId> pop_to_mark() {
    if (marks_.empty()) refuse("a mark on the stack", "none");
    const auto begin = stack_.begin() + static_cast<std::ptrdiff_t>(marks_.back());
    std::vector<ValueId> items(begin, stack_.end());
    stack_.erase(begin, stack_.end());
    marks_.pop_back();
    return items;
  }
  PickleValue& top() {
    if (stack_.empty()) refuse("a value on the stack", "none");
    return pickle_.values_[stack_.back()];
  }
  void push_tuple(std::vector<ValueId> items) {
    PickleValue value;
    value.kind = Kind::kTuple;
    value.items = std::move(items);
    push(std::move(value));
  }
  void push_tuple_of(int count) {
    std::vector<ValueId> items(static_cast<std::size_t>(count));
    std::generate(items.rbegin(), items.rend(), [this] { return pop(); });
    push_tuple(std::move(items));
  }

  void push_name(std::string_view module, std::string_view name) {
    // Both may be texts that were stored once and are named again and again.
    if (module.size() + name.size() > kLongestName) {
      refuse("names of at most 1024 characters", std::to_string(module.size() + name.size()));
    }
    PickleValue value;
    value.kind = Kind::kName;
    value.text = std::string(module) + " " + std::string(name);
    if (!is_allowed(module, value.text)) {
      refuse("names of torch, ultralytics and plain containers",
             "\"" + value.text.substr(0, 80) + "\"");
    }
    push(std::move(value));
  }
  void push_call() {
    PickleValue value;
    value.kind = Kind::kObject;
    value.arguments = pop();
    value.callable = pop();
    if (pickle_.values_[value.callable].kind != Kind::kName)
      refuse("the name of a class", "a value");
    if (pickle_.values_[value.arguments].kind != Kind::kTuple)
      refuse("a tuple of arguments", "a value");
    push(std::move(value));
  }

  void append(const std::vector<ValueId>& items) {
    PickleValue& target = top();
    if (target.kind != Kind::kList && target.kind != Kind::kObject)
      refuse("a list", "a value");
    target.items.insert(target.items.end(), items.begin(), items.end());
  }
  void set_items(const std::vector<ValueId>& items) {
    PickleValue& target = top();
    if (target.kind != Kind::kDict && target.kind != Kind::kObject)
      refuse("a dict", "a value");
    if (items.size() % 2 != 0) refuse("pairs", "an odd count");
    for (std::size_t i = 0; i < items.size(); i += 2) {
      target.pairs.emplace_back(items[i], items[i + 1]);
    }
  }
  void build() {
    const ValueId state = pop();
    PickleValue& target = top();
    if (target.kind != Kind::kObject) refuse("an object", "a value");
    target.state = state;
  }
  void remember(std::uint32_t key) {
    (void)top();
    memo_[key] = stack_.back();
  }
  void recall(std::uint32_t key) {
    const auto found = memo_.find(key);
    if (found == memo_.end()) refuse("a value that was stored", "memo " + std::to_string(key));
    stack_.push_back(found->second);
    if (stack_.size() > kMaxValues) refuse("at most a million values", "more");
  }
  void push_long(std::size_t bytes) {
    if (bytes > 8) refuse("an integer of at most 64 bits", std::to_string(bytes) + " bytes");
    const std::string_view digits = in_.take(bytes);
    std::uint64_t value = bytes > 0 && (digits.back() & 0x80) != 0 ? ~std::uint64_t{0} : 0;
    for (std::size_t i = bytes; i-- > 0;) {
      value = (value << 8U) | static_cast<std::uint8_t>(digits[i]);
    }
    push_integer(Kind::kInt, std::bit_cast<std::int64_t>(value));
  }
  void push_float() {
    std::uint64_t bits = 0;
    for (const char byte : in_.take(8)) bits = (bits << 8U) | static_cast<std::uint8_t>(byte);
    PickleValue value;
    value.kind = Kind::kFloat;
    value.real = std::bit_cast<double>(bits);
    push(std::move(value));
  }
  void push_persistent() {
    const ValueId identity = pop();
    PickleValue value;
    value.kind = Kind::kPersistent;
    value.items = {identity};
    push(std::move(value));
  }
  void push_stack_name() {
    const std::string name = pickle_.values_[pop()].text;
    const std::string module = pickle_.values_[pop()].text;
    push_name(module, name);
  }

  void step(std::uint8_t code);
  bool step_constant(std::uint8_t code);
  bool step_container(std::uint8_t code);

  ByteReader in_;
  Pickle pickle_;
  std::vector<ValueId> stack_;
  std::vector<std::size_t> marks_;
  std::unordered_map<std::uint32_t, ValueId> memo_;
  bool done_ = false;
};

/// Numbers, texts and names. @returns whether the code was one.
bool PickleMachine::step_constant(std::uint8_t code) {
  switch (code) {
    case 'N':
      push_kind(Kind::kNone);
      return true;
    case 0x88:
      push_integer(Kind::kBool, 1);
      return true;
    case 0x89:
      push_integer(Kind::kBool, 0);
      return true;
    case 'J':
      push_integer(Kind::kInt, in_.number<std::int32_t>());
      return true;
    case 'K':
      push_integer(Kind::kInt, in_.number<std::uint8_t>());
      return true;
    case 'M':
      push_integer(Kind::kInt, in_.number<std::uint16_t>());
      return true;
    case 0x8a:
      push_long(in_.number<std::uint8_t>());
      return true;
    case 'G':
      push_float();
      return true;
    case 'X':  // Text of 4 length bytes, bytes of 4, string of 4.
    case 'B':
    case 'T':
      push_text(in_.take(in_.number<std::uint32_t>()));
      return true;
    case 0x8c:  // The same of 1.
    case 'C':
    case 'U':
      push_text(in_.take(in_.number<std::uint8_t>()));
      return true;
    case 'c': {
      const std::string_view module = in_.line();
      push_name(module, in_.line());
      return true;
    }
    case 0x93:
      push_stack_name();
      return true;
    default:
      return false;
  }
}

/// Tuples, lists, dicts, objects. @returns whether the code was one.
bool PickleMachine::step_container(std::uint8_t code) {
  switch (code) {
    case '}':
      push_kind(Kind::kDict);
      return true;
    case ']':
    case 0x8f:
      push_kind(Kind::kList);
      return true;
    case ')':
      push_tuple({});
      return true;
    case 't':
      push_tuple(pop_to_mark());
      return true;
    case 0x85:
      push_tuple_of(1);
      return true;
    case 0x86:
      push_tuple_of(2);
      return true;
    case 0x87:
      push_tuple_of(3);
      return true;
    case 'a':
      append({pop()});
      return true;
    case 'e':
    case 0x90:
      append(pop_to_mark());
      return true;
    case 's': {
      const ValueId value = pop();
      const ValueId key = pop();
      set_items({key, value});
      return true;
    }
    case 'u':
      set_items(pop_to_mark());
      return true;
    case 'R':
    case 0x81:
      push_call();
      return true;
    case 'b':
      build();
      return true;
    case 'Q':
      push_persistent();
      return true;
    default:
      return false;
  }
}

void PickleMachine::step(std::uint8_t code) {
  if (step_constant(code) || step_container(code)) return;
  switch (code) {
    case 0x80: {
      const auto protocol = in_.number<std::uint8_t>();
      if (protocol < 2 || protocol > 4) refuse("protocol 2 to 4", std::to_string(protocol));
      return;
    }
    case 0x95:
      in_.take(8);
      return;  // Length of a frame: not needed.
    case '(':
      if (marks_.size() >= kMaxValues) refuse("at most a million marks", "more");
      marks_.push_back(stack_.size());
      return;
    case '0':
      (void)pop();
      return;
    case 'q':
      remember(in_.number<std::uint8_t>());
      return;
    case 'r':
      remember(in_.number<std::uint32_t>());
      return;
    case 0x94:
      remember(static_cast<std::uint32_t>(memo_.size()));
      return;
    case 'h':
      recall(in_.number<std::uint8_t>());
      return;
    case 'j':
      recall(in_.number<std::uint32_t>());
      return;
    case '.':
      pickle_.root_ = pop();
      done_ = true;
      return;
    default:
      refuse("an instruction of plain data", "code " + std::to_string(code));
  }
}

Pickle Pickle::read(std::string_view bytes, const std::string& place) {
  if (bytes.size() > kMaxBytes) {
    throw core::InputError::expected(place, "at most 64 MiB of structure",
                                     std::to_string(bytes.size()) + " bytes");
  }
  return PickleMachine(bytes, place).run();
}

const PickleValue& Pickle::at(ValueId id) const {
  SEGSIM_CHECK(id < values_.size(), std::to_string(id));
  return values_[id];
}

ValueId Pickle::find(ValueId dict, std::string_view key) const {
  if (dict == kNoValue) return kNoValue;
  for (const auto& [name, value] : at(dict).pairs) {
    if (at(name).kind == Kind::kText && at(name).text == key) return value;
  }
  return kNoValue;
}

bool Pickle::is_call(ValueId id, std::string_view name) const {
  if (id == kNoValue || at(id).kind != Kind::kObject) return false;
  return at(at(id).callable).text == name;
}

}  // namespace segsim::perception
