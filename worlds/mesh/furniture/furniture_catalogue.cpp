#include "worlds/mesh/furniture/furniture_catalogue.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <set>

#include "core/error.h"
#include "worlds/mesh/furniture/internal/zip_archive.h"

namespace segsim::worlds {
namespace {

namespace fs = std::filesystem;

constexpr const char* kCatalogueName = "PluginFurnitureCatalog.properties";
/// The largest model of Debian's libraries is a swimming pool of 17 m.
constexpr double kMostSize_cm = 5000.0, kMostElevation_cm = 1000.0;
constexpr int kMostModels = 20'000;

using Properties = std::map<std::string, std::string>;

void append_utf8(std::string& text, unsigned code) {
  if (code < 0x80U) {
    text += static_cast<char>(code);
  } else if (code < 0x800U) {
    text += static_cast<char>(0xC0U | (code >> 6U));
    text += static_cast<char>(0x80U | (code & 0x3FU));
  } else {
    text += static_cast<char>(0xE0U | (code >> 12U));
    text += static_cast<char>(0x80U | ((code >> 6U) & 0x3FU));
    text += static_cast<char>(0x80U | (code & 0x3FU));
  }
}

/// The value of a Java property in UTF-8: the file is Latin-1 with escapes such as \u20ac.
std::string decoded(std::string_view value) {
  std::string text;
  for (std::size_t i = 0; i < value.size(); ++i) {
    if (value[i] != '\\' || i + 1 == value.size()) {
      append_utf8(text, static_cast<unsigned char>(value[i]));
      continue;
    }
    ++i;
    unsigned code = 0;
    const std::string_view digits = value.substr(std::min(i + 1, value.size()), 4);
    const auto [end, error] =
        std::from_chars(digits.data(), digits.data() + digits.size(), code, 16);
    if (value[i] == 'u' && error == std::errc() && end == digits.data() + 4) {
      append_utf8(text, code);
      i += 4;
    } else {
      append_utf8(text, static_cast<unsigned char>(value[i]));
    }
  }
  return text;
}

std::string_view trimmed(std::string_view text) {
  const std::size_t from = text.find_first_not_of(" \t\r");
  if (from == std::string_view::npos) return {};
  return text.substr(from, text.find_last_not_of(" \t\r") - from + 1);
}

/// Keys and values; what is after # or ! at the beginning of a line is a comment.
Properties read_properties(std::string_view text) {
  Properties properties;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = trimmed(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::size_t equal = line.find('=');
    if (line.empty() || line[0] == '#' || line[0] == '!' || equal == std::string_view::npos) {
      continue;
    }
    properties[std::string(trimmed(line.substr(0, equal)))] =
        decoded(trimmed(line.substr(equal + 1)));
  }
  return properties;
}

/// One model's rows.
class CatalogueRow {
 public:
  CatalogueRow(const Properties& properties, const fs::path& library, int number)
      : properties_(properties), library_(library), suffix_("#" + std::to_string(number)) {}

  [[nodiscard]] bool exists() const { return properties_.contains("id" + suffix_); }
  [[nodiscard]] bool has(const std::string& key) const {
    return properties_.contains(key + suffix_);
  }
  [[nodiscard]] std::string text_or(const std::string& key,
                                    const std::string& fallback) const {
    const auto found = properties_.find(key + suffix_);
    return found == properties_.end() ? fallback : found->second;
  }
  [[nodiscard]] std::string text(const std::string& key) const {
    if (!has(key)) fail(key, "a value", "none");
    return properties_.at(key + suffix_);
  }
  [[nodiscard]] double number(const std::string& key, double low, double high) const {
    const std::string word = text(key);
    const std::optional<double> value = number_of(word);
    if (!value || *value < low || *value > high) {
      fail(key, "a number from " + std::to_string(low) + " to " + std::to_string(high),
           "\"" + word + "\"");
    }
    return *value;
  }
  /// Nine numbers, row by row.
  [[nodiscard]] glm::mat3 rotation() const {
    glm::mat3 R(1.0F);
    if (!has("modelRotation")) return R;
    std::string_view words = properties_.at("modelRotation" + suffix_);
    for (int i = 0; i < 9; ++i) {
      words = trimmed(words);
      const std::size_t end = std::min(words.find(' '), words.size());
      const std::optional<double> value = number_of(words.substr(0, end));
      if (!value) fail("modelRotation", "nine numbers", "another text");
      R[i % 3][i / 3] = static_cast<float>(*value);
      words.remove_prefix(end);
    }
    if (std::abs(std::abs(glm::determinant(R)) - 1.0F) > 0.05F) {
      fail("modelRotation", "a rotation", "another matrix");
    }
    return R;
  }
  [[noreturn]] void fail(const std::string& key, const std::string& expected,
                         const std::string& found) const {
    throw core::InputError::expected(
        library_.string() + ": " + kCatalogueName + ": " + key + suffix_, expected, found);
  }

 private:
  static std::optional<double> number_of(std::string_view word) {
    double value = 0.0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value)) {
      return std::nullopt;
    }
    return value;
  }

  const Properties& properties_;
  const fs::path& library_;
  std::string suffix_;
};

FurnitureModel model_of(const CatalogueRow& row, const internal::ZipArchive& zip) {
  constexpr double kLeastSize_cm = 0.01, kMetre_cm = 100.0;
  FurnitureModel model;
  model.id = row.text("id");
  model.name = row.text("name");
  model.creator = row.text_or("creator", "unknown");
  const auto size_m = [&](const char* key) {
    return static_cast<float>(row.number(key, kLeastSize_cm, kMostSize_cm) / kMetre_cm);
  };
  model.size_m = {size_m("width"), size_m("depth"), size_m("height")};
  const auto height_m = [&](const char* key) {
    return static_cast<float>(row.number(key, -kMostElevation_cm, kMostElevation_cm) /
                              kMetre_cm);
  };
  if (row.has("elevation")) model.elevation_m = height_m("elevation");
  model.surface_m = model.size_m.z;
  // -1 says that nothing can be put there.
  if (row.has("dropOnTopElevation")) {
    model.surface_m = std::max(0.0F, height_m("dropOnTopElevation"));
  }
  model.R_upright_file = row.rotation();
  model.mesh = row.text("model");
  model.mesh.erase(0, model.mesh.find_first_not_of('/'));
  if (!zip.sizes_bytes().contains(model.mesh)) {
    row.fail("model", "an entry of the zip file", "\"" + model.mesh + "\"");
  }
  return model;
}

}  // namespace

std::vector<FurnitureModel> read_furniture_library(const fs::path& library) {
  const internal::ZipArchive zip(library);
  const Properties properties = read_properties(zip.read(kCatalogueName));
  const auto license = properties.find("license");
  std::vector<FurnitureModel> models;
  for (int number = 1; number <= kMostModels; ++number) {
    const CatalogueRow row(properties, library, number);
    if (!row.exists()) break;
    FurnitureModel& model = models.emplace_back(model_of(row, zip));
    model.library = library;
    model.license = license == properties.end() ? "unknown" : license->second;
  }
  if (models.empty()) {
    throw core::InputError::expected(library.string() + ": " + kCatalogueName,
                                     "at least one model", "none");
  }
  return models;
}

std::vector<FurnitureModel> read_furniture_folder(const fs::path& folder) {
  std::vector<fs::path> libraries;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().extension() == ".sh3f") libraries.push_back(entry.path());
  }
  if (libraries.empty()) {
    throw core::InputError::expected(folder.string(), "furniture libraries (.sh3f)", "none");
  }
  std::sort(libraries.begin(), libraries.end());
  std::vector<FurnitureModel> models;
  std::set<std::string> ids;
  for (const fs::path& library : libraries) {
    for (FurnitureModel& model : read_furniture_library(library)) {
      if (!ids.insert(model.id).second) {
        throw core::InputError::expected(library.string(), "every id once in the folder",
                                         model.id + " again");
      }
      models.push_back(std::move(model));
    }
  }
  return models;
}

}  // namespace segsim::worlds
