#pragma once

/// @file
/// Adam (Kingma and Ba 2015) on one tensor, whole or row by row.

#include <cstdint>
#include <string>
#include <vector>

#include "reconstruction/internal/tensors/state_file.h"
#include "reconstruction/internal/tensors/tensors.h"

namespace segsim::reconstruction::internal {

/// A parameter of [rows, ...] with Adam's moments. Every row counts its own steps: a surfel
/// that is first seen late then starts like all others (with one common count its first step
/// would be three times as long).
class AdamTensor {
 public:
  AdamTensor() = default;
  explicit AdamTensor(const Tensor& value);

  [[nodiscard]] const Tensor& value() const { return value_; }

  /// @param gradient  Of the shape of value().
  void step(const Tensor& gradient, double rate);
  /// @param rows  [n] int64, each once.  @param gradient  [n, ...].
  void step_rows(const Tensor& rows, const Tensor& gradient, double rate);
  void clamp(double lo, double hi) { value_.clamp_(lo, hi); }

  /// Keeps these rows, in this order. @param rows  int64.
  void select(const Tensor& rows);
  /// Adds rows at the end, with moments as at the beginning. @param values  [n, ...].
  void append(const Tensor& values);

  void save(StateWriter& out, const std::string& name) const;
  /// @throws core::InputError for another shape beyond the rows.
  void load(const StateReader& in, const std::string& name);

 private:
  void step_rows_on_cpu(const Tensor& rows, const Tensor& gradient, double rate);
  /// Fills bias_ up to and including this number of steps.
  void know_bias(std::int32_t most);

  Tensor value_, first_, second_;
  Tensor steps_;  ///< [rows], int32.

  struct BiasCorrection {
    double first;               ///< 1 - beta1^n
    float inverse_root_second;  ///< (1 - beta2^n)^-1/2
  };
  std::vector<BiasCorrection> bias_;  ///< By the number of steps n.
};

}  // namespace segsim::reconstruction::internal
