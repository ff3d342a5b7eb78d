#pragma once

/// @file
/// From the class names of one vocabulary (HM3D, ScanNet, free text) to those of another:
///
///     schema: segsim.class_map
///     version: 1
///     title: HM3D object names to COCO
///     free_text: false        # true: an unknown phrase counts by the longest entry it ends
///     with classes:
///       couch: [sofa, sofa chair]
///       tv: [tv_monitor]
///     leave_out: [unknown]     # names that are no class on purpose
///
/// Names are compared in lower case with '_', '-' and repeated blanks as one blank.

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace segsim::perception {

/// "Sofa_Chair " -> "sofa chair".
[[nodiscard]] std::string normalised_name(const std::string& name);

struct ClassMap {
  std::string title;
  bool free_text = false;
  std::map<std::string, std::string> target_of;  ///< Normalised name -> class; "" = left out.

  /// The class of a name: its entry; else, with free_text, that of the longest entry that ends
  /// the phrase at a word's border, also with the plural's "s" taken off ("two red
  /// armchairs").
  /// "" = left out, nullopt = unknown.
  [[nodiscard]] std::optional<std::string> find(const std::string& name) const;
};

/// @throws core::InputError naming file, line and key: a name with two targets, no classes.
[[nodiscard]] ClassMap read_class_map(const std::filesystem::path& file);

}  // namespace segsim::perception
