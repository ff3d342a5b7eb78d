#include "experiments/scene_labels/internal/label_json.h"

#include <charconv>
#include <cmath>
#include <cstdio>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/quantile.h"
#include "experiments/drawing/frame_picture.h"

namespace segsim::experiments::scene_labels::internal {
namespace {

using core::InputError;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMostSeeds = 32;

std::string text_of(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string css_color(const core::Rgb8& color) {
  char text[8];
  std::snprintf(text, sizeof text, "#%02x%02x%02x", color.r, color.g, color.b);
  return text;
}

Json json_of(const glm::dvec3& p_m) { return {p_m.x, p_m.y, p_m.z}; }

Json json_of(const FreeCamera& camera) {
  return {{"x", camera.p_m.x},
          {"y", camera.p_m.y},
          {"z", camera.p_m.z},
          {"yaw", camera.yaw_rad},
          {"pitch", camera.pitch_down_rad}};
}

Json optional_text(const std::optional<std::string>& text) {
  return text ? Json(*text) : Json();
}

/// In the middle of the surfels, at the height of the capture's camera.
FreeCamera middle_of(const LabelEditor& editor) {
  const std::vector<glm::vec3>& positions_m = editor.cloud().position_m;
  FreeCamera camera;
  if (positions_m.empty()) return camera;
  for (int axis = 0; axis < 2; ++axis) {
    std::vector<float> values;
    values.reserve(positions_m.size());
    for (const glm::vec3& p : positions_m) values.push_back(p[axis]);
    camera.p_m[axis] = core::quantile(values, 0.5, core::Between::kNearest);
  }
  if (editor.bundle().manifest.camera_height_m > 0.0) {
    camera.p_m.z = editor.bundle().manifest.camera_height_m;
  }
  return camera;
}

std::string text_in(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_string()) {
    throw InputError::expected(key, "a text", found == json.end() ? "none" : found->dump());
  }
  return *found;
}

double number_in(const Json& json, const char* key, double otherwise) {
  const auto found = json.find(key);
  if (found == json.end()) return otherwise;
  if (!found->is_number()) throw InputError::expected(key, "a number", found->dump());
  return *found;
}

std::uint16_t instance_in(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number_integer() || *found < 1 || *found > 65535) {
    throw InputError::expected(key, "an instance, 1 to 65535",
                               found == json.end() ? "none" : found->dump());
  }
  return *found;
}

std::vector<Seed> seeds_in(const Json& json) {
  const auto found = json.find("seeds");
  std::vector<Seed> seeds;
  const auto fail = [&] {
    throw InputError::expected(
        "seeds", "[[part, x, y, z], ...], " + std::to_string(kMostSeeds) + " at most",
        found == json.end() ? "none" : found->dump());
  };
  if (found == json.end() || !found->is_array() || found->size() > kMostSeeds) fail();
  for (const Json& seed : *found) {
    if (!seed.is_array() || seed.size() != 4 || !seed[0].is_number_integer() || seed[0] < 0 ||
        seed[0] >= kMostSeeds || !seed[1].is_number() || !seed[2].is_number() ||
        !seed[3].is_number()) {
      fail();
    }
    seeds.push_back({{seed[1], seed[2], seed[3]}, seed[0]});
  }
  return seeds;
}

LabelEdit edit_of(const LabelEditor& editor, const std::string& what, const Json& json) {
  const LabelState& state = editor.state();
  const renderer::SurfelCloud& surfels = editor.cloud();
  const std::uint16_t instance = instance_in(json, "instance");
  if (what == "rename") {
    NamedClass to{text_in(json, "class"), true};
    if (const auto thing = json.find("thing"); thing != json.end()) {
      if (!thing->is_boolean()) {
        throw InputError::expected("thing", "true or false", thing->dump());
      }
      to.thing = *thing;
    }
    return rename_instance(state, surfels, instance, to,
                           json.contains("name") ? text_in(json, "name") : std::string());
  }
  if (what == "merge") {
    return merge_instances(state, surfels, instance, instance_in(json, "into"));
  }
  if (what == "delete") return delete_instance(state, instance);
  const double gap_m = number_in(json, "gap_m", kDefaultGap_m);
  if (what == "pieces") return split_into_pieces(state, surfels, instance, gap_m);
  if (what == "cut") {
    return split_at_seeds(state, surfels, instance, seeds_in(json), gap_m);
  }
  throw InputError::expected("do", "rename, merge, pieces, cut, delete, undo or redo",
                             "\"" + what + "\"");
}

}  // namespace

std::string scene_json(const LabelEditor& editor, const std::string& said) {
  const LabelState& state = editor.state();
  std::map<std::uint16_t, std::size_t> surfels_of;
  std::size_t of_void = 0;
  for (std::size_t i = 0; i < state.instance_ids().size(); ++i) {
    ++surfels_of[state.instance_ids()[i]];
    of_void += state.class_ids()[i] == 0 ? 1 : 0;
  }
  Json json{{"name", editor.bundle().manifest.name},
            {"folder", editor.bundle().folder.string()},
            {"revision", editor.revision()},
            {"surfels", state.instance_ids().size()},
            {"void_surfels", of_void},
            {"distributions", !editor.parts().labels.name.empty()},
            {"edits", editor.edit_count()},
            {"undo", optional_text(editor.undoable())},
            {"redo", optional_text(editor.redoable())},
            {"said", said},
            {"gap_m", kDefaultGap_m},
            {"classes", Json::array()},
            {"instances", Json::array()}};
  for (const core::SceneClass& c : state.classes()) {
    json["classes"].push_back({{"id", c.id},
                               {"name", c.name},
                               {"thing", c.thing},
                               {"color", css_color(drawing::id_color(c.id))}});
  }
  for (const auto& [id, count] : surfels_of) {
    if (id == 0) continue;
    const core::SceneInstance* row = state.find_instance(id);
    json["instances"].push_back(
        {{"id", id},
         {"class", row == nullptr ? 0 : row->class_id},
         {"name", row == nullptr ? "unnamed " + std::to_string(id) : row->name},
         {"surfels", count}});
    if (row == nullptr) continue;
    json["instances"].back()["low"] = json_of(row->box_min_m);
    json["instances"].back()["high"] = json_of(row->box_max_m);
  }
  return text_of(json);
}

std::string cameras_json(const core::CameraPath& cameras, const LabelEditor& editor) {
  Json json{{"cameras", Json::array()}, {"start", json_of(middle_of(editor))}};
  for (const core::CameraPath::View& view : cameras.views) {
    Json camera = json_of(free_camera(view.T_world_camera));
    camera["frame"] = view.frame;
    json["cameras"].push_back(std::move(camera));
  }
  return text_of(json);
}

std::string picked_json(const PickedPixel& picked) {
  return text_of({{"instance", picked.instance_id},
                  {"class", picked.class_id},
                  {"p_m", picked.p_m ? json_of(*picked.p_m) : Json()}});
}

double query_number(const std::map<std::string, std::string>& query, const std::string& key) {
  const auto found = query.find(key);
  const std::string text = found == query.end() ? "" : found->second;
  double value = 0.0;
  const auto [at, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || at != text.data() + text.size() || !(std::abs(value) < 1e6)) {
    throw InputError::expected(key, "a number within a million",
                               text.empty() ? "none" : "\"" + text + "\"");
  }
  return value;
}

ViewRequest view_of(const std::map<std::string, std::string>& query) {
  ViewRequest view;
  view.width_px = static_cast<int>(query_number(query, "width"));
  if (query.contains("camera")) {
    const double camera = query_number(query, "camera");
    if (camera < 0.0) throw InputError::expected("camera", "0 or more", "less");
    view.camera = static_cast<std::size_t>(camera);
    return view;
  }
  view.free.p_m = {query_number(query, "x"), query_number(query, "y"),
                   query_number(query, "z")};
  view.free.yaw_rad = query_number(query, "yaw");
  view.free.pitch_down_rad = query_number(query, "pitch");
  return view;
}

std::string do_edit(LabelEditor& editor, const std::string& body) {
  const Json json = Json::parse(body, nullptr, false);
  if (!json.is_object()) {
    throw InputError::expected("body", "a JSON object", json.is_discarded() ? "none" : body);
  }
  const auto revision = json.find("revision");
  if (revision == json.end() || !revision->is_number_unsigned()) {
    throw InputError::expected("revision", "the revision that the page shows", "none");
  }
  if (revision->get<std::uint64_t>() != editor.revision()) throw StaleRevision();
  const std::string what = text_in(json, "do");
  if (what == "undo") return "Undone: " + editor.undo();
  if (what == "redo") return "Redone: " + editor.redo();
  return editor.apply(edit_of(editor, what, json));
}

}  // namespace segsim::experiments::scene_labels::internal
