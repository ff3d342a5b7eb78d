#pragma once

/// @file
/// Named tensors and numbers in one file, written atomically.

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "reconstruction/internal/tensors/tensors.h"

namespace segsim::reconstruction::internal {

/// Collects, then writes.
class StateWriter {
 public:
  /// @param kind  What the state is of; a reader must ask for the same.
  explicit StateWriter(std::string kind) : kind_(std::move(kind)) {}
  void put(const std::string& name, const Tensor& value);
  void put_integers(const std::string& name, const std::vector<std::int64_t>& values);
  void write(const std::filesystem::path& file) const;

 private:
  std::string kind_;
  std::map<std::string, Tensor> tensors_;
};

class StateReader {
 public:
  /// @throws core::InputError for a file that is missing, damaged or of another kind.
  StateReader(const std::filesystem::path& file, const std::string& kind);

  /// The tensor, on the device of `like`.
  /// @throws core::InputError if it is missing, or of another type or another shape than
  ///     `like`; the number of rows may differ.
  [[nodiscard]] Tensor take(const std::string& name, const Tensor& like) const;
  [[nodiscard]] std::vector<std::int64_t> integers(const std::string& name) const;
  /// @throws core::InputError if the tensor has another number of rows.
  void expect_rows(const std::string& name, std::int64_t rows) const;
  [[nodiscard]] const std::string& place() const { return place_; }

 private:
  [[nodiscard]] const Tensor& find(const std::string& name) const;
  std::string place_;
  std::map<std::string, Tensor> tensors_;
};

}  // namespace segsim::reconstruction::internal
