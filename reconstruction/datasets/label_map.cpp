#include "reconstruction/datasets/label_map.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <set>
#include <sstream>

#include "core/config.h"
#include "core/file_io.h"
#include "reconstruction/datasets/internal/json_file.h"
#include "reconstruction/datasets/labels_file.h"

namespace segsim::reconstruction {
namespace {

using core::ConfigNode;
using core::InputError;

struct NyuClass {
  std::uint16_t id;
  const char* name;
};

/// ScanNet's benchmark classes under their NYU40 ids; "couch" is COCO's word for sofa.
constexpr std::array<NyuClass, 20> kNyuClasses{
    {{1, "wall"},    {2, "floor"},      {3, "cabinet"},       {4, "bed"},
     {5, "chair"},   {6, "couch"},      {7, "table"},         {8, "door"},
     {9, "window"},  {10, "bookshelf"}, {11, "picture"},      {12, "counter"},
     {14, "desk"},   {16, "curtain"},   {24, "refrigerator"}, {28, "shower curtain"},
     {33, "toilet"}, {34, "sink"},      {36, "bathtub"},      {39, "other furniture"}}};

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream text(line);
  for (std::string cell; std::getline(text, cell, '\t');) cells.push_back(cell);
  return cells;
}

std::uint16_t id_of(const std::string& cell, const std::string& place) {
  int id = -1;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), id);
  if (error != std::errc{} || end != cell.data() + cell.size() || id < 0 || id > 65535) {
    throw InputError::expected(place, "an id in [0, 65535]", "'" + cell + "'");
  }
  return static_cast<std::uint16_t>(id);
}

std::size_t column_of(const std::vector<std::string>& header, const std::string& name,
                      const std::string& place) {
  const auto found = std::find(header.begin(), header.end(), name);
  if (found == header.end()) {
    throw InputError::expected(place, "a column " + name,
                               std::to_string(header.size()) + " columns without it");
  }
  return static_cast<std::size_t>(found - header.begin());
}

std::uint16_t read_id(const ConfigNode& node, const std::set<std::uint16_t>* known) {
  const std::int64_t id = node.as_integer();
  if (id < 0 || id > 65535) node.fail("an id in [0, 65535]", std::to_string(id));
  if (known != nullptr && id != 0 && !known->contains(static_cast<std::uint16_t>(id))) {
    node.fail("0 or a class listed under classes", std::to_string(id));
  }
  return static_cast<std::uint16_t>(id);
}

}  // namespace

std::uint16_t LabelMap::class_of(std::uint16_t source_id) const {
  if (!ids.empty()) {
    const auto found = ids.find(source_id);
    return found == ids.end() ? std::uint16_t{0} : found->second;
  }
  const bool known =
      std::any_of(classes.begin(), classes.end(),
                  [source_id](const core::SceneClass& c) { return c.id == source_id; });
  return known ? source_id : std::uint16_t{0};
}

std::vector<core::SceneClass> LabelMap::evaluated() const {
  std::vector<core::SceneClass> result = classes;
  std::erase_if(result, [this](const core::SceneClass& c) {
    return std::find(not_evaluated.begin(), not_evaluated.end(), c.id) != not_evaluated.end();
  });
  return result;
}

LabelMap read_label_map(const std::filesystem::path& file) {
  const ConfigNode root = ConfigNode::load(file);
  expect_schema(root, "segsim.label_map", 1);
  LabelMap map;
  for (const ConfigNode& entry : root.list("classes")) {
    if (!entry.boolean_or("evaluated", true)) {
      map.not_evaluated.push_back(read_id(entry.child("id"), nullptr));
    }
  }
  map.classes = read_scene_classes(root);
  std::set<std::uint16_t> known;
  for (const core::SceneClass& c : map.classes) known.insert(c.id);
  for (const ConfigNode& entry : root.list("ids")) {
    const std::uint16_t to = read_id(entry.child("to"), &known);
    for (const ConfigNode& from : entry.child("from").as_list()) {
      if (!map.ids.emplace(read_id(from, nullptr), to).second) {
        from.fail("an id that is not mapped above", from.as_text());
      }
    }
    entry.finish();
  }
  root.finish();
  return map;
}

LabelMap read_scannet_table(const std::filesystem::path& file) {
  std::istringstream text(core::read_file(file));
  std::string line;
  std::getline(text, line);
  if (!line.empty() && line.back() == '\r') line.pop_back();
  const std::vector<std::string> header = cells_of(line);
  const std::size_t id_column = column_of(header, "id", file.string() + ":1");
  const std::size_t nyu_column = column_of(header, "nyu40id", file.string() + ":1");

  LabelMap map;
  std::set<std::uint16_t> wanted;
  for (const NyuClass& c : kNyuClasses) {
    map.classes.push_back({c.id, c.name, c.id > 2});
    wanted.insert(c.id);
  }
  for (int number = 2; std::getline(text, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty()) continue;
    const std::string place = file.string() + ":" + std::to_string(number);
    const std::vector<std::string> cells = cells_of(line);
    if (cells.size() <= std::max(id_column, nyu_column)) {
      throw InputError::expected(place, std::to_string(header.size()) + " columns",
                                 std::to_string(cells.size()));
    }
    if (cells[nyu_column].empty()) continue;  // No NYU40 class: void.
    const std::uint16_t nyu = id_of(cells[nyu_column], place);
    if (wanted.contains(nyu)) map.ids[id_of(cells[id_column], place)] = nyu;
  }
  return map;
}

LabelMap read_replica_classes(const std::filesystem::path& file) {
  static const std::set<std::string> kStuff{"wall", "floor", "ceiling"};
  const internal::JsonNode list = internal::JsonNode::load(file).child("classes");
  LabelMap map;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const internal::JsonNode entry = list.at(i);
    const std::int64_t id = entry.child("id").as_integer(0, 65535);
    if (id == 0) continue;
    const std::string name = entry.text("name");
    map.classes.push_back({static_cast<std::uint16_t>(id), name, !kStuff.contains(name)});
  }
  std::sort(map.classes.begin(), map.classes.end(),
            [](const auto& a, const auto& b) { return a.id < b.id; });
  return map;
}

}  // namespace segsim::reconstruction
