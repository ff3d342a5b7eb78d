#pragma once

/// @file
/// Shape and colour of the surfels from posed RGB-D images: the paper's "End-to-end Panoptic
/// Reconstruction" without its labels, which are learnt afterwards on frozen surfels
/// (panoptic_training.h).
///
///     view -> draw -> (1-s) L1 + s (1-SSIM) + depth + normals + distortion -> gradients
///          -> Adam on the surfels in view, and on the view's pose -> now and then split,
///          fill, prune (densify.h)
///
/// Everything that happens in an iteration follows from (seed, iteration) and the state, so
/// training that is loaded goes on as if it had never stopped. On the CPU equal inputs give
/// equal surfels, whatever the number of threads.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/frames.h"
#include "reconstruction/evaluation/image_quality.h"
#include "reconstruction/labels/panoptic_head.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "reconstruction/training/training_config.h"
#include "reconstruction/training/training_set.h"
#include "renderer/renderer_backend.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction {

/// What one iteration cost. Losses are times their weights; 0 where one takes no part.
struct GeometryStep {
  std::int64_t iteration = 0;  ///< Finished.
  double color = 0.0, depth = 0.0, normal = 0.0, distortion = 0.0, plane = 0.0;
  std::int64_t surfels = 0;

  [[nodiscard]] double total() const { return color + depth + normal + distortion + plane; }
};

struct GeometryDevice {
  renderer::Backend backend =
      renderer::Backend::kCpu;  ///< kAuto: the GPU if program, libtorch and machine can.
  int threads = 0;              ///< Of the CPU; 0 = all processors.
  bool deterministic = true;    ///< On the GPU: sums in a fixed order.
};

/// @throws core::InputError if kCuda was asked for and the program or libtorch lacks it.
[[nodiscard]] std::unique_ptr<DifferentiableRasterizer<float>> make_training_rasterizer(
    const GeometryDevice& device);
/// True if make_training_rasterizer() makes one that works in the memory of a GPU.
[[nodiscard]] bool trains_on_gpu(const GeometryDevice& device);

class GeometryTrainer {
 public:
  /// @param set  Must outlive this object.
  /// @param start  From lift(); its labels are not used.
  GeometryTrainer(const TrainingSet& set, const renderer::SurfelCloud& start,
                  const GeometryConfig& config, std::uint64_t seed,
                  const GeometryDevice& device = {});
  ~GeometryTrainer();
  GeometryTrainer(const GeometryTrainer&) = delete;
  GeometryTrainer& operator=(const GeometryTrainer&) = delete;

  /// Iterations done.
  [[nodiscard]] std::int64_t iteration() const;
  /// One iteration.
  /// @throws core::InputError if the loss is not finite; the surfels are then unchanged.
  GeometryStep step();

  // Joint training, when the iterations are done: surfels neither come nor go, and rates are
  // those of the end, times JointConfig::rate.

  /// Draws a view. @return  Weights of some of its pixels, valid until the next call.
  [[nodiscard]] PixelWeights draw(std::size_t view, std::span<const std::int32_t> pixels);
  /// An iteration with what was drawn last, and what a head says of the weights it got.
  /// @param pixels, weights  Of draw().  @param labels  Empty: nothing.
  void step_with(std::span<const std::int32_t> pixels, const PixelWeights& weights,
                 const GeometryGradient& labels, const JointConfig& config);
  [[nodiscard]] std::vector<glm::vec3> positions_m() const;

  [[nodiscard]] renderer::SurfelCloud surfels() const;
  /// T_world_camera of the training views: as recorded, unless the configuration has rates for
  /// poses. The cameras' mean place and rotation stay as recorded.
  [[nodiscard]] const std::vector<core::CameraPose>& poses() const;
  /// Of the training views: what takes the surfels' colours to theirs. Empty without a rate
  /// for exposure.
  [[nodiscard]] std::vector<Exposure> exposures() const;

  /// The whole state, written atomically.
  /// @param identity  What the state belongs to: load() asks for the same.
  void save(const std::filesystem::path& file, const std::string& identity) const;
  /// @throws core::InputError for a damaged file, or one of another identity.
  void load(const std::filesystem::path& file, const std::string& identity);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// The training view of an iteration: all views once in random order, then again in another.
[[nodiscard]] std::size_t view_of_iteration(std::int64_t iteration, std::size_t views,
                                            std::uint64_t seed);

}  // namespace segsim::reconstruction
