#include "experiments/specs/gazebo_spec.h"

#include <charconv>
#include <optional>
#include <sstream>

#include "core/error.h"
#include "core/file_io.h"
#include "core/name_table.h"

namespace segsim::experiments::specs {
namespace {

using worlds::CeilingKind;
using worlds::CeilingOptions;
using worlds::OnMissing;

constexpr core::NameTable<OnMissing, OnMissing::kSkip> kOnMissing(
    "what is done about missing files", {"error", "collision", "skip"});

/// Captures were described without their ceiling when this was the only one.
constexpr const char* kFirstCeiling = "aws_robomaker_residential_RoomCeiling_01@2.5";

std::optional<double> height(const std::string& text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  if (!whole || !(value >= 0.5 && value <= 100.0)) return std::nullopt;
  return value;
}

std::string text_of(const CeilingOptions& ceiling) {
  std::ostringstream text;
  switch (ceiling.kind) {
    case CeilingKind::kNone:
      return "none";
    case CeilingKind::kWalls:
      return "walls";
    case CeilingKind::kHeight:
      text << ceiling.height_m;
      break;
    case CeilingKind::kModel:
      text << ceiling.model << "@" << ceiling.height_m;
      break;
  }
  return text.str();
}

}  // namespace

CeilingOptions parse_ceiling(const std::string& text, const std::string& place) {
  if (text == "none") return {CeilingKind::kNone, 0.0, {}};
  if (text == "walls") return {CeilingKind::kWalls, 0.0, {}};
  const std::size_t at = text.find('@');
  if (at == std::string::npos) {
    if (const auto metres = height(text)) return {CeilingKind::kHeight, *metres, {}};
  } else if (const auto metres = height(text.substr(at + 1)); metres && at > 0) {
    return {CeilingKind::kModel, *metres, text.substr(0, at)};
  }
  throw core::InputError::expected(
      place, "none, walls, a height from 0.5 to 100 [m] or MODEL@HEIGHT", "\"" + text + "\"");
}

OnMissing parse_on_missing(const std::string& text, const std::string& place) {
  if (const auto on_missing = kOnMissing.find(text)) return *on_missing;
  throw core::InputError::expected(place, "error, collision or skip", "\"" + text + "\"");
}

std::string describe(const GazeboSpec& spec) {
  std::string text;
  if (const std::string ceiling = text_of(spec.options.ceiling); ceiling != kFirstCeiling) {
    text += ", ceiling " + ceiling;
  }
  if (spec.options.on_missing != OnMissing::kError) {
    text += std::string(", missing files: ") + kOnMissing.name(spec.options.on_missing);
  }
  for (const std::filesystem::path& folder : spec.options.resource_paths) {
    text += ", resources of " + folder.filename().string();
  }
  if (!spec.class_map.empty()) {
    text += ", classes of " + spec.class_map.filename().string() + " " +
            core::sha256_of_file(spec.class_map).substr(0, 8);
  }
  return text;
}

}  // namespace segsim::experiments::specs
