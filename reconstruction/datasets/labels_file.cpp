#include "reconstruction/datasets/labels_file.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <set>

#include "core/config.h"

namespace segsim::reconstruction {
namespace {

using core::ConfigNode;

std::uint16_t read_new_id(const ConfigNode& entry, std::set<std::uint16_t>& used) {
  const std::int64_t id = entry.integer("id");
  if (id < 1 || id > 65535) entry.child("id").fail("an id in [1, 65535]", std::to_string(id));
  if (!used.insert(static_cast<std::uint16_t>(id)).second) {
    entry.child("id").fail("an id that is not used above", std::to_string(id));
  }
  return static_cast<std::uint16_t>(id);
}

/// `word` is a class id or a class name.
std::uint16_t find_class(const ConfigNode& node,
                         const std::vector<core::SceneClass>& classes) {
  const std::string word = node.as_text();
  int id = -1;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), id);
  const bool is_id = error == std::errc{} && end == word.data() + word.size();
  for (const core::SceneClass& entry : classes) {
    if (is_id ? entry.id == id : entry.name == word) return entry.id;
  }
  node.fail("a class listed under classes", "'" + word + "'");
}

/// `iscrowd` of an instance: a crowd is of things.
bool read_crowd(const ConfigNode& entry, std::uint16_t class_id,
                const std::vector<core::SceneClass>& classes) {
  if (!entry.boolean_or("iscrowd", false)) return false;
  const bool thing =
      std::any_of(classes.begin(), classes.end(),
                  [&](const core::SceneClass& c) { return c.id == class_id && c.thing; });
  if (!thing) entry.child("iscrowd").fail("false for stuff", "true");
  return true;
}

constexpr auto kById = [](const auto& a, const auto& b) { return a.id < b.id; };

}  // namespace

void expect_schema(const ConfigNode& root, const std::string& name, std::int64_t version) {
  if (const std::string schema = root.text("schema"); schema != name) {
    root.child("schema").fail(name, "'" + schema + "'");
  }
  if (const std::int64_t found = root.integer("version"); found != version) {
    root.child("version").fail(std::to_string(version), std::to_string(found));
  }
}

std::vector<core::SceneClass> read_scene_classes(const ConfigNode& root) {
  std::vector<core::SceneClass> classes;
  std::set<std::uint16_t> used;
  for (const ConfigNode& entry : root.list("classes")) {
    core::SceneClass scene_class;
    scene_class.id = read_new_id(entry, used);
    scene_class.name = entry.text("name");
    scene_class.thing = entry.boolean_or("thing", false);
    (void)entry.boolean_or("evaluated", true);  // For metrics; label_map.h reads it.
    entry.finish();
    classes.push_back(std::move(scene_class));
  }
  std::sort(classes.begin(), classes.end(), kById);
  return classes;
}

SequenceLabels read_sequence_labels(const std::filesystem::path& file) {
  const ConfigNode root = ConfigNode::load(file);
  expect_schema(root, "segsim.labels", 1);
  SequenceLabels labels;
  labels.pixel_center = root.number("pixel_center");
  if (labels.pixel_center != 0.0 && labels.pixel_center != 0.5) {
    root.child("pixel_center").fail("0 or 0.5", std::to_string(labels.pixel_center));
  }
  labels.up = parse_up_axis(root.text("up"), root.child("up").where());
  if (labels.up == UpAxis::kAuto) root.child("up").fail("y or z", "'auto'");
  labels.source = root.text_or("source", "");

  labels.classes = read_scene_classes(root);
  std::set<std::uint16_t> instance_ids;
  for (const ConfigNode& entry : root.list("instances")) {
    core::SceneInstance instance;
    instance.id = read_new_id(entry, instance_ids);
    instance.class_id = find_class(entry.child("class"), labels.classes);
    instance.name = entry.text_or("name", "");
    if (read_crowd(entry, instance.class_id, labels.classes)) {
      labels.crowds.push_back(instance.id);
    }
    entry.finish();
    labels.instances.push_back(std::move(instance));
  }
  root.finish();
  std::sort(labels.instances.begin(), labels.instances.end(), kById);
  std::sort(labels.crowds.begin(), labels.crowds.end());
  return labels;
}

}  // namespace segsim::reconstruction
