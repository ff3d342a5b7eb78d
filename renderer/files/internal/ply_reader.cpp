#include "renderer/files/internal/ply_reader.h"

#include <charconv>
#include <cstdint>
#include <cstring>
#include <map>
#include <sstream>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::renderer::internal {
namespace {

using core::InputError;

constexpr std::size_t kMostProperties = 1024;

template <class T>
double load(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return static_cast<double>(value);
}

/// A header line is short; this keeps a binary file from being echoed whole in an error.
std::string shortened(const std::string& text) {
  std::string shown = text.substr(0, 60);
  for (char& c : shown) {
    if (c < ' ' || c > '~') c = '?';
  }
  return '"' + shown + '"';
}

}  // namespace

PlyTable::PlyTable(const std::filesystem::path& file)
    : place_(file.string()), bytes_(core::read_file(file)) {
  parse_header();
  if (ascii_) {
    parse_ascii_body();
  } else {
    check_binary_body();
  }
}

std::size_t PlyTable::size_of(Type type) {
  switch (type) {
    case Type::kI8:
    case Type::kU8:
      return 1;
    case Type::kI16:
    case Type::kU16:
      return 2;
    case Type::kF64:
      return 8;
    case Type::kI32:
    case Type::kU32:
    case Type::kF32:
      return 4;
  }
  return 4;
}

void PlyTable::parse_header() {
  std::size_t at = 0;
  int line_number = 0;
  bool in_vertex = false, vertex_seen = false, format_seen = false;
  while (true) {
    const std::size_t end = bytes_.find('\n', at);
    const std::string where = place_ + ":" + std::to_string(line_number + 1);
    if (end == std::string::npos || end - at > 4096) {
      throw InputError::expected(where, "a PLY header that ends with end_header",
                                 shortened(bytes_.substr(at, 60)));
    }
    std::string line = bytes_.substr(at, end - at);
    if (!line.empty() && line.back() == '\r') line.pop_back();
    at = end + 1;
    ++line_number;

    std::istringstream words(line);
    std::string keyword, first;
    words >> keyword;
    if (line_number == 1) {
      if (line != "ply") throw InputError::expected(where, "\"ply\"", shortened(line));
    } else if (keyword == "format") {
      words >> first;
      ascii_ = first == "ascii";
      format_seen = true;
      if (!ascii_ && first != "binary_little_endian") {
        throw InputError::expected(where, "format ascii or binary_little_endian",
                                   shortened(first));
      }
    } else if (keyword == "element") {
      std::string count;
      words >> first >> count;
      in_vertex = first == "vertex";
      if (!in_vertex && !vertex_seen) {
        throw InputError::expected(where, "vertex as the first element", shortened(first));
      }
      if (!in_vertex) continue;
      const auto [stop, error] =
          std::from_chars(count.data(), count.data() + count.size(), row_count_);
      if (error != std::errc() || stop != count.data() + count.size() || vertex_seen) {
        throw InputError::expected(where, "one element vertex with a count", shortened(line));
      }
      vertex_seen = true;
    } else if (keyword == "property" && in_vertex) {
      add_property(line);
    } else if (keyword == "end_header") {
      break;
    }
  }
  if (!format_seen || !vertex_seen) {
    throw InputError::expected(place_, R"(lines "format" and "element vertex" in the header)",
                               "none");
  }
  body_ = at;
}

void PlyTable::add_property(const std::string& line) {
  static const std::map<std::string, Type> kTypes = {
      {"char", Type::kI8},    {"int8", Type::kI8},     {"uchar", Type::kU8},
      {"uint8", Type::kU8},   {"short", Type::kI16},   {"int16", Type::kI16},
      {"ushort", Type::kU16}, {"uint16", Type::kU16},  {"int", Type::kI32},
      {"int32", Type::kI32},  {"uint", Type::kU32},    {"uint32", Type::kU32},
      {"float", Type::kF32},  {"float32", Type::kF32}, {"double", Type::kF64},
      {"float64", Type::kF64}};
  std::istringstream words(line);
  std::string keyword, type, name;
  words >> keyword >> type >> name;
  const auto found = kTypes.find(type);
  if (found == kTypes.end() || name.empty()) {
    throw InputError::expected(place_, "scalar properties in element vertex", shortened(line));
  }
  // Names are compared with all others, and every row is looked at by column.
  if (properties_.size() >= kMostProperties) {
    throw InputError::expected(
        place_, "at most " + std::to_string(kMostProperties) + " properties of a vertex",
        "more");
  }
  if (find(name) >= 0) {
    throw InputError::expected(place_, "one property " + name, "two");
  }
  properties_.push_back({name, found->second, row_bytes_});
  row_bytes_ += size_of(found->second);
}

void PlyTable::check_binary_body() const {
  const std::size_t there = bytes_.size() - body_;
  // Compared by division: a huge count in a damaged header must not overflow the product.
  if (row_bytes_ != 0 && row_count_ > there / row_bytes_) {
    throw InputError::expected(place_,
                               std::to_string(row_count_) + " x " +
                                   std::to_string(row_bytes_) + " bytes after the header",
                               std::to_string(there) + " bytes");
  }
}

void PlyTable::parse_ascii_body() {
  if (!properties_.empty() && row_count_ > bytes_.size()) {
    throw InputError::expected(place_, std::to_string(row_count_) + " vertices",
                               std::to_string(bytes_.size()) + " bytes in all");
  }
  const std::size_t wanted = row_count_ * properties_.size();
  ascii_values_.reserve(wanted);
  const char* at = bytes_.data() + body_;
  const char* const end = bytes_.data() + bytes_.size();
  while (ascii_values_.size() < wanted) {
    while (at != end && (*at == ' ' || *at == '\n' || *at == '\r' || *at == '\t')) ++at;
    if (at == end) {
      throw InputError::expected(place_, std::to_string(wanted) + " values after the header",
                                 std::to_string(ascii_values_.size()));
    }
    double value = 0.0;
    const auto [stop, error] = std::from_chars(at, end, value);
    if (error != std::errc()) {
      throw InputError::expected(place_ + " value " + std::to_string(ascii_values_.size()),
                                 "a number", shortened(std::string(at, end).substr(0, 20)));
    }
    ascii_values_.push_back(value);
    at = stop;
  }
}

int PlyTable::find(const std::string& property) const {
  for (std::size_t i = 0; i < properties_.size(); ++i) {
    if (properties_[i].name == property) return static_cast<int>(i);
  }
  return -1;
}

std::size_t PlyTable::column(const std::string& property) const {
  const int index = find(property);
  if (index >= 0) return static_cast<std::size_t>(index);
  std::string names;
  for (const Property& p : properties_) {
    // The higher colour coefficients and the features would drown the rest.
    if (p.name.starts_with("f_rest_") || p.name.starts_with("sem_f_") ||
        p.name.starts_with("ins_f_")) {
      continue;
    }
    names += (names.empty() ? "" : " ") + p.name;
  }
  throw InputError::expected(place_, "property " + property, "properties " + names);
}

std::size_t PlyTable::count_with_prefix(const std::string& prefix) const {
  std::size_t count = 0;
  for (const Property& p : properties_) count += p.name.starts_with(prefix) ? 1 : 0;
  return count;
}

double PlyTable::value(std::size_t row, std::size_t column) const {
  if (ascii_) return ascii_values_[row * properties_.size() + column];
  const Property& property = properties_[column];
  const char* at = bytes_.data() + body_ + row * row_bytes_ + property.offset_bytes;
  switch (property.type) {
    case Type::kI8:
      return load<std::int8_t>(at);
    case Type::kU8:
      return load<std::uint8_t>(at);
    case Type::kI16:
      return load<std::int16_t>(at);
    case Type::kU16:
      return load<std::uint16_t>(at);
    case Type::kI32:
      return load<std::int32_t>(at);
    case Type::kU32:
      return load<std::uint32_t>(at);
    case Type::kF32:
      return load<float>(at);
    case Type::kF64:
      return load<double>(at);
  }
  return 0.0;
}

}  // namespace segsim::renderer::internal
