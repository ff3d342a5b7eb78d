#pragma once

/// @file
/// The first element of a PLY file as a table of scalars. Only what surfel files need: no
/// lists, no big-endian bodies.

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace segsim::renderer::internal {

class PlyTable {
 public:
  /// Reads header and body of the element `vertex`, which must come first.
  /// @throws core::InputError
  explicit PlyTable(const std::filesystem::path& file);

  [[nodiscard]] std::size_t row_count() const { return row_count_; }
  [[nodiscard]] bool has(const std::string& property) const { return find(property) >= 0; }
  /// @throws core::InputError "<file>: expected property <name>, found <the ones there are>"
  [[nodiscard]] std::size_t column(const std::string& property) const;
  [[nodiscard]] double value(std::size_t row, std::size_t column) const;
  [[nodiscard]] const std::string& place() const { return place_; }
  /// Number of properties called `prefix` + number.
  [[nodiscard]] std::size_t count_with_prefix(const std::string& prefix) const;

 private:
  enum class Type { kI8, kU8, kI16, kU16, kI32, kU32, kF32, kF64 };
  struct Property {
    std::string name;
    Type type;
    std::size_t offset_bytes;
  };

  [[nodiscard]] int find(const std::string& property) const;
  void parse_header();
  void add_property(const std::string& line);
  void parse_ascii_body();
  void check_binary_body() const;
  [[nodiscard]] static std::size_t size_of(Type type);

  std::string place_;
  std::string bytes_;
  std::size_t body_ = 0;  ///< Offset of the body in bytes_.
  bool ascii_ = false;
  std::size_t row_count_ = 0, row_bytes_ = 0;
  std::vector<Property> properties_;
  std::vector<double> ascii_values_;
};

}  // namespace segsim::renderer::internal
