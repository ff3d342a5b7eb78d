#include "renderer/files/cryptomatte.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstdio>
#include <optional>

#include "core/check.h"
#include "core/config.h"
#include "core/error.h"

namespace segsim::renderer {
namespace {

std::uint32_t scramble(std::uint32_t k) {
  return std::rotl(k * 0xcc9e2d51U, 15) * 0x1b873593U;
}

/// Up to four bytes, the first one lowest, on any machine.
std::uint32_t little_endian(std::string_view bytes) {
  std::uint32_t value = 0;
  for (std::size_t i = bytes.size(); i-- > 0;) {
    value = value << 8U | static_cast<unsigned char>(bytes[i]);
  }
  return value;
}

std::string hex8(std::uint32_t value) {
  char text[9];
  std::snprintf(text, sizeof text, "%08x", value);
  return text;
}

/// A JSON string. Bytes above 127 pass: names are UTF-8.
std::string quoted(const std::string& text) {
  std::string json = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      json += '\\';
      json += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      char escape[7];
      std::snprintf(escape, sizeof escape, "\\u%04x", static_cast<unsigned>(c));
      json += escape;
    } else {
      json += c;
    }
  }
  return json + "\"";
}

/// The whole text as a number of the base, or nothing.
template <class Number>
std::optional<Number> number_from(const std::string& text, int base) {
  Number value{};
  const char* end = text.data() + text.size();
  const auto [parsed, error] = std::from_chars(text.data(), end, value, base);
  if (error != std::errc() || parsed != end) return std::nullopt;
  return value;
}

/// A JSON object is a YAML map.
core::ConfigNode parse_object(const std::string& json, const std::string& place) {
  core::ConfigNode object = core::ConfigNode::parse(json, place);
  if (!object.is_map()) throw core::InputError::expected(place, "a JSON object", json);
  return object;
}

}  // namespace

std::uint32_t murmur3_32(std::string_view bytes, std::uint32_t seed) {
  std::uint32_t hash = seed;
  const std::size_t whole = bytes.size() / 4 * 4;
  for (std::size_t i = 0; i < whole; i += 4) {
    hash = std::rotl(hash ^ scramble(little_endian(bytes.substr(i, 4))), 13);
    hash = hash * 5 + 0xe6546b64U;
  }
  hash ^= scramble(little_endian(bytes.substr(whole)));
  hash ^= static_cast<std::uint32_t>(bytes.size());
  hash = (hash ^ hash >> 16U) * 0x85ebca6bU;
  hash = (hash ^ hash >> 13U) * 0xc2b2ae35U;
  return hash ^ hash >> 16U;
}

std::uint32_t cryptomatte_id(std::string_view name) {
  constexpr std::uint32_t kExponent = 0xffU << 23U;
  const std::uint32_t hash = murmur3_32(name);
  const std::uint32_t exponent = std::clamp((hash & kExponent) >> 23U, 1U, 254U);
  return (hash & ~kExponent) | exponent << 23U;
}

std::string cryptomatte_key(std::string_view layer) {
  return hex8(murmur3_32(layer)).substr(0, 7);
}

void IdNames::add(std::uint16_t id, const std::string& name) {
  SEGSIM_CHECK(id != 0, "0 is no object");
  SEGSIM_CHECK(!names_.contains(id), kind_ + " " + std::to_string(id));
  std::string unique = name.empty() ? kind_ + " " + std::to_string(id) : name;
  while (!id_of_cryptomatte_.emplace(cryptomatte_id(unique), id).second) {
    unique += "#" + std::to_string(id);
  }
  names_.emplace(id, std::move(unique));
}

void IdNames::add_if_missing(std::uint16_t id) {
  if (id != 0 && !names_.contains(id)) add(id, {});
}

std::string IdNames::name(std::uint16_t id) const {
  const auto found = names_.find(id);
  return found == names_.end() ? std::string() : found->second;
}

std::uint32_t IdNames::cryptomatte(std::uint16_t id) const {
  const auto found = names_.find(id);
  return found == names_.end() ? 0 : cryptomatte_id(found->second);
}

std::string IdNames::manifest_json() const {
  std::string json;
  for (const auto& [id, name] : names_) {
    json += (json.empty() ? "" : ",") + quoted(name) + ":\"" + hex8(cryptomatte(id)) + "\"";
  }
  return "{" + json + "}";
}

std::string IdNames::legend_json() const {
  std::string json;
  for (const auto& [id, name] : names_) {
    json += (json.empty() ? "\"" : ",\"") + std::to_string(id) + "\":" + quoted(name);
  }
  return "{" + json + "}";
}

IdNames IdNames::from_legend(std::string kind, const std::string& json,
                             const std::string& place) {
  IdNames names(std::move(kind));
  const core::ConfigNode object = parse_object(json, place);
  for (const std::string& key : object.keys()) {
    const auto id = number_from<std::uint16_t>(key, 10);
    if (!id || *id == 0 || names.names_.contains(*id)) {
      throw core::InputError::expected(place, "ids from 1 to 65535, each once", key);
    }
    names.add(*id, object.text(key));
  }
  return names;
}

std::map<std::uint32_t, std::string> parse_cryptomatte_manifest(const std::string& json,
                                                                const std::string& place) {
  std::map<std::uint32_t, std::string> names;
  const core::ConfigNode object = parse_object(json, place);
  for (const std::string& name : object.keys()) {
    const std::string hex = object.text(name);
    const auto id = number_from<std::uint32_t>(hex, 16);
    if (!id || hex.size() != 8) {
      throw core::InputError::expected(place, "eight hexadecimal digits for " + name, hex);
    }
    names[*id] = name;
  }
  return names;
}

SceneNames SceneNames::of(const core::SceneManifest& manifest) {
  SceneNames names;
  for (const core::SceneClass& c : manifest.classes) names.classes.add(c.id, c.name);
  for (const core::SceneInstance& i : manifest.instances) names.instances.add(i.id, i.name);
  return names;
}

}  // namespace segsim::renderer
