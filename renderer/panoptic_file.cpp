#include <bit>
#include <cmath>
#include <cstring>
#include <ostream>
#include <string>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "renderer/panoptic_field.h"

namespace segsim::renderer {
namespace {

using core::InputError;
static_assert(std::endian::native == std::endian::little);

constexpr std::string_view kMagic = "SEGSIMPF";
constexpr std::uint32_t kVersion = 2;
constexpr std::size_t kHashBytes = 64;
constexpr std::size_t kHeaderBytes = 8 + 4 + 8 + kHashBytes;

class Writer {
 public:
  template <class T>
  void put(const T& value) {
    const auto at = bytes.size();
    bytes.resize(at + sizeof value);
    std::memcpy(bytes.data() + at, &value, sizeof value);
  }

  std::string bytes;
};

class Reader {
 public:
  Reader(const std::string& bytes, const std::string& place) : bytes_(bytes), place_(place) {}

  template <class T>
  T take() {
    if (bytes_.size() - at_ < sizeof(T)) {
      throw InputError::expected(
          place_, "more than " + std::to_string(bytes_.size()) + " bytes of payload",
          "its end");
    }
    T value;
    std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return value;
  }
  void expect_end() const {
    if (at_ == bytes_.size()) return;
    throw InputError::expected(place_, std::to_string(at_) + " bytes of payload",
                               std::to_string(bytes_.size()));
  }

 private:
  const std::string& bytes_;
  const std::string& place_;
  std::size_t at_ = 0;
};

std::string payload_of(const PanopticModel& model) {
  Writer out;
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

PanopticClass take_class(Reader& in, const std::string& place) {
  PanopticClass c;
  c.id = in.take<std::uint16_t>();
  const auto thing = in.take<std::uint16_t>();
  if (thing > 1) throw InputError::expected(place, "thing 0 or 1", std::to_string(thing));
  c.thing = thing == 1;
  c.bias = in.take<float>();
  c.weight = in.take<core::SemanticFeature>();
  return c;
}

InstanceQuery take_query(Reader& in) {
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

LabelVariant take_variant(Reader& in, const std::string& place) {
  const auto variant = in.take<std::uint32_t>();
  if (variant > static_cast<std::uint32_t>(LabelVariant::kLiteral)) {
    throw InputError::expected(place, "a label variant 0 to 4", std::to_string(variant));
  }
  return static_cast<LabelVariant>(variant);
}

PanopticModel model_of(const std::string& payload, std::uint32_t version,
                       const std::string& place) {
  Reader in(payload, place);
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
  const std::string payload = payload_of(model);
  Writer header;
  for (const char c : kMagic) header.put(c);
  header.put(kVersion);
  header.put(static_cast<std::uint64_t>(payload.size()));
  const std::string bytes = header.bytes + core::sha256_hex(payload) + payload;
  core::write_file_atomically(file, [&bytes](std::ostream& out) {
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  });
}

PanopticModel read_panoptic_model(const std::filesystem::path& file) {
  const std::string bytes = core::read_file(file);
  const std::string place = file.string();
  if (bytes.size() < kHeaderBytes || !bytes.starts_with(kMagic)) {
    throw InputError::expected(place, "a panoptic model (" + std::string(kMagic) + ")",
                               std::to_string(bytes.size()) + " other bytes");
  }
  Reader header(bytes, place);
  for (std::size_t i = 0; i < kMagic.size(); ++i) static_cast<void>(header.take<char>());
  const auto version = header.take<std::uint32_t>();
  if (version < 1 || version > kVersion) {
    throw InputError::expected(place, "version 1 or " + std::to_string(kVersion),
                               std::to_string(version));
  }
  const auto size = header.take<std::uint64_t>();
  if (size != bytes.size() - kHeaderBytes) {
    throw InputError::expected(place, std::to_string(size) + " bytes of payload",
                               std::to_string(bytes.size() - kHeaderBytes));
  }
  const std::string payload = bytes.substr(kHeaderBytes);
  if (core::sha256_hex(payload) != bytes.substr(kHeaderBytes - kHashBytes, kHashBytes)) {
    throw InputError::expected(place, "a payload with the SHA-256 of its header",
                               "another one");
  }
  return model_of(payload, version, place);
}

}  // namespace segsim::renderer
