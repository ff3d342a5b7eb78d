#include "worlds/mesh/internal/collada_check.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <vector>

#include "core/error.h"

namespace segsim::worlds::internal {
namespace {

constexpr std::string_view kBlanks = " \t\r\n";

/// Those of inputs whose source assimp reads numbers from.
constexpr auto kCornerMeanings =
    std::to_array<std::string_view>({"POSITION", "NORMAL", "TEXCOORD", "COLOR", "VERTEX",
                                     "TANGENT", "TEXTANGENT", "BINORMAL", "TEXBINORMAL"});

struct Accessor {
  std::string source, array;  ///< Ids.
  std::uint64_t first = 0, count = 0, stride = 1, parameters = 0;

  /// Numbers that its array must have.
  [[nodiscard]] std::uint64_t end() const {
    if (count == 0) return 0;
    return first + (count - 1) * stride + std::max<std::uint64_t>(parameters, 1);
  }
};

class Checker {
 public:
  explicit Checker(const std::string& place) : place_(place) {}

  void read(std::string_view text) {
    while (true) {
      text.remove_prefix(std::min(text.find('<'), text.size()));
      if (text.starts_with("<!--")) {
        skip_behind(text, "-->");
      } else if (text.starts_with("<![CDATA[")) {
        skip_behind(text, "]]>");
      } else {
        const std::size_t close = end_of_tag(text);
        if (close == std::string_view::npos) return;
        read_tag(text.substr(1, close - 1));
        text.remove_prefix(close + 1);
      }
    }
  }

  void check() const {
    std::set<std::string> sources_of_names;
    for (const Accessor& accessor : accessors_) {
      const auto array = counts_.find(accessor.array);
      if (array == counts_.end()) continue;  // assimp looks for it.
      if (accessor.end() > array->second) {
        fail("an accessor of source \"" + accessor.source + "\" within the " +
                 std::to_string(array->second) + " entries of its array",
             std::to_string(accessor.end()));
      }
      if (arrays_of_names_.contains(accessor.array)) sources_of_names.insert(accessor.source);
    }
    for (const std::string& source : corner_sources_) {
      if (sources_of_names.contains(source)) fail("numbers of corners", "names: " + source);
    }
  }

 private:
  [[noreturn]] void fail(const std::string& expected, const std::string& found) const {
    throw core::InputError::expected(place_, expected, found);
  }

  static void skip_behind(std::string_view& text, std::string_view end) {
    const std::size_t at = text.find(end);
    text.remove_prefix(at == std::string_view::npos ? text.size() : at + end.size());
  }

  /// Where the first tag's `>` is: not within quotes.
  static std::size_t end_of_tag(std::string_view text) {
    char quote = 0;
    for (std::size_t at = 0; at < text.size(); ++at) {
      const char c = text[at];
      if (quote == 0 && c == '>') return at;
      if (quote == 0 && (c == '"' || c == '\'')) {
        quote = c;
      } else if (c == quote) {
        quote = 0;
      }
    }
    return std::string_view::npos;
  }

  /// Of an id or a reference to one. Entities are not decoded here, but by assimp.
  [[nodiscard]] std::string name_in(std::string_view tag,
                                    std::string_view attribute_name) const {
    std::string word = attribute(tag, attribute_name);
    if (word.find('&') != std::string::npos) {
      fail("a name without & for " + std::string(attribute_name), "\"" + word + "\"");
    }
    return word;
  }

  /// Empty if the tag has none. The first counts, as for assimp.
  static std::string attribute(std::string_view tag, std::string_view name) {
    while (true) {
      tag.remove_prefix(std::min(tag.find_first_of(kBlanks), tag.size()));
      tag.remove_prefix(std::min(tag.find_first_not_of(kBlanks), tag.size()));
      if (tag.empty()) return {};
      const bool is_it = tag.substr(0, tag.find_first_of(" \t\r\n=")) == name;
      const std::size_t open = tag.find_first_of("\"'");
      if (open == std::string_view::npos) return {};
      const std::size_t close = tag.find(tag[open], open + 1);
      if (close == std::string_view::npos) return {};
      if (is_it) return std::string(tag.substr(open + 1, close - open - 1));
      tag.remove_prefix(close);
    }
  }

  /// Of an attribute that may be missing.
  [[nodiscard]] std::uint64_t number(std::string_view tag, const std::string& name,
                                     std::uint64_t otherwise) const {
    const std::string word = attribute(tag, name);
    if (word.empty()) return otherwise;
    // The square of nine digits, and more, fits into 64 bits.
    if (word.size() > 9 || word.find_first_not_of("0123456789") != std::string::npos) {
      fail("a whole number from 0 for " + name, "\"" + word.substr(0, 40) + "\"");
    }
    return std::stoull(word);
  }

  static std::string without_mark(const std::string& reference) {
    return reference.substr(reference.starts_with('#') ? 1 : 0);
  }

  void read_tag(std::string_view tag) {
    const std::string_view name = tag.substr(0, tag.find_first_of(" \t\r\n/"));
    if (tag == "/accessor") {
      in_accessor_ = false;
    } else if (name == "source") {
      source_ = name_in(tag, "id");
    } else if (name == "float_array" || name == "Name_array" || name == "IDREF_array") {
      read_array(tag, name != "float_array");
    } else if (name == "accessor") {
      accessors_.push_back({.source = source_,
                            .array = without_mark(name_in(tag, "source")),
                            .first = number(tag, "offset", 0),
                            .count = number(tag, "count", 0),
                            .stride = number(tag, "stride", 1)});
      in_accessor_ = !tag.ends_with('/');
    } else if (name == "param" && in_accessor_) {
      ++accessors_.back().parameters;
    } else if (name == "input") {
      const std::string meaning = attribute(tag, "semantic");
      if (std::find(kCornerMeanings.begin(), kCornerMeanings.end(), meaning) !=
          kCornerMeanings.end()) {
        corner_sources_.insert(without_mark(name_in(tag, "source")));
      }
    }
  }

  void read_array(std::string_view tag, bool of_names) {
    const std::string id = name_in(tag, "id");
    const std::uint64_t count = number(tag, "count", 0);
    // Of two with one id, the lesser.
    const auto [known, is_new] = counts_.emplace(id, count);
    if (!is_new) known->second = std::min(known->second, count);
    if (of_names) arrays_of_names_.insert(id);
  }

  const std::string& place_;
  std::string source_;  ///< Of the latest <source>.
  bool in_accessor_ = false;
  std::map<std::string, std::uint64_t> counts_;
  std::set<std::string> arrays_of_names_, corner_sources_;
  std::vector<Accessor> accessors_;
};

}  // namespace

void check_collada(std::string_view text, const std::string& place) {
  Checker checker(place);
  checker.read(text);
  checker.check();
}

}  // namespace segsim::worlds::internal
