#include "experiments/specs/home_spec.h"

#include "core/error.h"
#include "worlds/mesh/furniture/furniture_catalogue.h"

namespace segsim::experiments::specs {

namespace fs = std::filesystem;

void parse_furniture(const std::string& text, const std::string& place, HomeSpec& home) {
  home.own_furniture = text == "own";
  if (home.own_furniture) return;
  const auto pool = worlds::kFurniturePoolNames.find(text);
  if (!pool) {
    throw core::InputError::expected(place, "train, unseen, all or own", "\"" + text + "\"");
  }
  home.pool = *pool;
}

std::optional<fs::path> furniture_folder(const HomeSpec& home) {
  if (home.own_furniture) return std::nullopt;
  if (!home.furniture_folder.empty()) return home.furniture_folder;
  if (fs::is_directory(worlds::kFurnitureFolder)) return worlds::kFurnitureFolder;
  return std::nullopt;
}

std::string describe(const HomeSpec& home) {
  std::string text = std::string(", plan ") + worlds::kHomePlanNames.name(home.plan);
  if (home.rooms > 0) text += ", " + std::to_string(home.rooms) + " rooms";
  return text + ", furniture " +
         (furniture_folder(home) ? worlds::kFurniturePoolNames.name(home.pool) : "own");
}

}  // namespace segsim::experiments::specs
