#include "experiments/suites/suite.h"

#include <algorithm>

#include "core/config.h"
#include "core/error.h"
#include "core/file_io.h"
#include "experiments/suites/layered_yaml.h"
#include "experiments/support/listed.h"
#include "experiments/support/shipped_file.h"

namespace segsim::experiments::suites {
namespace {

namespace fs = std::filesystem;
using core::ConfigNode;

constexpr const char* kFolder = "experiments/suites";
constexpr const char* kSpecSchema = "segsim.experiment/1";

/// Lines "  - {...}" of the key `scenes`: what all scenes have, what those of the pool have,
/// the scene itself.
std::string scene_lines(const ConfigNode& root) {
  const std::optional<ConfigNode> all = root.optional_child("scene");
  std::string lines;
  for (const ConfigNode& pool : root.child("pools").as_list()) {
    const std::string name = pool.text("name");
    const std::optional<ConfigNode> common = pool.optional_child("scene");
    const std::vector<ConfigNode> scenes = pool.child("scenes").as_list();
    if (scenes.empty()) pool.child("scenes").fail("at least one scene", "none");
    for (const ConfigNode& scene : scenes) {
      if (scene.has("pool")) scene.child("pool").fail("none: its pool has it", "pool");
      std::vector<ConfigNode> layers;
      for (const std::optional<ConfigNode>& layer : {all, common}) {
        if (layer) layers.push_back(*layer);
      }
      layers.push_back(scene);
      lines +=
          "  - " + flow_yaml(layers, {{"name", scene.text("name")}, {"pool", name}}) + "\n";
    }
    pool.finish();
  }
  if (lines.empty()) root.child("pools").fail("at least one pool", "none");
  return lines;
}

std::string experiment_lines(const ConfigNode& experiment) {
  std::string lines;
  for (const std::string& key : experiment.keys()) {
    for (const char* own : {"schema", "name", "title", "scenes"}) {
      if (key == own) experiment.child(key).fail("none: the suite has it", key);
    }
    if (!experiment.has(key)) continue;
    const ConfigNode value = experiment.child(key);
    if (!value.is_list()) {
      lines += key + ": " + flow_yaml({value}) + "\n";
      continue;
    }
    lines += key + ":\n";
    for (const ConfigNode& element : value.as_list()) {
      lines += "  - " + flow_yaml({element}) + "\n";
    }
  }
  return lines;
}

/// For people: what the spec says of its scenes and arms.
void read_back(Suite& suite) {
  const ConfigNode root = ConfigNode::parse(suite.spec_text, suite.spec_origin().string());
  for (const ConfigNode& node : root.child("scenes").as_list()) {
    SuiteScene scene;
    scene.name = node.text("name");
    scene.title = node.text_or("title", scene.name);
    scene.pool = node.text("pool");
    const std::optional<ConfigNode> source = node.optional_child("source");
    scene.source = source ? source->text("type") : "bundle";
    scene.episodes = node.integer_or("episodes", 0);
    suite.scenes.push_back(std::move(scene));
  }
  for (const ConfigNode& arm : root.list("arms")) suite.arms.push_back(arm.text("name"));
}

std::vector<std::string> names_of(const std::vector<fs::path>& files) {
  std::vector<std::string> names;
  names.reserve(files.size());
  for (const fs::path& file : files) names.push_back(file.stem().string());
  return names;
}

bool is_file_name(const std::string& word) {
  return word.find('/') != std::string::npos || fs::path(word).extension() == ".yaml";
}

}  // namespace

std::string Suite::sha256() const { return core::sha256_hex(spec_text); }

fs::path Suite::spec_origin() const {
  return file.parent_path() / (file.stem().string() + ".spec.yaml");
}

std::vector<fs::path> shipped_suites() {
  std::vector<fs::path> files;
  std::error_code none;
  for (const fs::directory_entry& entry :
       fs::directory_iterator(support::find_shipped(kFolder), none)) {
    if (entry.path().extension() == ".yaml") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

Suite parse_suite(const std::string& text, const fs::path& file) {
  const ConfigNode root = ConfigNode::parse(text, file.string());
  (void)core::choice(root, "schema", {Suite::kSchema});
  Suite suite;
  suite.file = file;
  suite.name = root.text("name");
  if (suite.name != file.stem().string()) {
    root.child("name").fail("the name of the file, " + file.stem().string(), suite.name);
  }
  suite.title = root.text("title");
  suite.about = root.text("about");
  suite.data = root.text_or("data", "");
  suite.spec_text = "schema: " + std::string(kSpecSchema) + "\nname: " + suite.name +
                    "\ntitle: " + yaml_scalar(suite.title) + "\nscenes:\n" +
                    scene_lines(root) + experiment_lines(root.child("experiment"));
  root.finish();
  read_back(suite);
  return suite;
}

Suite load_suite(const std::string& word) {
  fs::path file = word;
  if (!is_file_name(word)) {
    const std::vector<fs::path> files = shipped_suites();
    const std::vector<std::string> names = names_of(files);
    const auto found = std::find(names.begin(), names.end(), word);
    if (found == names.end()) {
      const std::string near = core::nearest_word(word, names);
      throw core::InputError::expected(
          "suite",
          (names.empty() ? "" : "one of " + support::listed(names) + ", or ") +
              std::string("a file (.yaml)"),
          "\"" + word + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
    }
    file = files[static_cast<std::size_t>(found - names.begin())];
  }
  return parse_suite(core::read_file(file), file);
}

}  // namespace segsim::experiments::suites
