#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>

#include "core/error.h"
#include "core/file_io.h"
#include "worlds/mesh/internal/mesh_parts.h"
#include "worlds/mesh/internal/number_mending.h"

namespace segsim::worlds::internal {
namespace {

constexpr std::string_view kBlanks = " \t\r\n";

/// COLLADA elements whose content is a list of real numbers.
constexpr auto kNumberElements =
    std::to_array<std::string_view>({"float_array", "matrix", "translate", "rotate", "scale",
                                     "lookat", "skew", "color", "float"});

/// Those whose content is a list of indices. assimp 5.2 waits for ever, and takes memory all
/// the time, at a word there that does not begin with a digit.
constexpr auto kIndexElements = std::to_array<std::string_view>({"p", "vcount", "v", "h"});

/// @param place  Of the element, for messages.
void check_indices(std::string_view content, const std::string& place) {
  while (!content.empty()) {
    const std::size_t start = std::min(content.find_first_not_of(kBlanks), content.size());
    content.remove_prefix(start);
    const std::string_view word =
        content.substr(0, std::min(content.find_first_of(kBlanks), content.size()));
    content.remove_prefix(word.size());
    const std::string_view digits = word.substr(word.starts_with('-') ? 1 : 0);
    const bool fits = digits.size() <= 10 &&
                      digits.find_first_not_of("0123456789") == std::string_view::npos;
    if (word.empty() || (fits && !digits.empty())) continue;
    throw core::InputError::expected(place, "indices",
                                     "\"" + std::string(word.substr(0, 40)) + "\"");
  }
}

template <class List>
bool lists(const List& names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

/// Length of the finite number that begins `text`; 0 if none does.
std::size_t number_length(std::string_view text) {
  const std::size_t sign = text.starts_with('+') ? 1 : 0;
  double value = 0.0;
  const auto [end, error] =
      std::from_chars(text.data() + sign, text.data() + text.size(), value);
  if (error != std::errc() || !std::isfinite(value)) return 0;
  return static_cast<std::size_t>(end - text.data());
}

class Mender {
 public:
  /// Appends blanks and mended numbers of `content` to the result.
  void add_numbers(std::string_view content) {
    while (!content.empty()) {
      const std::size_t start = std::min(content.find_first_not_of(kBlanks), content.size());
      add(content.substr(0, start));
      content.remove_prefix(start);
      const std::size_t end = std::min(content.find_first_of(kBlanks), content.size());
      add_number(content.substr(0, end));
      content.remove_prefix(end);
    }
  }
  void add(std::string_view text) { mended_.text += text; }
  void leave_out(std::string_view text) { mended_.changed |= !text.empty(); }

  MendedText finish() && {
    if (!mended_.changed) mended_.text.clear();
    return std::move(mended_);
  }

 private:
  void add_number(std::string_view number) {
    if (number.empty() || number_length(number) == number.size()) return add(number);
    if (mended_.count++ == 0) mended_.first = number;
    mended_.changed = true;
    mended_.text += mended_number(number);
  }

  MendedText mended_;
};

MendedText mend_collada(std::string_view text, const std::string& place) {
  Mender mender;
  const std::string_view whole = text;
  while (!text.empty()) {
    const std::size_t open = text.find('<');
    const std::size_t close = text.find('>', std::min(open, text.size()));
    if (close == std::string_view::npos) break;
    const std::string_view tag = text.substr(open + 1, close - open - 1);
    const std::string_view name = tag.substr(0, tag.find_first_of(" \t\r\n/"));
    mender.add(text.substr(0, close + 1));
    text.remove_prefix(close + 1);
    if (!tag.ends_with('/') && lists(kIndexElements, name)) {
      const std::string_view before = whole.substr(0, whole.size() - text.size());
      const auto line = std::count(before.begin(), before.end(), '\n') + 1;
      check_indices(text.substr(0, text.find('<')), place + ":" + std::to_string(line));
    }
    if (tag.ends_with('/') || !lists(kNumberElements, name)) continue;
    std::string_view content = text.substr(0, text.find('<'));
    text.remove_prefix(content.size());
    if (name == "color" || name == "float") {
      const std::size_t start = std::min(content.find_first_not_of(kBlanks), content.size());
      mender.leave_out(content.substr(0, start));
      content.remove_prefix(start);
    }
    mender.add_numbers(content);
  }
  mender.add(text);
  return std::move(mender).finish();
}

MendedText mend_obj(std::string_view text) {
  Mender mender;
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    const std::string_view line =
        text.substr(0, end == std::string_view::npos ? text.size() : end + 1);
    text.remove_prefix(line.size());
    const std::size_t key = std::min(line.find_first_of(kBlanks), line.size());
    const std::string_view name = line.substr(0, key);
    if (name == "v" || name == "vn" || name == "vt") {
      mender.add(name);
      mender.add_numbers(line.substr(key));
    } else {
      mender.add(line);
    }
  }
  return std::move(mender).finish();
}

}  // namespace

std::string mended_number(std::string_view number) {
  std::string text(number);
  if (text.find('#') != std::string::npos) return "0";
  if (std::count(text.begin(), text.end(), ',') == 1 && text.find('.') == std::string::npos) {
    std::replace(text.begin(), text.end(), ',', '.');
  }
  const std::size_t length = number_length(text);
  return length == 0 ? "0" : text.substr(0, length);
}

MendedText mend_numbers(const std::filesystem::path& file) {
  const std::string extension = lower_case_extension(file);
  if (extension == ".dae") return mend_collada(core::read_file(file), file.string());
  if (extension == ".obj") return mend_obj(core::read_file(file));
  return {};
}

}  // namespace segsim::worlds::internal
