#pragma once

/// @file
/// What learns labels on surfels. With frozen geometry an image of labels is linear in the
/// surfels' labels, out = W L, so a head sees sparse blending weights W of a few pixels and
/// never the renderer (docs/training.md); in joint training it also says how its loss changes
/// with W:
///
///     frame -> pixels -> W, targets -> step() -> losses          panoptic_training.h
///                                       ...
///                                      result() -> PanopticField, drawn by every renderer
///
/// A head is one file in heads/: a class derived from PanopticHead and a line in
/// make_panoptic_head().

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "core/scene_bundle.h"
#include "reconstruction/labels/panoptic_config.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "renderer/scene/panoptic_field.h"

namespace segsim::reconstruction {

/// Derivatives of a step's loss by what the surfels' geometry decides.
struct GeometryGradient {
  std::vector<float> by_weight;      ///< [entries] of PanopticBatch::weights, as they are.
  std::vector<std::int64_t> surfel;  ///< Whose centres entered the labels, ascending.
  std::vector<float> by_position;    ///< [surfel, 3], world frame.
};

/// Sampled pixels of one image. Borrowed for the call.
struct PanopticBatch {
  std::int64_t frame = 0;  ///< Index of the image.
  /// [pixels] rows, not normalised; pointers are of the head's device.
  PixelWeights weights;
  /// Pixels of a neighbouring frame that show surface points of this one; may be null.
  const PixelWeights* warped = nullptr;
  const std::int64_t* warped_row = nullptr;  ///< [pixels], host; row of `warped`, -1 = none.
  const std::uint16_t* semantic = nullptr;   ///< [pixels], host; class id, 0 = void.
  const std::uint16_t* instance = nullptr;   ///< [pixels], host; id of this frame, 0 = none.
  const float* confidence = nullptr;         ///< [pixels], host, [0, 1]; null = 1.
  /// [pixels], host, mean 1: PixelSample::importance; null = 1.
  const float* importance = nullptr;
  /// Joint training: where step() leaves these derivatives. Null: geometry is frozen.
  GeometryGradient* gradient = nullptr;
};

struct NamedLoss {
  std::string name;
  double value = 0.0;  ///< Times its factor: what enters the sum.
};

/// Trained labels. Query heads give a model and features, which fold into the field; other
/// heads give the field only.
struct PanopticResult {
  std::optional<renderer::PanopticModel> model;
  std::vector<core::SemanticFeature>
      semantic_feature;  ///< [surfels] with a model, else empty.
  std::vector<core::InstanceFeature> instance_feature;  ///< The same.
  renderer::PanopticField field;
};

struct PanopticHeadInputs {
  std::vector<glm::vec3> position_m;  ///< [surfels], world frame, frozen.
  /// [surfels], of SurfelCloud; prepare_head_inputs() of "panoptic-recon" alone reads it.
  std::vector<glm::quat> R_world_surfel;
  std::vector<core::SceneClass> classes;
  /// Query heads: where queries begin (query_seeding.h).
  std::vector<QuerySeed> query_seeds;
  /// Heads that are taught ids that hold in all views: by frame, the object of each mask's id,
  /// from 1. Masks of no object are not in it.
  std::vector<std::map<std::uint16_t, std::uint16_t>> object_of_mask;
  /// "panoptic-recon": the class of each object, the first's first.
  std::vector<std::uint16_t> object_class;
  std::int64_t frames = 1;  ///< Images in the training set.
  int cuda_device = -1;     ///< -1 = CPU.
};

class PanopticHead {
 public:
  virtual ~PanopticHead() = default;
  PanopticHead() = default;
  PanopticHead(const PanopticHead&) = delete;
  PanopticHead& operator=(const PanopticHead&) = delete;

  /// One step of optimisation. On the CPU its result does not depend on the number of threads.
  /// @param iteration  In [0, config.iterations): rates and stages follow from it.
  /// @return  The losses that took part; "total" is the last.
  /// @throws core::InputError if the total is not finite; the parameters are then unchanged.
  virtual std::vector<NamedLoss> step(const PanopticBatch& batch, std::int64_t iteration) = 0;

  /// Joint training: where the surfels are from now on.
  /// @throws core::ContractViolation unless the head is one of joint_head_names().
  virtual void move_surfels(const std::vector<glm::vec3>& position_m);

  [[nodiscard]] virtual PanopticResult result() const = 0;

  /// The whole state (parameters, Adam's moments, counts): training that is loaded goes on as
  /// if it had never stopped.
  virtual void save(const std::filesystem::path& file) const = 0;
  /// @throws core::InputError for a file of another head, another scene, or damaged.
  virtual void load(const std::filesystem::path& file) = 0;
};

/// "query" (the paper), "panoptic-splatting", "panoptic-lifting", "contrastive-lift",
/// "gaussian-grouping", "open-gaussian", "panoptic-recon", "panoptic-recon++", "pvlff".
[[nodiscard]] std::vector<std::string> panoptic_head_names();
/// Those that can be trained together with the surfels (joint_training.h): heads of queries.
[[nodiscard]] std::vector<std::string> joint_head_names();
/// The same in one line. @param between  Stands between two of them.
[[nodiscard]] std::string panoptic_head_list(const std::string& between);

/// @param name  One of panoptic_head_names().
/// @throws core::InputError for another name; core::ContractViolation for inputs or a
///     configuration out of range.
[[nodiscard]] std::unique_ptr<PanopticHead> make_panoptic_head(
    const std::string& name, PanopticHeadInputs inputs, const PanopticTrainingConfig& config,
    std::uint64_t seed);

}  // namespace segsim::reconstruction
