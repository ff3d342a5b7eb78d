#pragma once

/// @file
/// Messages of the protocol `segsim.peer/1` (docs/connect.md) to and from JSON. Whoever reads
/// one throws core::InputError that names the field.

#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "core/stages.h"
#include "peers/episode_start.h"
#include "peers/shared_images.h"

namespace segsim::peers::internal {

using Json = nlohmann::json;

inline constexpr const char* kSchema = "segsim.peer/1";

/// As text; what is no UTF-8 is replaced.
[[nodiscard]] std::string to_text(const Json& message);
/// An object with a `type`. @param from  Who sent it, for messages about it.
[[nodiscard]] Json parse_message(const std::string& text, const std::string& from);

/// Reads members of one message.
class Fields {
 public:
  /// @param place  For messages: who sent it, and its type.
  Fields(const Json& object, std::string place) : object_(object), place_(std::move(place)) {}

  [[nodiscard]] bool has(const char* key) const;
  [[nodiscard]] std::string text(const char* key) const;
  [[nodiscard]] double number(const char* key) const;  ///< Finite.
  [[nodiscard]] double number_or(const char* key, double fallback) const;
  /// In [least, most].
  [[nodiscard]] std::int64_t integer(const char* key, std::int64_t least,
                                     std::int64_t most) const;
  [[nodiscard]] std::uint64_t unsigned_number(const char* key) const;
  /// So many, if `count` is not 0.
  [[nodiscard]] std::vector<double> numbers(const char* key, std::size_t count) const;
  [[nodiscard]] std::vector<std::string> texts(const char* key) const;
  [[nodiscard]] Fields map(const char* key) const;
  [[nodiscard]] std::vector<Fields> list(const char* key) const;
  [[nodiscard]] const std::string& place() const { return place_; }
  [[noreturn]] void fail(const char* key, const std::string& expected) const;

 private:
  [[nodiscard]] const Json& member(const char* key, const char* expected) const;

  const Json& object_;
  std::string place_;
};

[[nodiscard]] Json to_json(const EpisodeStart& start);
[[nodiscard]] EpisodeStart read_start(const Fields& fields);

/// Without its images, which `places` tells of.
[[nodiscard]] Json to_json(const core::Observation& observation, const ImagePlaces& places);
/// @param places  Set to those of the message; the images of the result are null.
[[nodiscard]] core::Observation read_observation(const Fields& fields, ImagePlaces& places);

[[nodiscard]] Json to_json(std::span<const core::Detection> detections);
/// In descending order of score. @param classes  How many the detector has.
[[nodiscard]] std::vector<core::Detection> read_detections(const Fields& fields, int classes);

[[nodiscard]] Json to_json(const core::Decision& decision, const core::PolicyView& view);
[[nodiscard]] core::Decision read_decision(const Fields& fields);
/// What a decision tells of the policy's plans: path, target, frontiers.
[[nodiscard]] core::PolicyView read_view(const Fields& fields);

}  // namespace segsim::peers::internal
