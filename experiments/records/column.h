#pragma once

/// @file
/// How a column of a row is described. `visit_columns(row, f)` of a row calls `f(column,
/// member)` for every column of it; schema, statements, CSV, JSON Lines and digest are all
/// made from that. The type of the member says what is stored, an optional one that there may
/// be none (NULL; of a word ""), and the name says the unit.

#include <concepts>
#include <cstdint>
#include <type_traits>

namespace segsim::experiments::records {

/// Which table of the database a column lies in, and which object of JSON Lines.
enum class Part : std::uint8_t {
  kRow,  ///< The table of the row; the object of the row.
  kWhy,  ///< Table `attribution`, which knows some trials only; the object "why".
  kLog,  ///< Table `attribution`, too; the object of the row.
};

inline constexpr int kNotInDigest = -1;

struct Column {
  const char* name;
  Part part = Part::kRow;
  /// Its place in the digest (results_digest.h). Places are never given anew: every recorded
  /// digest would change.
  int digest = kNotInDigest;
  bool given_by_store = false;      ///< The primary key.
  bool hexadecimal = false;         ///< A hash: 16 digits as text.
  bool unknown_below_zero = false;  ///< An integer that exports leave out if it is negative.
};

/// A Row or a const Row, for overloads of visit_columns.
template <class T, class Row>
concept AnyConst = std::same_as<std::remove_const_t<T>, Row>;

}  // namespace segsim::experiments::records
