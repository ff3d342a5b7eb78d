#include "perception/models/model_description.h"

#include <algorithm>

#include "core/config.h"
#include "core/error.h"

namespace segsim::perception {
namespace {

namespace fs = std::filesystem;
using core::ConfigNode;

constexpr std::pair<const char*, ModelTask> kTasks[] = {
    {"yolo", ModelTask::kYolo},     {"grounding-dino", ModelTask::kGroundingDino},
    {"sam", ModelTask::kSam},       {"clip", ModelTask::kClip},
    {"siglip", ModelTask::kSiglip}, {"itm", ModelTask::kItm},
    {"depth", ModelTask::kDepth}};

ModelTask read_task(const ConfigNode& node) {
  const std::string word = node.text("task");
  for (const auto& [name, task] : kTasks) {
    if (word == name) return task;
  }
  node.child("task").fail("yolo | grounding-dino | sam | clip | siglip | itm | depth",
                          "\"" + word + "\"");
}

int read_side(const ConfigNode& node) {
  const std::int64_t side = node.as_integer();
  constexpr std::int64_t kMost = 8192;
  if (side < 1 || side > kMost) node.fail("a side from 1 to 8192 px", std::to_string(side));
  return static_cast<int>(side);
}

void read_input_size(const ConfigNode& node, ModelDescription& description) {
  const auto size = node.optional_child("input_px");
  if (!size) return;
  if (size->is_list()) {
    const auto sides = size->as_list();
    if (sides.size() != 2)
      size->fail("[height, width]", std::to_string(sides.size()) + " sides");
    description.height_px = read_side(sides[0]);
    description.width_px = read_side(sides[1]);
  } else {
    description.height_px = description.width_px = read_side(*size);
  }
}

std::optional<float> read_share(const ConfigNode& node, const std::string& key) {
  if (!node.has(key)) return std::nullopt;
  const double value = node.number(key);
  if (!(value >= 0.0 && value <= 1.0))
    node.child(key).fail("a number in [0, 1]", node.text(key));
  return static_cast<float>(value);
}

std::optional<float> read_number(const ConfigNode& node, const std::string& key) {
  if (!node.has(key)) return std::nullopt;
  return static_cast<float>(node.number(key));
}

}  // namespace

const fs::path& ModelDescription::file(const std::string& role) const {
  const auto found = files.find(role);
  if (found == files.end()) {
    throw core::InputError::expected(place, "files: " + role, "none");
  }
  return found->second;
}

ModelDescription read_model_description(const fs::path& file) {
  ModelDescription description;
  description.place = file.string();
  if (file.extension() != ".yaml" && file.extension() != ".yml") {
    description.files["model"] = file;
    return description;
  }
  const ConfigNode node = ConfigNode::load(file);
  if (node.text("schema") != "segsim.model/1") {
    node.child("schema").fail("segsim.model/1", node.text("schema"));
  }
  description.task = read_task(node);
  const ConfigNode files = node.child("files");
  for (const char* role : {"model", "encoder", "decoder", "image", "text", "tokenizer"}) {
    if (files.has(role)) description.files[role] = file.parent_path() / files.text(role);
  }
  files.finish();
  read_input_size(node, description);
  if (node.has("class_names")) description.class_names = node.texts("class_names");
  description.score_threshold = read_share(node, "score_threshold");
  description.text_threshold = read_share(node, "text_threshold");
  description.nms_iou = read_share(node, "nms_iou");
  description.logit_scale = read_number(node, "logit_scale");
  description.logit_bias = read_number(node, "logit_bias");
  if (node.has("colours")) {
    description.centred_colours = core::choice(node, "colours", {"imagenet", "centred"}) == 1;
  }
  node.finish();
  return description;
}

}  // namespace segsim::perception
