#include "core/config.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include <yaml-cpp/yaml.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/regular_file.h"
#include "core/internal/yaml_document.h"

namespace segsim::core {
namespace {

std::string describe(const YAML::Node& node) {
  if (!node || node.IsNull()) return "nothing";
  if (node.IsMap()) return "a map";
  if (node.IsSequence()) return "a list";
  return "\"" + node.Scalar() + "\"";
}

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({substituted, row[j] + 1, row[j - 1] + 1});
    }
  }
  return row.back();
}

}  // namespace

struct ConfigNode::Impl {
  YAML::Node node;
  std::string origin;  ///< File name or other source.
  std::string path;    ///< Dotted keys from the root.
  mutable std::set<std::string> known;
  /// Wrappers already handed out, so that marks of known keys are shared.
  mutable std::vector<std::pair<std::string, std::shared_ptr<const Impl>>> children;

  [[nodiscard]] std::string place() const {
    const YAML::Mark mark = node.Mark();
    std::string text = origin;
    if (!mark.is_null()) text += ":" + std::to_string(mark.line + 1);
    if (!path.empty()) text += ": " + path;
    return text;
  }
};

ConfigNode ConfigNode::load(const std::filesystem::path& file) {
  if (!can_be_read(file)) {
    throw InputError::expected(file.string(), "a readable YAML file", "none");
  }
  return parse(read_file(file), file.string());
}

ConfigNode ConfigNode::parse(const std::string& text, const std::string& origin) {
  internal::check_yaml(text, origin);
  auto impl = std::make_shared<Impl>();
  impl->node = YAML::Load(text);
  impl->origin = origin;
  return ConfigNode(impl);
}

std::string ConfigNode::where() const { return impl_->place(); }
bool ConfigNode::is_map() const { return impl_->node.IsMap(); }
bool ConfigNode::is_list() const { return impl_->node.IsSequence(); }
bool ConfigNode::is_scalar() const { return impl_->node.IsScalar(); }

bool ConfigNode::has(const std::string& key) const {
  impl_->known.insert(key);
  if (!impl_->node.IsMap()) return false;
  const YAML::Node value = impl_->node[key];
  if (!value.IsDefined()) return false;
  // An empty value or `~` would silently stand for the default.
  if (value.IsNull()) {
    throw InputError::expected(where() + (impl_->path.empty() ? ": " : ".") + key,
                               "a value (leave the key out for its default)", "nothing");
  }
  return true;
}

ConfigNode ConfigNode::child(const std::string& key) const {
  if (!impl_->node.IsMap()) fail("a map with the key \"" + key + "\"", describe(impl_->node));
  if (!has(key)) fail("the key \"" + key + "\"", "none");
  for (const auto& [name, impl] : impl_->children) {
    if (name == key) return ConfigNode(impl);
  }
  auto impl = std::make_shared<Impl>();
  impl->node = impl_->node[key];
  impl->origin = impl_->origin;
  impl->path = impl_->path.empty() ? key : impl_->path + "." + key;
  impl_->children.emplace_back(key, impl);
  return ConfigNode(impl);
}

std::optional<ConfigNode> ConfigNode::optional_child(const std::string& key) const {
  if (!has(key)) return std::nullopt;
  return child(key);
}

std::string ConfigNode::text(const std::string& key) const { return child(key).as_text(); }
std::string ConfigNode::text_or(const std::string& key, const std::string& fallback) const {
  return has(key) ? text(key) : fallback;
}
double ConfigNode::number(const std::string& key) const { return child(key).as_number(); }
double ConfigNode::number_or(const std::string& key, double fallback) const {
  return has(key) ? number(key) : fallback;
}
std::int64_t ConfigNode::integer(const std::string& key) const {
  return child(key).as_integer();
}
std::int64_t ConfigNode::integer_or(const std::string& key, std::int64_t fallback) const {
  return has(key) ? integer(key) : fallback;
}

bool ConfigNode::boolean_or(const std::string& key, bool fallback) const {
  if (!has(key)) return fallback;
  const ConfigNode node = child(key);
  bool value = false;
  if (!node.is_scalar() || !YAML::convert<bool>::decode(node.impl_->node, value)) {
    node.fail("true or false", describe(node.impl_->node));
  }
  return value;
}

std::vector<double> ConfigNode::numbers(const std::string& key) const {
  std::vector<double> values;
  for (const ConfigNode& element : child(key).as_list()) values.push_back(element.as_number());
  return values;
}

std::vector<std::string> ConfigNode::texts(const std::string& key) const {
  std::vector<std::string> values;
  for (const ConfigNode& element : child(key).as_list()) values.push_back(element.as_text());
  return values;
}

std::vector<ConfigNode> ConfigNode::list(const std::string& key) const {
  if (!has(key)) return {};
  return child(key).as_list();
}

std::vector<std::string> ConfigNode::keys() const {
  std::vector<std::string> names;
  if (!impl_->node.IsMap()) fail("a map", describe(impl_->node));
  for (const auto& entry : impl_->node) names.push_back(entry.first.as<std::string>());
  return names;
}

std::string ConfigNode::as_text() const {
  if (!impl_->node.IsScalar()) fail("a text", describe(impl_->node));
  return impl_->node.Scalar();
}

double ConfigNode::as_number() const {
  double value = 0.0;
  if (!impl_->node.IsScalar() || !YAML::convert<double>::decode(impl_->node, value)) {
    fail("a number", describe(impl_->node));
  }
  if (!std::isfinite(value)) fail("a finite number", describe(impl_->node));
  return value;
}

std::int64_t ConfigNode::as_integer() const {
  std::int64_t value = 0;
  if (!impl_->node.IsScalar() || !YAML::convert<std::int64_t>::decode(impl_->node, value)) {
    fail("an integer", describe(impl_->node));
  }
  return value;
}

std::vector<ConfigNode> ConfigNode::as_list() const {
  if (!impl_->node.IsSequence()) fail("a list", describe(impl_->node));
  std::vector<ConfigNode> elements;
  for (std::size_t i = 0; i < impl_->node.size(); ++i) {
    const std::string name = "[" + std::to_string(i) + "]";
    auto impl = std::make_shared<Impl>();
    impl->node = impl_->node[i];
    impl->origin = impl_->origin;
    impl->path = impl_->path + name;
    elements.push_back(ConfigNode(impl));
  }
  return elements;
}

void ConfigNode::finish() const {
  if (!impl_->node.IsMap()) fail("a map", describe(impl_->node));
  for (const auto& entry : impl_->node) {
    const std::string key = entry.first.as<std::string>();
    if (impl_->known.contains(key)) continue;
    const std::vector<std::string> valid(impl_->known.begin(), impl_->known.end());
    const std::string near = nearest_word(key, valid);
    std::string expected = "a known key";
    if (!near.empty()) expected += " (did you mean \"" + near + "\"?)";
    const std::string place = impl_->origin + ":" +
                              std::to_string(entry.first.Mark().line + 1) +
                              (impl_->path.empty() ? "" : ": " + impl_->path);
    throw InputError::expected(place, expected, "\"" + key + "\"");
  }
}

void ConfigNode::fail(const std::string& expected, const std::string& found) const {
  throw InputError::expected(where(), expected, found);
}

std::string nearest_word(const std::string& word, const std::vector<std::string>& candidates) {
  std::string best;
  std::size_t best_distance = std::max<std::size_t>(3, word.size() / 2 + 1);
  for (const std::string& candidate : candidates) {
    const std::size_t distance = edit_distance(word, candidate);
    if (distance < best_distance) {
      best_distance = distance;
      best = candidate;
    }
  }
  return best;
}

std::size_t one_of(const ConfigNode& node, const std::string& found,
                   const std::vector<std::string>& words) {
  const auto at = std::find(words.begin(), words.end(), found);
  if (at != words.end()) return static_cast<std::size_t>(at - words.begin());
  std::string list;
  for (const std::string& word : words) list += (list.empty() ? "" : " | ") + word;
  const std::string near = nearest_word(found, words);
  node.fail(list, "\"" + found + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
}

std::size_t choice(const ConfigNode& map, const std::string& key,
                   const std::vector<std::string>& words) {
  return one_of(map.child(key), map.text(key), words);
}

}  // namespace segsim::core
