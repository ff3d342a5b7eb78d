#include "reconstruction/training/training_config.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <initializer_list>
#include <optional>
#include <type_traits>
#include <vector>

#include "core/config.h"
#include "reconstruction/training/internal/config_fields.h"

namespace segsim::reconstruction {
namespace {

using core::ConfigNode;

/// The shortest text that reads back as the same number.
std::string text_of(double value) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value);
  return {buffer, end.ptr};
}

/// Sets the fields that a document names.
class FieldReader {
 public:
  explicit FieldReader(ConfigNode root) { nodes_.emplace_back(std::move(root)); }

  void enter(const char* key) {
    nodes_.push_back(nodes_.back() ? nodes_.back()->optional_child(key) : std::nullopt);
  }
  void leave() {
    if (nodes_.back()) nodes_.back()->finish();
    nodes_.pop_back();
  }

  void number(const char* key, double& value, double lowest, double highest) {
    if (!has(key)) return;
    value = node().number(key);
    check(key, value, lowest, highest);
  }

  template <class Integer>
  void integer(const char* key, Integer& value, std::int64_t lowest, std::int64_t highest) {
    if (!has(key)) return;
    const std::int64_t read = node().integer(key);
    check(key, static_cast<double>(read), static_cast<double>(lowest),
          static_cast<double>(highest));
    value = static_cast<Integer>(read);
  }

  void flag(const char* key, bool& value) {
    if (has(key)) value = node().boolean_or(key, value);
  }

  template <class Choice>
  void choice(const char* key, Choice& value, std::initializer_list<const char*> words) {
    if (!has(key)) return;
    const std::string word = node().text(key);
    const auto found = std::find(words.begin(), words.end(), word);
    if (found == words.end()) {
      std::string known;
      for (const char* w : words) known += (known.empty() ? "" : " | ") + std::string(w);
      node().child(key).fail(known, "\"" + word + "\"");
    }
    value = static_cast<Choice>(found - words.begin());
  }

  void finish() { nodes_.back()->finish(); }

 private:
  [[nodiscard]] const ConfigNode& node() const { return *nodes_.back(); }
  [[nodiscard]] bool has(const char* key) const {
    return nodes_.back() && nodes_.back()->has(key);
  }
  void check(const char* key, double value, double lowest, double highest) const {
    if (value >= lowest && value <= highest) return;
    const std::string wanted =
        highest >= internal::kNoLimit
            ? "a number >= " + text_of(lowest)
            : "a number in [" + text_of(lowest) + ", " + text_of(highest) + "]";
    node().child(key).fail(wanted, text_of(value));
  }

  std::vector<std::optional<ConfigNode>> nodes_;
};

class FieldWriter {
 public:
  void enter(const char* key) {
    line(key, "");
    indent_ += "  ";
  }
  void leave() { indent_.resize(indent_.size() - 2); }
  void number(const char* key, double value, double, double) { line(key, text_of(value)); }
  template <class Integer>
  void integer(const char* key, Integer value, std::int64_t, std::int64_t) {
    line(key, std::to_string(value));
  }
  void flag(const char* key, bool value) { line(key, value ? "true" : "false"); }
  template <class Choice>
  void choice(const char* key, Choice value, std::initializer_list<const char*> words) {
    line(key, words.begin()[static_cast<std::size_t>(value)]);
  }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  void line(const std::string& key, const std::string& value) {
    text_ += indent_ + key + (value.empty() ? ":\n" : ": " + value + "\n");
  }
  std::string indent_, text_;
};

void check_order(const ConfigNode& root, const TrainingConfig& config) {
  const auto& loss = config.geometry.loss;
  if (loss.min_depth_m >= loss.max_depth_m) {
    root.fail("geometry.loss.min_depth_m < max_depth_m",
              text_of(loss.min_depth_m) + " and " + text_of(loss.max_depth_m));
  }
  const QueryConfig& query = config.panoptic.query;
  if (query.min_sigma_m > query.initial_sigma_m || query.initial_sigma_m > query.max_sigma_m) {
    root.fail("panoptic.query.min_sigma_m <= initial_sigma_m <= max_sigma_m",
              text_of(query.min_sigma_m) + ", " + text_of(query.initial_sigma_m) + ", " +
                  text_of(query.max_sigma_m));
  }
  const PixelSamplingConfig& sampling = config.panoptic.sampling;
  if (sampling.stuff_share + sampling.instance_share > 1.0) {
    root.fail("panoptic.sampling.stuff_share + instance_share <= 1",
              text_of(sampling.stuff_share + sampling.instance_share));
  }
}

TrainingConfig config_of(const ConfigNode& root) {
  TrainingConfig config;
  if (!root.is_map()) root.fail("a map with the keys geometry, panoptic, joint", "none");
  FieldReader reader(root);
  internal::visit_fields(config, reader);
  reader.finish();
  check_order(root, config);
  return config;
}

}  // namespace

PanopticTrainingConfig short_panoptic_config() {
  PanopticTrainingConfig config;
  config.iterations = 600;
  config.sampling.pixels = 8192;
  config.rate.scale = 3.0;
  return config;
}

TrainingConfig read_training_config(const std::filesystem::path& file) {
  return config_of(ConfigNode::load(file));
}

TrainingConfig parse_training_config(const std::string& text, const std::string& origin) {
  return config_of(ConfigNode::parse(text, origin));
}

std::string training_config_text(const TrainingConfig& config) {
  FieldWriter writer;
  TrainingConfig copy = config;
  internal::visit_fields(copy, writer);
  return writer.text();
}

}  // namespace segsim::reconstruction
