#include "ros/type_description.h"

#include <algorithm>
#include <utility>

#include "core/file_io.h"

namespace segsim::ros {
namespace {

/// The JSON that is hashed: as Python writes it, with a blank after "," and ":".
std::string json_of(const FieldDescription& field) {
  return R"({"name": ")" + field.name + R"(", "type": {"type_id": )" +
         std::to_string(field.type_id) + R"(, "capacity": )" + std::to_string(field.capacity) +
         R"(, "string_capacity": )" + std::to_string(field.string_capacity) +
         R"(, "nested_type_name": ")" + field.message + R"("}})";
}

std::string json_of(const TypeDescription& type) {
  std::string json = R"({"type_name": ")" + type.full_name() + R"(", "fields": [)";
  for (const FieldDescription& field : type.fields) {
    if (&field != &type.fields.front()) json += ", ";
    json += json_of(field);
  }
  return json + "]}";
}

std::string fields_text(const TypeDescription& type) {
  std::string text;
  for (const FieldDescription& field : type.fields)
    text += field.text + " " + field.name + "\n";
  return text;
}

}  // namespace

std::string ros2msg_text(const TypeClosure& closure) {
  std::string text = fields_text(closure.type);
  for (const TypeDescription& type : closure.referenced) {
    text += std::string(80, '=') + "\nMSG: " + type.package + "/" + type.name + "\n" +
            fields_text(type);
  }
  return text;
}

std::string rihs01(const TypeClosure& closure) {
  std::string json = R"({"type_description": )" + json_of(closure.type) +
                     R"(, "referenced_type_descriptions": [)";
  for (const TypeDescription& type : closure.referenced) {
    if (&type != &closure.referenced.front()) json += ", ";
    json += json_of(type);
  }
  return "RIHS01_" + core::sha256_hex(json + "]}");
}

namespace internal {

void TypeCollector::refer(TypeDescription type) { referenced_.push_back(std::move(type)); }

std::vector<TypeDescription> TypeCollector::take_referenced() {
  std::sort(referenced_.begin(), referenced_.end(),
            [](const TypeDescription& a, const TypeDescription& b) {
              return a.full_name() < b.full_name();
            });
  const auto same = [](const TypeDescription& a, const TypeDescription& b) {
    return a.full_name() == b.full_name();
  };
  referenced_.erase(std::unique(referenced_.begin(), referenced_.end(), same),
                    referenced_.end());
  return std::exchange(referenced_, {});
}

}  // namespace internal
}  // namespace segsim::ros
