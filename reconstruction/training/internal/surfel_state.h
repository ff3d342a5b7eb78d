#pragma once

/// @file
/// All surfels in training: parameters and Adam's moments.

#include <string>

#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/training/internal/raster_function.h"
#include "reconstruction/training/raw_surfels.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction::internal {

/// Learning rates of one step.
struct SurfelRates {
  double position = 0.0, log_scale = 0.0, rotation = 0.0, opacity = 0.0;
  double color = 0.0, color_rest = 0.0;  ///< SH of degree 0; of the others.
};

class SurfelState {
 public:
  SurfelState(const renderer::SurfelCloud& surfels, int sh_degree, const at::Device& device);

  [[nodiscard]] std::int64_t count() const { return position_.value().size(0); }
  /// Tensors that share the parameters' memory and collect gradients.
  [[nodiscard]] SurfelTensors leaves() const;
  /// One step of Adam for the surfels that a view shows.
  /// @param leaves  With gradients.  @param rows  [n] int64, each once.
  void step(const SurfelTensors& leaves, const Tensor& rows, int active_sh_degree,
            const SurfelRates& rates);

  /// Keeps these surfels, in this order; repeated ones are copied with their moments.
  void select(const Tensor& rows);
  /// Adds surfels. @param added  Of sh_degree() of this state.
  void append(const RawSurfels& added);
  /// Overwrites position and scale of the last surfels: halves of split ones.
  void set_tail_shape(const std::vector<float>& position_m,
                      const std::vector<float>& log_scale);

  /// The last `count` surfels (all: count()), in host memory.
  [[nodiscard]] RawSurfels tail(std::int64_t count) const;

  void save(StateWriter& out) const;
  /// @throws core::InputError for arrays of different lengths or of another degree.
  void load(const StateReader& in);

 private:
  void assemble_sh();

  int sh_degree_;
  AdamTensor position_, log_scale_, rotation_, opacity_, color_, rest_;
  Tensor sh_;  ///< color_ and rest_ side by side, as the rasterizer reads them.
};

}  // namespace segsim::reconstruction::internal
