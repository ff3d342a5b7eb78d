#include "experiments/records/results_digest.h"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <optional>

#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/records/row_words.h"

namespace segsim::experiments::records {
namespace {

/// Hexadecimal floating point: every bit.
std::string exact(const Column& /*column*/, double value) { return core::print("%a", value); }

std::string exact(const Column& column, const std::optional<double>& value) {
  return value && std::isfinite(*value) ? exact(column, *value) : "none";
}

std::string exact(const Column& /*column*/, const std::string& text) { return text; }

template <StoredAsWord W>
std::string exact(const Column& /*column*/, const W& value) {
  return word_of(value);
}

template <std::integral Integer>
std::string exact(const Column& column, Integer value) {
  return column.hexadecimal ? core::hex(static_cast<std::uint64_t>(value))
                            : std::to_string(value);
}

}  // namespace

std::string essence_of(const TrialRow& trial) {
  std::vector<std::string> values;
  visit_columns(trial, [&](const Column& column, const auto& value) {
    if (column.digest == kNotInDigest) return;
    const auto place = static_cast<std::size_t>(column.digest);
    values.resize(std::max(values.size(), place + 1));
    values[place] = exact(column, value);
  });
  std::string line;
  for (const std::string& value : values) line += '\t' + value;
  line.erase(0, 1);
  return line;
}

std::string results_sha256(const std::vector<TrialRow>& trials) {
  std::string text;
  for (const TrialRow& trial : trials) {
    if (!trial.failed()) text += essence_of(trial) + "\n";
  }
  return core::sha256_hex(text);
}

}  // namespace segsim::experiments::records
