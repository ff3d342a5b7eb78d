#pragma once

/// @file
/// A suite: a named, versioned set of scenes and episodes that others can run, too
/// (docs/suites.md). It is written out as a spec that `segsim run` understands, so that
/// nothing about running it is special.
///
///     schema: segsim.suite/1
///     name: homes-v1             that of the file; another version has another name
///     title, about, data         for people
///     scene: {...}               what all scenes have
///     pools:
///       - {name, scene: {...}, scenes: [{name, ...}, ...]}
///     experiment: {...}          all other keys of a spec

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace segsim::experiments::suites {

struct SuiteScene {
  std::string name, title, pool;
  std::string source;  ///< Type of its source, "bundle" without one.
  std::int64_t episodes = 0;
};

struct Suite {
  static constexpr const char* kSchema = "segsim.suite/1";

  std::string name, title;
  std::string about;  ///< What is in it, in a sentence.
  std::string data;   ///< What must be in the folder of --data; empty: nothing is needed.
  std::filesystem::path file;
  std::vector<SuiteScene> scenes;
  std::vector<std::string> arms;
  std::string spec_text;  ///< The spec that it stands for; the same on every machine.

  /// SHA-256 of `spec_text`: of all that decides what the suite is.
  [[nodiscard]] std::string sha256() const;
  /// The file that messages about the spec name. There is none of that name: paths in the spec
  /// are relative to the folder of the suite.
  [[nodiscard]] std::filesystem::path spec_origin() const;
};

/// Suites that come with the program, by name.
[[nodiscard]] std::vector<std::filesystem::path> shipped_suites();

/// @param word  The name of a suite that comes with the program, or a file (.yaml).
/// @throws core::InputError for an unknown name or a damaged file.
[[nodiscard]] Suite load_suite(const std::string& word);
/// The same from memory. @param file  It stands for that file.
[[nodiscard]] Suite parse_suite(const std::string& text, const std::filesystem::path& file);

}  // namespace segsim::experiments::suites
