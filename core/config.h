#pragma once

/// @file
/// Strict reading of YAML: every key must be asked for, every error names file, line and key.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace segsim::core {

/// One node of a YAML document. Reading a map marks its keys as known; `finish()` refuses the
/// others and names the nearest valid key. All readers throw core::InputError with
/// "file:line: key: expected ..., found ...".
class ConfigNode {
 public:
  [[nodiscard]] static ConfigNode load(const std::filesystem::path& file);
  /// @param origin  Name used in messages in place of a file.
  [[nodiscard]] static ConfigNode parse(const std::string& text, const std::string& origin);

  /// "file:line: key path", for messages about this node.
  [[nodiscard]] std::string where() const;
  [[nodiscard]] bool is_map() const;
  [[nodiscard]] bool is_list() const;
  [[nodiscard]] bool is_scalar() const;

  // Children of a map. The version without a fallback requires the key.
  [[nodiscard]] bool has(const std::string& key) const;
  [[nodiscard]] ConfigNode child(const std::string& key) const;
  [[nodiscard]] std::optional<ConfigNode> optional_child(const std::string& key) const;
  [[nodiscard]] std::string text(const std::string& key) const;
  [[nodiscard]] std::string text_or(const std::string& key, const std::string& fallback) const;
  [[nodiscard]] double number(const std::string& key) const;
  [[nodiscard]] double number_or(const std::string& key, double fallback) const;
  [[nodiscard]] std::int64_t integer(const std::string& key) const;
  [[nodiscard]] std::int64_t integer_or(const std::string& key, std::int64_t fallback) const;
  [[nodiscard]] bool boolean_or(const std::string& key, bool fallback) const;
  [[nodiscard]] std::vector<double> numbers(const std::string& key) const;
  [[nodiscard]] std::vector<std::string> texts(const std::string& key) const;
  /// Elements of the list under `key`; empty if the key is absent.
  [[nodiscard]] std::vector<ConfigNode> list(const std::string& key) const;
  /// Keys of this map, in file order. Marks nothing as known.
  [[nodiscard]] std::vector<std::string> keys() const;

  // This node itself.
  [[nodiscard]] std::string as_text() const;
  [[nodiscard]] double as_number() const;
  [[nodiscard]] std::int64_t as_integer() const;
  [[nodiscard]] std::vector<ConfigNode> as_list() const;

  /// Refuses keys of this map that no reader asked for.
  void finish() const;

  /// Throws InputError: "<where>: expected <expected>, found <found>".
  [[noreturn]] void fail(const std::string& expected, const std::string& found) const;

 private:
  struct Impl;
  explicit ConfigNode(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const Impl> impl_;
};

/// The entry of `candidates` with the smallest edit distance to `word`; empty if none is near.
[[nodiscard]] std::string nearest_word(const std::string& word,
                                       const std::vector<std::string>& candidates);

/// The index of `found`, a text of the node, in `words`.
/// @throws InputError that lists the words and names the nearest one.
[[nodiscard]] std::size_t one_of(const ConfigNode& node, const std::string& found,
                                 const std::vector<std::string>& words);
/// The same for the text under a key of a map.
[[nodiscard]] std::size_t choice(const ConfigNode& map, const std::string& key,
                                 const std::vector<std::string>& words);

}  // namespace segsim::core
