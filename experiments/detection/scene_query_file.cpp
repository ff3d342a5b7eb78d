// Answers of a scene query in words and as JSON.
#include <ostream>

#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/detection/scene_query.h"
#include "perception/data/json_node.h"

namespace segsim::experiments::detection {
namespace {

using perception::Json;
using perception::JsonNode;

constexpr const char* kSchema = "segsim.scene_query/1";
constexpr double kFarthest = 1e7;

QueriedInstance instance_from(const JsonNode& node, std::size_t phrases) {
  QueriedInstance instance;
  instance.id = static_cast<std::uint16_t>(node.at("id").integer(1, 65535));
  instance.name = node.at("name").text();
  instance.class_name = node.at("class").text();
  const std::vector<JsonNode> centre = node.at("centre_m").items();
  if (centre.size() != 3) node.at("centre_m").fail("3 numbers");
  for (int k = 0; k < 3; ++k) {
    instance.centre_m[k] =
        centre[static_cast<std::size_t>(k)].number(-kFarthest, kFarthest, "a coordinate");
  }
  instance.views = static_cast<int>(node.at("views").integer(0, 1000));
  for (const JsonNode& score : node.at("scores").items()) {
    instance.scores.push_back(score.number(-kFarthest, kFarthest, "a score"));
  }
  if (instance.scores.size() != (instance.views > 0 ? phrases : 0)) {
    node.at("scores").fail("one score for each phrase, and none without a view");
  }
  return instance;
}

}  // namespace

std::string query_text(const std::vector<QueriedInstance>& instances,
                       const std::vector<std::string>& phrases, int most) {
  std::string text;
  for (std::size_t p = 0; p < phrases.size(); ++p) {
    text += "\n" + phrases[p] +
            core::print("\n%8s  %5s  %-28s %-16s %7s %7s %7s\n", "score", "id", "name",
                        "class", "x [m]", "y [m]", "z [m]");
    int printed = 0;
    for (const std::size_t i : ranking(instances, p)) {
      if (printed++ == most) break;
      const QueriedInstance& q = instances[i];
      text += core::print("%8.4f  %5d  %-28s %-16s %7.2f %7.2f %7.2f\n", q.scores[p], q.id,
                          q.name.c_str(), q.class_name.c_str(), q.centre_m.x, q.centre_m.y,
                          q.centre_m.z);
    }
  }
  return text;
}

void write_query(const std::filesystem::path& file, const SceneQuery& query) {
  Json all = Json::array();
  for (const QueriedInstance& q : query.instances) {
    all.push_back({{"id", q.id},
                   {"name", q.name},
                   {"class", q.class_name},
                   {"centre_m", {q.centre_m.x, q.centre_m.y, q.centre_m.z}},
                   {"views", q.views},
                   {"scores", q.scores}});
  }
  const Json json{{"schema", kSchema},
                  {"model", query.model},
                  {"phrases", query.phrases},
                  {"instances", all}};
  core::write_file_atomically(file, [&](std::ostream& out) { out << json.dump(1) << "\n"; });
}

SceneQuery read_query(const std::filesystem::path& file) {
  const Json json = perception::parse_json(core::read_file(file), file.string());
  const JsonNode node(json, file.string());
  if (node.at("schema").text() != kSchema) node.at("schema").fail(kSchema);
  SceneQuery query;
  query.model = node.at("model").text();
  for (const JsonNode& phrase : node.at("phrases").items()) {
    query.phrases.push_back(phrase.text());
  }
  for (const JsonNode& instance : node.at("instances").items()) {
    query.instances.push_back(instance_from(instance, query.phrases.size()));
  }
  return query;
}

}  // namespace segsim::experiments::detection
