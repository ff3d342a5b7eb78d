#pragma once

/// @file
/// Ids with names, and the floats that stand for them in Cryptomatte layers.
///
/// Source: Friedman & Jones, "Cryptomatte Specification" 1.2 (Psyop/Cryptomatte): a name is
/// hashed with MurmurHash3_x86_32 (seed 0), the exponent bits of the hash are brought to
/// [1, 254], and the result is read as a float: never NaN, infinite or denormal. The hash
/// follows Appleby's public-domain description.

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <unordered_map>

#include "core/scene_bundle.h"

namespace segsim::renderer {

/// MurmurHash3_x86_32.
[[nodiscard]] std::uint32_t murmur3_32(std::string_view bytes, std::uint32_t seed = 0);

/// Bits of the float that stands for `name` in a Cryptomatte layer: the hash with its exponent
/// in [1, 254]. Never 0, which stands for "no object".
[[nodiscard]] std::uint32_t cryptomatte_id(std::string_view name);

/// Key of a layer's header attributes: the first seven hexadecimal digits of the hash of its
/// name, the same in every frame.
[[nodiscard]] std::string cryptomatte_key(std::string_view layer);

/// One kind of id (class or instance) and its names. Names are unique and have different
/// Cryptomatte ids: one that would clash gets "#<id>" appended. Ids without a name are called
/// "<kind> <id>". Id 0 (void, none) has no name.
class IdNames {
 public:
  /// @param kind  A word such as "class".
  explicit IdNames(std::string kind) : kind_(std::move(kind)) {}

  /// Gives an id its name, once; "" = "<kind> <id>".
  /// @throws core::ContractViolation for id 0 and for an id that has a name.
  void add(std::uint16_t id, const std::string& name);
  /// Gives a nameless id its default name; others and 0 are left alone.
  void add_if_missing(std::uint16_t id);

  /// Empty for 0 and for ids that were not added.
  [[nodiscard]] std::string name(std::uint16_t id) const;
  /// 0 for 0 and for ids that were not added.
  [[nodiscard]] std::uint32_t cryptomatte(std::uint16_t id) const;
  [[nodiscard]] const std::map<std::uint16_t, std::string>& names() const { return names_; }

  /// The Cryptomatte manifest: {"couch":"b2b0cbf4",...}, UTF-8, in the order of the ids.
  [[nodiscard]] std::string manifest_json() const;
  /// {"1":"wall",...}, for readers of the integer ids.
  [[nodiscard]] std::string legend_json() const;
  /// Reads what legend_json() wrote. @throws core::InputError that begins with `place`.
  [[nodiscard]] static IdNames from_legend(std::string kind, const std::string& json,
                                           const std::string& place);

 private:
  std::string kind_;
  std::map<std::uint16_t, std::string> names_;
  std::unordered_map<std::uint32_t, std::uint16_t> id_of_cryptomatte_;
};

/// Cryptomatte ids and names of a manifest. @throws core::InputError that begins with `place`
/// if it is no JSON object of eight-digit hexadecimal texts.
[[nodiscard]] std::map<std::uint32_t, std::string> parse_cryptomatte_manifest(
    const std::string& json, const std::string& place);

/// Names of a scene's classes and instances.
struct SceneNames {
  IdNames classes{"class"};
  IdNames instances{"instance"};

  [[nodiscard]] static SceneNames of(const core::SceneManifest& manifest);
};

}  // namespace segsim::renderer
