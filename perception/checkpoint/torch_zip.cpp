#include <algorithm>
#include <map>
#include <optional>

#include "core/error.h"
#include "perception/checkpoint/internal/formats.h"
#include "perception/checkpoint/pickle.h"
#include "perception/checkpoint/zip_file.h"

namespace segsim::perception {
namespace {

using Kind = PickleValue::Kind;

constexpr int kMaxDepth = 64;
constexpr std::size_t kLongestName = 1024, kMostSides = 8, kMostEntries = 4'000'000;
constexpr std::size_t kMaxModules = 100'000, kMaxTensors = 100'000;

const std::map<std::string, ElementType>& storage_types() {
  static const std::map<std::string, ElementType> kTypes = {
      {"torch HalfStorage", ElementType::kF16},  {"torch BFloat16Storage", ElementType::kBf16},
      {"torch FloatStorage", ElementType::kF32}, {"torch DoubleStorage", ElementType::kF64},
      {"torch CharStorage", ElementType::kI8},   {"torch ByteStorage", ElementType::kU8},
      {"torch ShortStorage", ElementType::kI16}, {"torch IntStorage", ElementType::kI32},
      {"torch LongStorage", ElementType::kI64},  {"torch BoolStorage", ElementType::kBool}};
  return kTypes;
}

/// Turns the pickled tree into a list of tensors.
class TreeReader {
 public:
  TreeReader(TensorFile& file, const Pickle& pickle, std::vector<ZipRecord> records,
             std::string folder)
      : file_(file), pickle_(pickle), folder_(std::move(folder)) {
    for (ZipRecord& record : records) records_.emplace(record.name, record);
  }

  void run() {
    const ValueId root = find_model(pickle_.root());
    const Kind kind = pickle_.at(root).kind;
    if (is_state_dict(root)) {
      for (const auto& [name, value] : pickle_.at(root).pairs) {
        if (is_tensor(value)) add_tensor(text_of(name), value);
      }
    } else if (kind == Kind::kObject) {
      read_class_names(root);
      read_module(root, "", 0);
    }
    if (file_.tensors.empty()) {
      throw core::InputError::expected(file_.place, "a state dict or a module with tensors",
                                       "none");
    }
  }

 private:
  [[noreturn]] void refuse(const std::string& name, const std::string& expected,
                           const std::string& found) const {
    throw core::InputError::expected(file_.place + ": " + name, expected, found);
  }
  [[nodiscard]] std::string text_of(ValueId id) const {
    const PickleValue& value = pickle_.at(id);
    if (value.kind != Kind::kText) return {};
    // One text may be named a million times.
    if (value.text.size() > kLongestName) {
      refuse(value.text.substr(0, 40) + "...", "names of at most 1024 characters",
             std::to_string(value.text.size()));
    }
    return value.text;
  }
  [[nodiscard]] bool is_none(ValueId id) const {
    return id == kNoValue || pickle_.at(id).kind == Kind::kNone;
  }

  /// A tensor, or a parameter around one.
  [[nodiscard]] bool is_tensor(ValueId id) const {
    return pickle_.is_call(id, "torch._utils _rebuild_tensor_v2") || is_parameter(id);
  }
  [[nodiscard]] bool is_parameter(ValueId id) const {
    return pickle_.is_call(id, "torch._utils _rebuild_parameter") ||
           pickle_.is_call(id, "torch._utils _rebuild_parameter_with_state");
  }
  [[nodiscard]] bool is_state_dict(ValueId id) const {
    const PickleValue& value = pickle_.at(id);
    const bool dict =
        value.kind == Kind::kDict || pickle_.is_call(id, "collections OrderedDict");
    return dict && std::any_of(value.pairs.begin(), value.pairs.end(),
                               [this](const auto& pair) { return is_tensor(pair.second); });
  }

  /// Steps into a checkpoint dict: averaged weights first, as the trainers that write both do.
  [[nodiscard]] ValueId find_model(ValueId root) const {
    const Kind kind = pickle_.at(root).kind;
    if (kind != Kind::kDict && kind != Kind::kObject) return root;
    if (is_state_dict(root)) return root;
    for (const char* key : {"ema", "model", "state_dict"}) {
      const ValueId found = pickle_.find(root, key);
      if (!is_none(found)) return found;
    }
    return root;
  }

  /// The attributes of an object: its state, or the first half of a state with slots.
  [[nodiscard]] ValueId attributes_of(ValueId object) const {
    const ValueId state = pickle_.at(object).state;
    if (state == kNoValue) return kNoValue;
    const PickleValue& value = pickle_.at(state);
    if (value.kind == Kind::kTuple && !value.items.empty()) return value.items[0];
    return state;
  }

  void read_module(ValueId module, const std::string& prefix, int depth) {
    if (depth > kMaxDepth || ++modules_ > kMaxModules || prefix.size() > kLongestName) {
      refuse(prefix.substr(0, 80), "a tree of modules", "one too deep or too large");
    }
    const ValueId attributes = attributes_of(module);
    if (attributes == kNoValue) return;
    count_entries(attributes, prefix);
    const ValueId children = pickle_.find(attributes, "_modules");
    if (children == kNoValue) {
      read_attributes(attributes, prefix, depth);
      return;
    }
    for (const char* kind : {"_parameters", "_buffers"}) {
      const ValueId tensors = pickle_.find(attributes, kind);
      if (is_none(tensors)) continue;
      count_entries(tensors, prefix);
      for (const auto& [name, value] : pickle_.at(tensors).pairs) {
        if (is_tensor(value)) add_tensor(prefix + text_of(name), value);
      }
    }
    count_entries(children, prefix);
    for (const auto& [name, child] : pickle_.at(children).pairs) {
      if (!is_none(child)) read_module(child, prefix + text_of(name) + ".", depth + 1);
    }
  }

  /// A module may stand in the tree many times, and each time its entries are gone through.
  void count_entries(ValueId dict, const std::string& prefix) {
    entries_ += pickle_.at(dict).pairs.size();
    if (entries_ > kMostEntries) {
      refuse(prefix.substr(0, 80), "a tree of modules", "one with too many entries");
    }
  }

  /// TorchScript: tensors and modules are plain attributes.
  void read_attributes(ValueId attributes, const std::string& prefix, int depth) {
    for (const auto& [name, value] : pickle_.at(attributes).pairs) {
      if (is_tensor(value)) {
        add_tensor(prefix + text_of(name), value);
      } else if (pickle_.at(value).kind == Kind::kObject) {
        read_module(value, prefix + text_of(name) + ".", depth + 1);
      }
    }
  }

  [[nodiscard]] std::vector<std::int64_t> integers(ValueId id, const std::string& name) const {
    std::vector<std::int64_t> result;
    const PickleValue& tuple = pickle_.at(id);
    if (tuple.kind != Kind::kTuple && tuple.kind != Kind::kList) {
      refuse(name, "a tuple of integers", "another value");
    }
    if (tuple.items.size() > kMostSides) {
      refuse(name, "at most 8 sides", std::to_string(tuple.items.size()));
    }
    for (const ValueId item : tuple.items) {
      if (pickle_.at(item).kind != Kind::kInt) refuse(name, "integers", "another value");
      result.push_back(pickle_.at(item).integer);
    }
    return result;
  }

  void add_tensor(const std::string& name, ValueId value) {
    if (is_parameter(value)) {
      const auto& arguments = pickle_.at(pickle_.at(value).arguments).items;
      if (arguments.empty() ||
          !pickle_.is_call(arguments[0], "torch._utils _rebuild_tensor_v2")) {
        refuse(name, "a parameter around a tensor", "another value");
      }
      value = arguments[0];
    }
    if (file_.tensors.size() >= kMaxTensors) refuse(name, "at most 100000 tensors", "more");
    const auto& arguments = pickle_.at(pickle_.at(value).arguments).items;
    if (arguments.size() < 4 || pickle_.at(arguments[1]).kind != Kind::kInt) {
      refuse(name, "storage, offset, size and stride of a tensor", "other arguments");
    }
    StoredTensor tensor;
    tensor.name = name;
    tensor.shape = integers(arguments[2], name);
    tensor.strides = integers(arguments[3], name);
    if (tensor.strides.size() != tensor.shape.size())
      refuse(name, "one stride per side", "others");
    place_in_storage(tensor, arguments[0], pickle_.at(arguments[1]).integer);
    file_.tensors.push_back(std::move(tensor));
  }

  /// Sets type and offset; refuses a tensor that leaves its storage or repeats its elements.
  void place_in_storage(StoredTensor& tensor, ValueId storage, std::int64_t first) {
    const std::string& name = tensor.name;
    const PickleValue& persistent = pickle_.at(storage);
    if (persistent.kind != Kind::kPersistent) refuse(name, "a storage", "another value");
    const auto& identity = pickle_.at(persistent.items[0]).items;
    if (identity.size() < 5 || text_of(identity[0]) != "storage") {
      refuse(name, "the identity of a storage", "another value");
    }
    const auto type = storage_types().find(pickle_.at(identity[1]).text);
    if (type == storage_types().end()) {
      refuse(name, "a storage of numbers", pickle_.at(identity[1]).text.substr(0, 80));
    }
    tensor.type = type->second;
    const ZipRecord& record = record_of(name, text_of(identity[2]));
    const auto held = static_cast<std::int64_t>(record.size / bytes_of(tensor.type));
    const std::int64_t count = element_count(tensor.shape), span = element_span(tensor);
    if (count < 0 || span < 0 || first < 0 || first > held || span > held - first ||
        count > span) {
      refuse(name, "elements inside its storage of " + std::to_string(held), "others");
    }
    tensor.offset = record.offset + static_cast<std::size_t>(first) * bytes_of(tensor.type);
  }

  const ZipRecord& record_of(const std::string& name, const std::string& key) {
    const auto found = records_.find(folder_ + "data/" + key);
    if (found == records_.end())
      refuse(name, "record data/" + key.substr(0, 80), "no such record");
    if (!checked_[key]) (void)read_record(file_.bytes, found->second, file_.place);
    checked_[key] = true;
    return found->second;
  }

  /// `names` of an Ultralytics model: a dict from class number to name, or a list.
  void read_class_names(ValueId module) {
    const ValueId attributes = attributes_of(module);
    const ValueId names = pickle_.find(attributes, "names");
    if (is_none(names)) return;
    std::map<std::int64_t, std::string> by_number;
    const PickleValue& value = pickle_.at(names);
    for (const auto& [number, name] : value.pairs) {
      if (pickle_.at(number).kind == Kind::kInt)
        by_number[pickle_.at(number).integer] = text_of(name);
    }
    for (const ValueId item : value.items) {
      by_number.emplace(static_cast<std::int64_t>(by_number.size()), text_of(item));
    }
    for (const auto& [number, name] : by_number) file_.class_names.push_back(name);
  }

  TensorFile& file_;
  const Pickle& pickle_;
  std::string folder_;
  std::map<std::string, ZipRecord> records_;
  std::map<std::string, bool> checked_;
  std::size_t modules_ = 0, entries_ = 0;
};

/// "archive/" of the record "archive/data.pkl", of which there is one.
std::string find_folder(const std::vector<ZipRecord>& records, const std::string& place) {
  constexpr std::string_view kStructure = "data.pkl";
  std::optional<std::string> folder;
  for (const ZipRecord& record : records) {
    const std::size_t slash = record.name.rfind('/');
    const std::size_t begin = slash == std::string::npos ? 0 : slash + 1;
    if (record.name.substr(begin) != kStructure) continue;
    if (folder) throw core::InputError::expected(place, "one data.pkl", "two");
    folder = record.name.substr(0, begin);
  }
  if (!folder) throw core::InputError::expected(place, "a torch file with data.pkl", "none");
  return *folder;
}

}  // namespace

void read_torch_zip(TensorFile& file) {
  std::vector<ZipRecord> records = list_zip(file.bytes, file.place);
  const std::string folder = find_folder(records, file.place);
  std::optional<Pickle> pickle;
  for (const ZipRecord& record : records) {
    const std::string_view data =
        record.name == folder + "byteorder" || record.name == folder + "data.pkl"
            ? read_record(file.bytes, record, file.place)
            : std::string_view();
    if (record.name == folder + "byteorder" && data != "little") {
      throw core::InputError::expected(file.place + ": byteorder", "little",
                                       std::string(data.substr(0, 20)));
    }
    if (record.name == folder + "data.pkl") {
      pickle = Pickle::read(data, file.place + ": data.pkl");
    }
  }
  TreeReader(file, *pickle, std::move(records), folder).run();
}

}  // namespace segsim::perception
