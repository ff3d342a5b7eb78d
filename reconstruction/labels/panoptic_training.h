#pragma once

/// @file
/// The loop of panoptic training: image after image, pixels are drawn, blended weights are
/// fetched and a head takes a step.
///
///     prepare_head_inputs() -> make_panoptic_head() -> train_panoptic() ->
///     PanopticHead::result()
///
/// Which image and which pixels an iteration uses depends on (seed, iteration) alone, so
/// training that goes on from a saved head repeats what would have happened.

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "core/camera.h"
#include "core/frame_masks.h"
#include "core/frames.h"
#include "core/scene_bundle.h"
#include "reconstruction/labels/panoptic_head.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"

namespace segsim::reconstruction {

/// The training images and the frozen surfels behind them.
class PanopticViews {
 public:
  virtual ~PanopticViews() = default;

  [[nodiscard]] virtual std::int64_t count() const = 0;
  /// Valid until the next call of masks(). @throws core::InputError for a bad file.
  [[nodiscard]] virtual const core::FrameMasks& masks(std::int64_t view) = 0;
  /// Of the masks' size, NaN = unknown; or empty. Valid until the next call of depth_m().
  [[nodiscard]] virtual const core::Image<float>& depth_m(std::int64_t view) = 0;
  /// Of images of the masks' size.
  [[nodiscard]] virtual core::CameraIntrinsics intrinsics(std::int64_t view) const = 0;
  [[nodiscard]] virtual core::CameraPose T_world_camera(std::int64_t view) const = 0;
  /// Blending weights of pixels y * width + x.
  /// @param max_per_pixel  The heaviest of a pixel; 0 = all.
  /// @param slot  0 or 1: the result is valid until the next call with the same slot.
  [[nodiscard]] virtual PixelWeights weights(std::int64_t view,
                                             std::span<const std::int32_t> pixels,
                                             int max_per_pixel, int slot) = 0;
};

/// Surfels that learn from labels, too: after each step of a head they take one.
class MovingSurfels {
 public:
  virtual ~MovingSurfels() = default;
  /// @param pixels  Of the last weights() of slot 0.
  /// @param gradient  What the head's step left; empty: nothing.
  virtual void move(std::span<const std::int32_t> pixels, const PixelWeights& weights,
                    const GeometryGradient& gradient) = 0;
  [[nodiscard]] virtual std::vector<glm::vec3> positions_m() const = 0;
};

/// Where queries begin, by config.query.seeding, from the masks of all views with depth; on
/// the grid, too, if the masks agree on no object.
[[nodiscard]] std::vector<QuerySeed> seed_queries(PanopticViews& views,
                                                  const PanopticTrainingConfig& config,
                                                  std::uint64_t seed);

/// What this head needs to know of the masks of all views before it is made: where queries
/// begin, or which masks show one object.
/// @param inputs  The rest of it, already filled.
void prepare_head_inputs(const std::string& head, PanopticViews& views,
                         const PanopticTrainingConfig& config, std::uint64_t seed,
                         PanopticHeadInputs& inputs);

struct PanopticProgress {
  std::int64_t iteration = 0;  ///< Finished.
  std::int64_t iterations = 0;
  std::span<const NamedLoss> losses;  ///< Of this iteration; "total" is the last.
};

struct PanopticTrainingRun {
  PanopticTrainingConfig config;
  std::vector<core::SceneClass> classes;
  std::uint64_t seed = 0;
  /// > 0: the head was loaded from a checkpoint of this iteration.
  std::int64_t first_iteration = 0;
  /// After every iteration; may be empty. @return  False to stop.
  std::function<bool(const PanopticProgress&)> on_progress;
  /// Every checkpoint_every iterations and at the end; may be empty.
  std::function<void(std::int64_t iteration)> on_checkpoint;
  std::int64_t checkpoint_every = 1000;
  /// Fetch weights in a neighbouring view too, for heads with label warping.
  bool warp = false;
  /// Joint training, of a head of joint_head_names(); null: the surfels are frozen.
  MovingSurfels* moving = nullptr;
};

/// @return  The iterations done in all, fewer than configured if on_progress stopped it.
/// @throws core::InputError for bad masks, or losses that are not finite; checkpoints made
///     before stay.
std::int64_t train_panoptic(PanopticViews& views, PanopticHead& head,
                            const PanopticTrainingRun& run);

/// Where the surface points at the pixels of one view are seen in another one: its pixel, or
/// -1 if it is outside, or if the depths differ by more than max_error_m (hidden there).
[[nodiscard]] std::vector<std::int32_t> warp_pixels(
    std::span<const std::int32_t> pixels, const core::Image<float>& depth_m,
    const core::CameraIntrinsics& camera, const core::CameraPose& T_world_camera,
    const core::Image<float>& other_depth_m, const core::CameraIntrinsics& other_camera,
    const core::CameraPose& T_world_other, double max_error_m);

}  // namespace segsim::reconstruction
