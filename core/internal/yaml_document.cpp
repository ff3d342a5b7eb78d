#include "core/internal/yaml_document.h"

#include <cstdint>
#include <map>
#include <set>
#include <sstream>
#include <vector>

#include <yaml-cpp/eventhandler.h>
#include <yaml-cpp/yaml.h>

#include "core/error.h"

namespace segsim::core::internal {
namespace {

constexpr std::uint64_t kMostNodes = 1'000'000;

/// Follows the events of the parser, which knows aliases by number and does not replace them.
class Checker final : public YAML::EventHandler {
 public:
  explicit Checker(std::string origin) : origin_(std::move(origin)) {}

  void OnDocumentStart(const YAML::Mark& /*mark*/) override {}
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    add(mark, nullptr, anchor, 1);
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    // An alias inside of what it stands for has no size yet, and no end.
    const auto size = sizes_.find(anchor);
    if (size == sizes_.end()) refuse(mark, "an alias of what stands above", "one of its own");
    add(mark, nullptr, YAML::NullAnchor, size->second);
  }
  void OnScalar(const YAML::Mark& mark, const std::string& /*tag*/, YAML::anchor_t anchor,
                const std::string& value) override {
    add(mark, &value, anchor, 1);
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string& /*tag*/,
                       YAML::anchor_t anchor, YAML::EmitterStyle::value /*style*/) override {
    open(mark, anchor, false);
  }
  void OnSequenceEnd() override { close(); }
  void OnMapStart(const YAML::Mark& mark, const std::string& /*tag*/, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value /*style*/) override {
    open(mark, anchor, true);
  }
  void OnMapEnd() override { close(); }

 private:
  struct Level {
    YAML::anchor_t anchor = YAML::NullAnchor;
    bool is_map = false, is_value = false;
    std::uint64_t nodes = 1;
    std::set<std::string> keys;
  };

  [[noreturn]] void refuse(const YAML::Mark& mark, const std::string& expected,
                           const std::string& found) const {
    throw InputError::expected(origin_ + ":" + std::to_string(mark.line + 1), expected, found);
  }

  /// A node has ended, or begins if it is a map or a list.
  /// @param scalar  Null unless it is one.
  void take_place(const YAML::Mark& mark, const std::string* scalar) {
    if (levels_.empty() || !levels_.back().is_map) return;
    Level& map = levels_.back();
    if (!map.is_value) {
      if (scalar == nullptr) refuse(mark, "a text as a key", "another node");
      if (!map.keys.insert(*scalar).second) {
        refuse(mark, "each key once", "\"" + *scalar + "\" again");
      }
    }
    map.is_value = !map.is_value;
  }

  void count(const YAML::Mark& mark, std::uint64_t nodes) {
    if (!levels_.empty()) levels_.back().nodes += nodes;
    nodes_ += nodes;
    if (nodes_ > kMostNodes) {
      refuse(mark, "at most " + std::to_string(kMostNodes) + " nodes", "more");
    }
  }

  void add(const YAML::Mark& mark, const std::string* scalar, YAML::anchor_t anchor,
           std::uint64_t nodes) {
    take_place(mark, scalar);
    count(mark, nodes);
    if (anchor != YAML::NullAnchor) sizes_[anchor] = nodes;
  }

  void open(const YAML::Mark& mark, YAML::anchor_t anchor, bool is_map) {
    take_place(mark, nullptr);
    ++nodes_;
    Level level;
    level.anchor = anchor;
    level.is_map = is_map;
    levels_.push_back(std::move(level));
  }

  void close() {
    const Level level = std::move(levels_.back());
    levels_.pop_back();
    if (level.anchor != YAML::NullAnchor) sizes_[level.anchor] = level.nodes;
    if (!levels_.empty()) levels_.back().nodes += level.nodes;
  }

  std::string origin_;
  std::vector<Level> levels_;
  std::map<YAML::anchor_t, std::uint64_t> sizes_;  ///< In nodes, with aliases replaced.
  std::uint64_t nodes_ = 0;
};

}  // namespace

void check_yaml(const std::string& text, const std::string& origin) {
  std::istringstream in(text);
  Checker checker(origin);
  try {
    YAML::Parser parser(in);
    parser.HandleNextDocument(checker);
  } catch (const YAML::ParserException& error) {
    throw InputError::expected(origin + ":" + std::to_string(error.mark.line + 1),
                               "valid YAML", error.msg);
  }
}

}  // namespace segsim::core::internal
