#pragma once

/// @file
/// Resumable preparation: a step is done if its record says that it was made from the same
/// recipe.

#include <filesystem>
#include <string>

namespace segsim::experiments::support {

/// A small file beside a step's result that holds the recipe in words. A step whose recipe
/// changed is done again; one that was interrupted has no record.
class StepRecord {
 public:
  /// What fast kernels make differs in the last bits, so it is another result
  /// (core/process/kernel_choice.h).
  StepRecord(std::filesystem::path file, std::string recipe);

  [[nodiscard]] bool is_current() const;
  /// Call it after the result was written.
  void mark_done() const;
  /// SHA-256 of the recipe.
  [[nodiscard]] std::string recipe_sha256() const;

 private:
  std::filesystem::path file_;
  std::string recipe_;
};

}  // namespace segsim::experiments::support
