#include "reconstruction/datasets/internal/pcd_check.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <vector>

#include "core/error.h"

namespace segsim::reconstruction::internal {
namespace {

/// Between words, for PCL.
constexpr std::string_view kBlanks = " \t\r";
constexpr std::uint64_t kMostFields = 1000, kMostCount = 100'000, kMostPoints = 1U << 30U;

using Words = std::vector<std::string_view>;

class Checker {
 public:
  Checker(std::string_view bytes, const std::string& place) : left_(bytes), place_(place) {}

  void check() {
    const std::string data = read_header();
    if (data == "ascii") {
      check_text();
    } else if (data == "binary") {
      if (left_.size() < points_ * point_bytes_) fail("all points", "the end of the file");
    } else if (data == "binary_compressed") {
      check_compressed();
    } else {
      fail("DATA ascii, binary or binary_compressed", data);
    }
  }

 private:
  [[noreturn]] void fail(const std::string& expected, std::string_view found) const {
    throw core::InputError::expected(place_, expected,
                                     "\"" + std::string(found.substr(0, 40)) + "\"");
  }

  Words next_line() {
    const std::size_t end = left_.find('\n');
    std::string_view line = left_.substr(0, end);
    left_.remove_prefix(end == std::string_view::npos ? left_.size() : end + 1);
    Words words;
    while (true) {
      line.remove_prefix(std::min(line.find_first_not_of(kBlanks), line.size()));
      if (line.empty()) return words;
      words.push_back(line.substr(0, line.find_first_of(kBlanks)));
      line.remove_prefix(words.back().size());
    }
  }

  /// The next line of the header that says something.
  Words next_entry() {
    while (!left_.empty()) {
      const bool is_empty = left_.front() == '\n';
      const Words words = next_line();
      // PCL passes over empty lines, but to others that say nothing the header ends for it.
      if (words.empty() && !is_empty) fail("a header of words", "a line of blanks");
      if (!words.empty() && !words[0].starts_with('#')) return words;
    }
    fail("the header of a PCD file", "the end of the file");
  }

  [[nodiscard]] std::uint64_t number(std::string_view word, std::uint64_t most) const {
    std::uint64_t value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size() || value > most) {
      fail("a number from 0 to " + std::to_string(most), word);
    }
    return value;
  }

  /// An entry of that name with `values` words behind it.
  void expect(const Words& entry, const char* name, std::size_t values) const {
    if (entry[0] != name) fail(std::string("the line ") + name, entry[0]);
    if (entry.size() != values + 1) {
      fail(std::string(name) + " with " + std::to_string(values) + " entries",
           std::to_string(entry.size() - 1));
    }
  }

  /// @return  What DATA says.
  std::string read_header() {
    Words entry = next_entry();
    if (entry[0] == "VERSION") entry = next_entry();
    if (entry[0] != "FIELDS" && entry[0] != "COLUMNS") fail("the line FIELDS", entry[0]);
    const std::size_t fields = entry.size() - 1;
    if (fields == 0 || fields > kMostFields) {
      fail("1 to " + std::to_string(kMostFields) + " fields", std::to_string(fields));
    }
    const Words sizes = next_entry();
    expect(sizes, "SIZE", fields);
    const Words types = next_entry();
    expect(types, "TYPE", fields);
    Words counts(fields + 1, "1");
    entry = next_entry();
    if (entry[0] == "COUNT") {
      expect(entry, "COUNT", fields);
      counts = entry;
      entry = next_entry();
    }
    for (std::size_t i = 1; i <= fields; ++i) add_field(sizes[i], types[i], counts[i]);
    expect(entry, "WIDTH", 1);
    const std::uint64_t width = number(entry[1], kMostPoints);
    entry = next_entry();
    expect(entry, "HEIGHT", 1);
    const std::uint64_t height = number(entry[1], kMostPoints);
    entry = next_entry();
    if (entry[0] == "VIEWPOINT") {
      expect(entry, "VIEWPOINT", 7);
      entry = next_entry();
    }
    expect(entry, "POINTS", 1);
    points_ = number(entry[1], kMostPoints);
    if (points_ != width * height) {
      fail("POINTS " + std::to_string(width * height) + " (WIDTH x HEIGHT)", entry[1]);
    }
    entry = next_entry();
    expect(entry, "DATA", 1);
    return std::string(entry[1]);
  }

  void add_field(std::string_view size, std::string_view type, std::string_view count) {
    const std::uint64_t bytes = number(size, 8), values = number(count, kMostCount);
    const bool known = type == "F" ? bytes == 4 || bytes == 8
                       : type == "I" || type == "U"
                           ? bytes == 1 || bytes == 2 || bytes == 4 || bytes == 8
                           : false;
    if (!known) fail("fields of F 4 or 8, I or U 1, 2, 4 or 8 bytes", type);
    if (values == 0) fail("a COUNT above 0", count);
    point_bytes_ += bytes * values;
    point_values_ += values;
  }

  void check_text() {
    for (std::uint64_t i = 0; i < points_;) {
      if (left_.empty()) fail("all points", "the end of the file");
      const Words words = next_line();
      if (words.empty()) continue;
      if (words.size() < point_values_) {
        fail(std::to_string(point_values_) + " numbers for a point",
             std::to_string(words.size()));
      }
      ++i;
    }
  }

  void check_compressed() {
    std::array<std::uint32_t, 2> sizes{};  // Compressed, and not.
    if (left_.size() < sizeof sizes) fail("sizes of compressed points", "the end of the file");
    std::memcpy(sizes.data(), left_.data(), sizeof sizes);
    if (left_.size() - sizeof sizes < sizes[0]) fail("all points", "the end of the file");
    if (sizes[1] != points_ * point_bytes_) {
      fail(std::to_string(points_ * point_bytes_) + " bytes of points",
           std::to_string(sizes[1]));
    }
    // LZF makes at most 264 bytes of three.
    if (sizes[1] > 100 * (std::uint64_t{sizes[0]} + 1)) {
      fail("compressed points", "more than their bytes can hold");
    }
  }

  std::string_view left_;
  const std::string& place_;
  std::uint64_t points_ = 0, point_bytes_ = 0, point_values_ = 0;
};

}  // namespace

void check_pcd(std::string_view bytes, const std::string& place) {
  Checker(bytes, place).check();
}

}  // namespace segsim::reconstruction::internal
