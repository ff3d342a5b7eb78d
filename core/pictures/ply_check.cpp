#include "core/pictures/ply_check.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/error.h"

namespace segsim::core {
namespace {

constexpr std::string_view kBlanks = " \t\r\n\v\f";
/// Of a list: polygons of a mesh have few corners.
constexpr std::uint64_t kMostEntries = 1'000'000;

struct Type {
  std::string_view name, other_name;
  std::size_t bytes;
  bool is_real, is_signed;
};
constexpr auto kTypes = std::to_array<Type>({{"char", "int8", 1, false, true},
                                             {"uchar", "uint8", 1, false, false},
                                             {"short", "int16", 2, false, true},
                                             {"ushort", "uint16", 2, false, false},
                                             {"int", "int32", 4, false, true},
                                             {"uint", "uint32", 4, false, false},
                                             {"float", "float32", 4, true, true},
                                             {"double", "float64", 8, true, true}});

struct Property {
  std::string name;
  const Type* count = nullptr;  ///< Of a list: how many follow.
  const Type* value = nullptr;
  std::vector<double>* kept = nullptr;  ///< Where its numbers go, if somebody wants them.
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

enum class Format { kAscii, kLittleEndian, kBigEndian };

class Checker {
 public:
  Checker(std::string_view bytes, const std::string& place) : left_(bytes), place_(place) {}

  void check() {
    read_header();
    read_body();
  }

  std::map<std::string, PlyProperty> keep(std::string_view element,
                                          std::span<const std::string_view> names) {
    read_header();
    std::map<std::string, PlyProperty> kept;
    for (Element& each : elements_) {
      if (each.name != element) continue;
      for (Property& property : each.properties) {
        const bool wanted =
            std::find(names.begin(), names.end(), property.name) != names.end();
        if (!wanted || property.count != nullptr || kept.contains(property.name)) continue;
        PlyProperty& column = kept[property.name];
        column.type = property.value->name;
        property.kept = &column.values;
      }
    }
    read_body();
    return kept;
  }

 private:
  void read_body() {
    for (const Element& element : elements_) {
      if (element.properties.empty() && element.count > 0) {
        fail("elements with properties", "none");
      }
      for (std::uint64_t i = 0; i < element.count; ++i) {
        for (const Property& property : element.properties) read(property);
      }
    }
  }

  [[noreturn]] void fail(const std::string& expected, std::string_view found) const {
    throw InputError::expected(place_, expected,
                               "\"" + std::string(found.substr(0, 40)) + "\"");
  }

  /// The words of the next line.
  std::vector<std::string_view> next_line() {
    const std::size_t end = left_.find('\n');
    if (end == std::string_view::npos) fail("a PLY header that ends (end_header)", left_);
    std::string_view line = left_.substr(0, end);
    left_.remove_prefix(end + 1);
    std::vector<std::string_view> words;
    while (true) {
      line.remove_prefix(std::min(line.find_first_not_of(kBlanks), line.size()));
      if (line.empty()) return words;
      words.push_back(line.substr(0, line.find_first_of(kBlanks)));
      line.remove_prefix(words.back().size());
    }
  }

  const Type* type(std::string_view word) const {
    for (const Type& known : kTypes) {
      if (word == known.name || word == known.other_name) return &known;
    }
    fail("a type of a PLY property", word);
  }

  void read_header() {
    if (const auto first = next_line(); first.size() != 1 || first[0] != "ply") {
      fail("a PLY file", first.empty() ? "" : first[0]);
    }
    bool has_format = false;
    while (true) {
      const std::vector<std::string_view> words = next_line();
      if (words.empty() || words[0] == "comment" || words[0] == "obj_info") continue;
      if (words[0] == "end_header") break;
      if (words[0] == "format" && words.size() == 3) {
        read_format(words[1]);
        has_format = true;
      } else if (words[0] == "element" && words.size() == 3) {
        add_element(words[1], count(words[2]));
      } else if (words[0] == "property" && !elements_.empty()) {
        read_property(words);
      } else {
        fail("a line of a PLY header", words[0]);
      }
    }
    if (!has_format) fail("a PLY header with a format", "end_header");
  }

  void add_element(std::string_view name, std::uint64_t count) {
    check_name(name);
    const bool is_known = std::any_of(elements_.begin(), elements_.end(),
                                      [&](const Element& each) { return each.name == name; });
    if (is_known) fail("each element once", name);
    elements_.push_back({std::string(name), count, {}});
  }

  /// assimp takes a number in the place of a name for the count.
  void check_name(std::string_view word) const {
    const char first = word[0];
    const bool is_letter =
        (first >= 'a' && first <= 'z') || (first >= 'A' && first <= 'Z') || first == '_';
    if (!is_letter) fail("a name that begins with a letter", word);
  }

  void read_format(std::string_view word) {
    if (word == "ascii") {
      format_ = Format::kAscii;
    } else if (word == "binary_little_endian") {
      format_ = Format::kLittleEndian;
    } else if (word == "binary_big_endian") {
      format_ = Format::kBigEndian;
    } else {
      fail("a format of PLY", word);
    }
  }

  [[nodiscard]] std::uint64_t count(std::string_view word) const {
    std::uint64_t number = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
    if (error != std::errc() || end != word.data() + word.size()) {
      fail("a number of elements", word);
    }
    return number;
  }

  void read_property(const std::vector<std::string_view>& words) {
    Property property;
    if (words.size() == 5 && words[1] == "list") {
      property = {std::string(words[4]), type(words[2]), type(words[3]), nullptr};
      if (property.count->is_real) fail("a list with a whole number of entries", words[2]);
    } else if (words.size() == 3) {
      property = {std::string(words[2]), nullptr, type(words[1]), nullptr};
    } else {
      fail("property TYPE NAME, or property list TYPE TYPE NAME",
           words.size() > 1 ? words[1] : words[0]);
    }
    check_name(property.name);
    elements_.back().properties.push_back(property);
  }

  void read(const Property& property) {
    std::uint64_t values = 1;
    if (property.count != nullptr) {
      values = format_ == Format::kAscii ? count(next_word()) : binary_count(*property.count);
      if (values > kMostEntries) fail("lists of at most a million", std::to_string(values));
    }
    if (format_ != Format::kAscii) {
      const std::string_view bytes = take(values * property.value->bytes);
      if (property.kept != nullptr) property.kept->push_back(binary_number(bytes, property));
      return;
    }
    for (std::uint64_t i = 0; i < values; ++i) {
      const double value = number(next_word());
      if (property.kept != nullptr) property.kept->push_back(value);
    }
  }

  std::string_view next_word() {
    left_.remove_prefix(std::min(left_.find_first_not_of(kBlanks), left_.size()));
    if (left_.empty()) fail("all numbers of a PLY file", "the end of the file");
    const std::string_view word = left_.substr(0, left_.find_first_of(kBlanks));
    left_.remove_prefix(word.size());
    return word;
  }

  /// What is too small or too large for a double is a number all the same: 0.
  [[nodiscard]] double number(std::string_view word) const {
    double value = 0.0;
    const char* begin = word.data() + (word.starts_with('+') ? 1 : 0);
    const auto [end, error] = std::from_chars(begin, word.data() + word.size(), value);
    if (error == std::errc::invalid_argument || end != word.data() + word.size()) {
      fail("a number", word);
    }
    return value;
  }

  std::string_view take(std::uint64_t bytes) {
    if (bytes > left_.size()) fail("all bytes of a PLY file", "the end of the file");
    const std::string_view taken = left_.substr(0, bytes);
    left_.remove_prefix(bytes);
    return taken;
  }

  [[nodiscard]] std::uint64_t bits(std::string_view bytes) const {
    std::uint64_t number = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      const std::size_t at = format_ == Format::kBigEndian ? i : bytes.size() - 1 - i;
      number = (number << 8U) | static_cast<unsigned char>(bytes[at]);
    }
    return number;
  }

  [[nodiscard]] double binary_number(std::string_view bytes, const Property& property) const {
    const std::uint64_t number = bits(bytes);
    const Type& type = *property.value;
    if (type.is_real) {
      return type.bytes == 8 ? std::bit_cast<double>(number)
                             : static_cast<double>(
                                   std::bit_cast<float>(static_cast<std::uint32_t>(number)));
    }
    const double value = static_cast<double>(number);
    const bool negative = type.is_signed && (number >> (8 * type.bytes - 1)) != 0;
    return negative ? value - std::ldexp(1.0, static_cast<int>(8 * type.bytes)) : value;
  }

  std::uint64_t binary_count(const Type& type) {
    const std::uint64_t number = bits(take(type.bytes));
    if (type.is_signed && (number >> (8 * type.bytes - 1)) != 0) {
      fail("a number of entries", "a negative one");
    }
    return number;
  }

  std::string_view left_;
  const std::string& place_;
  Format format_ = Format::kAscii;
  std::vector<Element> elements_;
};

}  // namespace

void check_ply(std::string_view bytes, const std::string& place) {
  Checker(bytes, place).check();
}

std::map<std::string, PlyProperty> read_ply_properties(
    std::string_view bytes, const std::string& place, std::string_view element,
    std::span<const std::string_view> names) {
  return Checker(bytes, place).keep(element, names);
}

}  // namespace segsim::core
