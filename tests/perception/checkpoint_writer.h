#pragma once

/// @file
/// Makes the files that others write, byte by byte, for the tests of the readers.

#include <cstdint>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "core/input/crc32.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/checkpoint/zip_file.h"

namespace segsim::perception {

template <class Number>
void append(std::string& bytes, Number value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

using Records = std::vector<std::pair<std::string, std::string>>;

/// A zip file of stored records. @param in_64  Sizes and directory in the 64-bit fields.
inline std::string make_zip(const Records& records, bool in_64 = false,
                            std::uint16_t method = 0) {
  std::string bytes, directory;
  constexpr std::uint32_t kIn64 = 0xFFFFFFFF;
  for (const auto& [name, data] : records) {
    const auto offset = static_cast<std::uint32_t>(bytes.size());
    const auto size = static_cast<std::uint32_t>(data.size());
    const std::uint32_t stated = in_64 ? kIn64 : size;
    append(bytes, std::uint32_t{0x04034b50});
    for (const int value : {45, 0, int{method}, 0, 0})
      append(bytes, static_cast<std::uint16_t>(value));
    append(bytes, core::crc32(data));
    append(bytes, stated);
    append(bytes, stated);
    append(bytes, static_cast<std::uint16_t>(name.size()));
    append(bytes, std::uint16_t{4});  // An empty extra field, as torch pads its records.
    bytes += name + std::string("FB\0\0", 4) + data;

    append(directory, std::uint32_t{0x02014b50});
    for (const int value : {45, 45, 0, int{method}, 0, 0})
      append(directory, static_cast<std::uint16_t>(value));
    append(directory, core::crc32(data));
    append(directory, stated);
    append(directory, stated);
    append(directory, static_cast<std::uint16_t>(name.size()));
    append(directory, static_cast<std::uint16_t>(in_64 ? 28 : 0));
    for (const int value : {0, 0, 0}) append(directory, static_cast<std::uint16_t>(value));
    append(directory, std::uint32_t{0});
    append(directory, in_64 ? kIn64 : offset);
    directory += name;
    if (!in_64) continue;
    append(directory, std::uint16_t{1});
    append(directory, std::uint16_t{24});
    for (const std::uint32_t value : {size, size, offset})
      append(directory, std::uint64_t{value});
  }
  const std::uint64_t begin = bytes.size();
  bytes += directory;
  if (in_64) {
    const std::uint64_t end = bytes.size();
    append(bytes, std::uint32_t{0x06064b50});
    append(bytes, std::uint64_t{44});
    append(bytes, std::uint32_t{0x002d002d});
    append(bytes, std::uint64_t{0});
    append(bytes, std::uint64_t{records.size()});
    append(bytes, std::uint64_t{records.size()});
    append(bytes, std::uint64_t{directory.size()});
    append(bytes, begin);
    append(bytes, std::uint32_t{0x07064b50});
    append(bytes, std::uint32_t{0});
    append(bytes, end);
    append(bytes, std::uint32_t{1});
  }
  append(bytes, std::uint32_t{0x06054b50});
  append(bytes, std::uint32_t{0});
  for (int i = 0; i < 2; ++i)
    append(bytes, static_cast<std::uint16_t>(in_64 ? 0xFFFF : records.size()));
  append(bytes, static_cast<std::uint32_t>(directory.size()));
  append(bytes, in_64 ? kIn64 : static_cast<std::uint32_t>(begin));
  append(bytes, std::uint16_t{0});
  return bytes;
}

/// Pieces of a pickle of protocol 2, each one value left on the stack.
namespace pickled {

inline const std::string kBegin = "\x80\x02", kEnd = ".", kNone = "N", kTrue = "\x88";

inline std::string text(const std::string& value) {
  std::string bytes = "X";
  append(bytes, static_cast<std::uint32_t>(value.size()));
  return bytes + value;
}
inline std::string integer(std::int64_t value) {
  std::string bytes = "J";
  append(bytes, static_cast<std::int32_t>(value));
  return bytes;
}
inline std::string name(const std::string& module, const std::string& what) {
  return "c" + module + "\n" + what + "\n";
}
inline std::string tuple(const std::vector<std::string>& items) {
  std::string bytes = "(";
  for (const std::string& item : items) bytes += item;
  return bytes + "t";
}
inline std::string integers(const std::vector<std::int64_t>& values) {
  std::vector<std::string> items;
  for (const std::int64_t value : values) items.push_back(integer(value));
  return tuple(items);
}
inline std::string set_items(const std::vector<std::pair<std::string, std::string>>& pairs) {
  std::string bytes = "(";
  for (const auto& [key, value] : pairs) bytes += key + value;
  return bytes + "u";
}
inline std::string dict(const std::vector<std::pair<std::string, std::string>>& pairs) {
  return "}" + set_items(pairs);
}
inline std::string ordered_dict(
    const std::vector<std::pair<std::string, std::string>>& pairs) {
  return name("collections", "OrderedDict") + ")R" + set_items(pairs);
}
/// An instance of a class with attributes.
inline std::string object(const std::string& module, const std::string& what,
                          const std::vector<std::pair<std::string, std::string>>& attributes) {
  return name(module, what) + ")\x81" + dict(attributes) + "b";
}
inline std::string tensor(const std::string& storage_type, const std::string& key,
                          std::int64_t held, std::int64_t first,
                          const std::vector<std::int64_t>& shape,
                          const std::vector<std::int64_t>& strides) {
  const std::string storage = tuple({text("storage"), name("torch", storage_type), text(key),
                                     text("cpu"), integer(held)}) +
                              "Q";
  return name("torch._utils", "_rebuild_tensor_v2") +
         tuple({storage, integer(first), integers(shape), integers(strides), "\x89",
                ordered_dict({})}) +
         "R";
}

}  // namespace pickled

/// Raw little-endian values, float16 or float32.
inline std::string raw(const std::vector<float>& values, bool half) {
  std::string bytes;
  for (const float value : values) {
    if (half) {
      append(bytes, to_half(value));
    } else {
      append(bytes, value);
    }
  }
  return bytes;
}

inline std::vector<std::int64_t> row_major(const std::vector<std::int64_t>& shape) {
  std::vector<std::int64_t> strides(shape.size(), 1);
  for (std::size_t i = shape.size(); i-- > 1;) strides[i - 1] = strides[i] * shape[i];
  return strides;
}

/// Pickled tensors, each with a storage of its own that is added to `records`.
class TensorPickler {
 public:
  TensorPickler(Records& records, bool half) : records_(records), half_(half) {}
  std::string operator()(const NamedTensor& tensor) {
    const std::string key = std::to_string(next_++);
    records_.emplace_back("archive/data/" + key, raw(tensor.values, half_));
    return pickled::tensor(half_ ? "HalfStorage" : "FloatStorage", key,
                           static_cast<std::int64_t>(tensor.values.size()), 0, tensor.shape,
                           row_major(tensor.shape));
  }

 private:
  Records& records_;
  bool half_;
  int next_ = 0;
};

/// torch.save(state_dict).
inline std::string make_state_dict_file(const std::vector<NamedTensor>& tensors, bool half) {
  Records records{{"archive/data.pkl", ""}};
  TensorPickler pickle(records, half);
  std::vector<std::pair<std::string, std::string>> pairs;
  for (const NamedTensor& tensor : tensors)
    pairs.emplace_back(pickled::text(tensor.name), pickle(tensor));
  records[0].second = pickled::kBegin + pickled::ordered_dict(pairs) + pickled::kEnd;
  records.emplace_back("archive/version", "3\n");
  return make_zip(records);
}

inline std::string make_safetensors_file(const std::vector<NamedTensor>& tensors, bool half) {
  std::string header = R"({"__metadata__":{"format":"pt"})", data;
  for (const NamedTensor& tensor : tensors) {
    header +=
        ",\"" + tensor.name + "\":{\"dtype\":\"" + (half ? "F16" : "F32") + "\",\"shape\":[";
    for (std::size_t i = 0; i < tensor.shape.size(); ++i) {
      header += (i == 0 ? "" : ",") + std::to_string(tensor.shape[i]);
    }
    header += "],\"data_offsets\":[" + std::to_string(data.size()) + ",";
    data += raw(tensor.values, half);
    header += std::to_string(data.size()) + "]}";
  }
  header += "}";
  std::string bytes;
  append(bytes, std::uint64_t{header.size()});
  return bytes + header + data;
}

}  // namespace segsim::perception
