#pragma once

/// @file
/// The tables of a results database, and how older files are brought up to date.

#include <span>
#include <string>

namespace segsim::experiments::records {

/// SQL that makes the tables of the present version, made from visit_columns of the rows.
[[nodiscard]] std::string present_schema();

/// SQL that takes a file from version `to` - 1 to version `to`.
struct Migration {
  int to;
  const char* sql;
};
/// By version; the last one leads to the present schema.
[[nodiscard]] std::span<const Migration> migrations();

}  // namespace segsim::experiments::records
