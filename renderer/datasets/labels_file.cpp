#include "renderer/datasets/labels_file.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <set>

#include "core/config.h"

namespace segsim::renderer {
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

void read_schema(const ConfigNode& root) {
  if (const std::string schema = root.text("schema"); schema != "segsim.labels") {
    root.child("schema").fail("segsim.labels", "'" + schema + "'");
  }
  if (const std::int64_t version = root.integer("version"); version != 1) {
    root.child("version").fail("1", std::to_string(version));
  }
}

}  // namespace

SequenceLabels read_sequence_labels(const std::filesystem::path& file) {
  const ConfigNode root = ConfigNode::load(file);
  read_schema(root);
  SequenceLabels labels;
  labels.pixel_center = root.number("pixel_center");
  if (labels.pixel_center != 0.0 && labels.pixel_center != 0.5) {
    root.child("pixel_center").fail("0 or 0.5", std::to_string(labels.pixel_center));
  }
  labels.up = parse_up_axis(root.text("up"), root.child("up").where());
  if (labels.up == UpAxis::kAuto) root.child("up").fail("y or z", "'auto'");
  labels.source = root.text_or("source", "");

  std::set<std::uint16_t> class_ids, instance_ids;
  for (const ConfigNode& entry : root.list("classes")) {
    core::SceneClass scene_class;
    scene_class.id = read_new_id(entry, class_ids);
    scene_class.name = entry.text("name");
    scene_class.thing = entry.boolean_or("thing", false);
    entry.finish();
    labels.classes.push_back(std::move(scene_class));
  }
  for (const ConfigNode& entry : root.list("instances")) {
    core::SceneInstance instance;
    instance.id = read_new_id(entry, instance_ids);
    instance.class_id = find_class(entry.child("class"), labels.classes);
    instance.name = entry.text_or("name", "");
    entry.finish();
    labels.instances.push_back(std::move(instance));
  }
  root.finish();
  const auto by_id = [](const auto& a, const auto& b) { return a.id < b.id; };
  std::sort(labels.classes.begin(), labels.classes.end(), by_id);
  std::sort(labels.instances.begin(), labels.instances.end(), by_id);
  return labels;
}

}  // namespace segsim::renderer
