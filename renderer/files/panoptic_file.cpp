#include <string>

#include "core/check.h"
#include "core/error.h"
#include "renderer/files/internal/checked_file.h"
#include "renderer/scene/panoptic_field.h"

namespace segsim::renderer {
namespace {

using core::InputError;
using internal::ByteReader;

constexpr std::string_view kMagic = "SEGSIMPF";
constexpr std::uint32_t kVersion = 2;

std::string payload_of(const PanopticModel& model) {
  internal::ByteWriter out;
  out.put(model.temperature);
  out.put(static_cast<std::uint32_t>(model.classes.size()));
  out.put(static_cast<std::uint32_t>(model.queries.size()));
  out.put(static_cast<std::uint32_t>(model.variant));
  out.put(model.none_score);
  for (const PanopticClass& c : model.classes) {
    out.put(c.id);
    out.put(static_cast<std::uint16_t>(c.thing ? 1 : 0));
    out.put(c.bias);
    out.put(c.weight);
  }
  for (const InstanceQuery& q : model.queries) {
    out.put(q.id);
    out.put(q.class_id);
    for (int i = 0; i < 3; ++i) out.put(q.position_m[i]);
    for (const float value :
         {q.R_world_query.w, q.R_world_query.x, q.R_world_query.y, q.R_world_query.z}) {
      out.put(value);
    }
    for (int i = 0; i < 3; ++i) out.put(q.sigma_m[i]);
    out.put(q.feature);
  }
  return out.bytes;
}

PanopticClass take_class(ByteReader& in, const std::string& place) {
  PanopticClass c;
  c.id = in.take<std::uint16_t>();
  const auto thing = in.take<std::uint16_t>();
  if (thing > 1) throw InputError::expected(place, "thing 0 or 1", std::to_string(thing));
  c.thing = thing == 1;
  c.bias = in.take<float>();
  c.weight = in.take<core::SemanticFeature>();
  return c;
}

InstanceQuery take_query(ByteReader& in) {
  InstanceQuery q;
  q.id = in.take<std::uint16_t>();
  q.class_id = in.take<std::uint16_t>();
  for (int i = 0; i < 3; ++i) q.position_m[i] = in.take<float>();
  const auto w = in.take<float>(), x = in.take<float>(), y = in.take<float>(),
             z = in.take<float>();
  q.R_world_query = glm::quat(w, x, y, z);
  for (int i = 0; i < 3; ++i) q.sigma_m[i] = in.take<float>();
  q.feature = in.take<core::InstanceFeature>();
  return q;
}

LabelVariant take_variant(ByteReader& in, const std::string& place) {
  const auto variant = in.take<std::uint32_t>();
  if (variant > static_cast<std::uint32_t>(LabelVariant::kLiteral)) {
    throw InputError::expected(place, "a label variant 0 to 4", std::to_string(variant));
  }
  return static_cast<LabelVariant>(variant);
}

PanopticModel model_of(const std::string& payload, std::uint32_t version,
                       const std::string& place) {
  ByteReader in(payload, place);
  PanopticModel model;
  model.temperature = in.take<float>();
  const auto classes = in.take<std::uint32_t>(), queries = in.take<std::uint32_t>();
  if (version > 1) {
    model.variant = take_variant(in, place);
    model.none_score = in.take<float>();
  }
  // Grown row by row: a damaged count runs into the end of the payload, not out of memory.
  for (std::uint32_t i = 0; i < classes; ++i) model.classes.push_back(take_class(in, place));
  for (std::uint32_t i = 0; i < queries; ++i) model.queries.push_back(take_query(in));
  in.expect_end();
  try {
    check_panoptic_model(model);
  } catch (const core::ContractViolation& broken) {
    const std::string what = broken.what();
    throw InputError(place + ": " + what.substr(what.find("expected")));
  }
  return model;
}

}  // namespace

void write_panoptic_model(const std::filesystem::path& file, const PanopticModel& model) {
  check_panoptic_model(model);
  internal::write_checked_file(file, kMagic, kVersion, payload_of(model));
}

PanopticModel read_panoptic_model(const std::filesystem::path& file) {
  const internal::CheckedFile read =
      internal::read_checked_file(file, kMagic, "a panoptic model", kVersion);
  return model_of(read.payload, read.version, file.string());
}

}  // namespace segsim::renderer
