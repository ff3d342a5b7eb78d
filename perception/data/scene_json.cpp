#include "perception/data/scene_json.h"

#include <limits>

namespace segsim::perception {

std::string read_sha256(const JsonNode& node) {
  constexpr std::size_t kDigits = 64;
  std::string text = node.text();
  if (text.size() != kDigits ||
      text.find_first_not_of("0123456789abcdef") != std::string::npos) {
    node.fail("a SHA-256 in 64 hexadecimal digits");
  }
  return text;
}

std::vector<ImagedScene> read_scenes(const JsonNode& node) {
  constexpr std::int64_t kMaxSeed = std::numeric_limits<std::int64_t>::max();
  std::vector<ImagedScene> scenes;
  for (const JsonNode& item : node.items()) {
    ImagedScene scene;
    if (item.has("generator")) {
      scene.generator = item.at("generator").text();
      const std::int64_t first = item.at("first_seed").integer(0, kMaxSeed);
      scene.first_seed = static_cast<std::uint64_t>(first);
      scene.last_seed =
          static_cast<std::uint64_t>(item.at("last_seed").integer(first, kMaxSeed));
    } else {
      scene.name = item.at("name").text();
      scene.surfels_sha256 = read_sha256(item.at("surfels_sha256"));
    }
    scenes.push_back(std::move(scene));
  }
  return scenes;
}

Json scenes_json(const std::vector<ImagedScene>& scenes) {
  Json list = Json::array();
  for (const ImagedScene& scene : scenes) {
    if (scene.generator.empty()) {
      list.push_back({{"name", scene.name}, {"surfels_sha256", scene.surfels_sha256}});
    } else {
      list.push_back({{"generator", scene.generator},
                      {"first_seed", scene.first_seed},
                      {"last_seed", scene.last_seed}});
    }
  }
  return list;
}

}  // namespace segsim::perception
