#pragma once

/// @file
/// Classes and instances of a scene whose surfels carry learnt features (paper, "Query-guided
/// Instance Segmentation"). Nothing here depends on the camera: a model is folded into the
/// surfels once per scene, and a frame only reads the few scores that are left.
///
///     surfel g: position p_g, features f_sem (16), f_ins (32)        -> SurfelCloud
///     classes:  p_c(g) = softmax_c(W f_sem + b)                      linear decoder
///     query q:  A(q, g) = sigmoid(f_q . f_ins) phi_q(p_g) / phi_q(p_q)
///               p_q(g) = softmax_q(A(q, g) / tau)                    N queries
///
/// phi_q is the query's normal density, so the ratio is exp(-d^2 / 2) with d the Mahalanobis
/// distance. The paper prints tau = 1; since 0 <= A <= 1 the winner of N = 50 queries then has
/// a probability of 5 % at most. tau = 0.1 gives it 99.8 %.
///
/// The softmax is stored as its sparse excess over 1 / Z. With E_q = exp(A_q / tau) - 1 >= 0
/// and Z = N + sum E_q, p_q = 1/Z + E_q/Z exactly, and nearly all E_q are 0, because queries
/// are local. A row keeps 1/Z (of all queries) and the largest E_q/Z; what it leaves out is
/// reported as DroppedMass.
///
/// A pixel's scores are weighted means of its surfels' probabilities: surfels are decoded,
/// then blended. It is the paper's blending of labels, and all views agree about a surfel.
/// Blending features and decoding the mean (class_probabilities() of Frame::semantic_feature)
/// is another model: a softmax does not commute with a mean.

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include <glm/gtc/quaternion.hpp>
#include <glm/vec3.hpp>

#include "core/render.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

/// How the attention of N queries becomes the label of a surfel. Training and folding use the
/// same one (renderer/training/heads).
///
///     kTemperature  p_q = exp(A_q / tau) / sum exp(A / tau)
///
///     kLiteral      the same with tau = 1, as the paper prints it (an ablation)
///
///     kNormalised   p_q = A_q / (sum A + none)
///
///     kLogSoftmax   softmax(log A, log none): kNormalised without its limit of range
///
///     kRaw          score A_q itself (PanopticRecon++ in training)
///
/// The last three have an extra score "none of the queries" (none / (sum A + none), or `none`
/// for kRaw): a pixel where it wins has instance 0. kNormalised and kRaw take A = 0 beyond
/// four sigma, d^2 > kAttentionReach2 (A < 3.4e-4 there).
enum class LabelVariant : std::uint8_t {
  kTemperature,
  kNormalised,
  kLogSoftmax,
  kRaw,
  kLiteral,
};
inline constexpr double kAttentionReach2 = 16.0;
[[nodiscard]] constexpr bool has_none_score(LabelVariant variant) {
  return variant == LabelVariant::kNormalised || variant == LabelVariant::kLogSoftmax ||
         variant == LabelVariant::kRaw;
}

/// One row of the linear decoder.
struct PanopticClass {
  std::uint16_t id = 0;  ///< Class of the scene's manifest; 0 = void may be listed.
  bool thing = false;    ///< Countable: its pixels have instances.
  core::SemanticFeature weight{};
  float bias = 0.0F;
};

struct InstanceQuery {
  std::uint16_t id = 0;  ///< Instance id of its pixels, > 0.
  glm::vec3 position_m{0.0F};
  /// Covariance R diag(sigma^2) R^T.
  glm::quat R_world_query{1.0F, 0.0F, 0.0F, 0.0F};
  glm::vec3 sigma_m{0.5F};  ///< > 0.
  core::InstanceFeature feature{};
  /// Class of its pixels, a thing of the model's classes; 0: what the surfels say.
  std::uint16_t class_id = 0;
};

struct PanopticModel {
  std::vector<PanopticClass> classes;
  std::vector<InstanceQuery> queries;
  float temperature = 0.1F;  ///< tau > 0.
  LabelVariant variant = LabelVariant::kTemperature;
  float none_score = 0.05F;  ///< >= 0; for variants with has_none_score().
};

/// @throws core::ContractViolation for values out of range, ids given twice, or more than
/// 65535
///     classes or queries.
void check_panoptic_model(const PanopticModel& model);

/// Probabilities of the classes for a semantic feature, in the order of `classes`.
[[nodiscard]] std::vector<double> class_probabilities(const PanopticModel& model,
                                                      const core::SemanticFeature& feature);

/// A(q, g) of every query, in the order of `queries`.
[[nodiscard]] std::vector<double> attention(const PanopticModel& model,
                                            const glm::vec3& position_m,
                                            const core::InstanceFeature& feature);

/// For every surfel a score common to all entries, and the largest excesses over it.
class SparseScores {
 public:
  struct Entry {
    std::uint16_t index;  ///< Of the class or query in the model.
    float excess;         ///< Probability - base, > 0.
  };

  /// @param row_capacity  Entries kept of a surfel.
  SparseScores(std::size_t surfels, std::size_t row_capacity);
  SparseScores() = default;

  [[nodiscard]] std::size_t size() const { return base_.size(); }
  [[nodiscard]] std::size_t row_capacity() const { return row_capacity_; }
  [[nodiscard]] float base(std::size_t surfel) const { return base_[surfel]; }
  /// Largest first.
  [[nodiscard]] std::span<const Entry> row(std::size_t surfel) const {
    return {entries_.data() + surfel * row_capacity_, count_[surfel]};
  }
  [[nodiscard]] std::size_t bytes() const;
  void set(std::size_t surfel, float base, std::span<const Entry> row);

 private:
  std::size_t row_capacity_ = 0;
  std::vector<float> base_;
  std::vector<std::uint16_t> count_;
  std::vector<Entry> entries_;
};

/// Probability that rows leave out: a blended score is too low by the weighted mean of its
/// surfels' dropped mass at most.
struct DroppedMass {
  double mean = 0.0, max = 0.0;  ///< Over surfels.
};

struct FoldOptions {
  int max_classes = 4;  ///< Entries a surfel keeps, >= 1.
  int max_instances = 8;
  /// Excesses E_q and class probabilities below this are dropped; 0 keeps all that fit.
  float min_excess = 1e-3F;
  int threads = 0;  ///< 0 = all processors.
};

/// The model folded into a cloud's surfels.
struct PanopticField {
  /// Base 0: probabilities. Where queries have classes, the surfel's probability of "some
  /// thing" is shared out to the classes of the queries that claim it.
  SparseScores classes;
  /// kTemperature and kLiteral: base 1/Z, excess E_q/Z. Else base 0, the scores themselves.
  SparseScores instances;
  std::vector<std::uint16_t> class_id;  ///< By index in the model.
  /// By index in the model; the none-score, if there is one, is a last entry of id 0.
  std::vector<std::uint16_t> instance_id;
  std::vector<std::uint8_t> class_is_thing;  ///< By index in the model.
  /// Class of an instance's pixels, 0: the class that won there. By index in instance_id;
  /// empty if no query has a class. If it is not empty, thing pixels of no instance are void.
  std::vector<std::uint16_t> instance_class;
  DroppedMass dropped_classes, dropped_instances;

  [[nodiscard]] std::size_t size() const { return classes.size(); }
};

/// Folds the model into the surfels: O(surfels x (classes + queries)), once per scene. Queries
/// farther than E_q = 1e-12 count as E_q = 0.
/// @throws core::ContractViolation if the cloud has no features or a part is out of range.
[[nodiscard]] PanopticField fold_panoptic_model(const SurfelCloud& surfels,
                                                const PanopticModel& model,
                                                const FoldOptions& options = {});

/// Name of the model's file beside a scene's surfels (a bundle's folder, or a PLY's).
inline constexpr const char* kPanopticFileName = "panoptic.bin";

/// File, little-endian; floats are IEEE-754 single precision:
///
///     8 bytes  "SEGSIMPF"
///
///     u32      version = 2 (1: without variant and none, a query's class is 0)
///
///     u64      payload bytes
///
///     64 bytes SHA-256 of the payload, lower-case hexadecimal
///
///     payload  f32 temperature, u32 classes, u32 queries, u32 variant, f32 none,
///
///              class: u16 id, u16 thing (0 or 1), f32 bias, f32 weight[16]
///
///              query: u16 id, u16 class, f32 position[3], f32 rotation[4] (w x y z),
///
///                     f32 sigma[3], f32 feature[32]
///
/// The surfels' own features are in their PLY (ply_io.h).
void write_panoptic_model(const std::filesystem::path& file, const PanopticModel& model);

/// @throws core::InputError for a file that is missing, damaged, of another version, or whose
///     values are out of range.
[[nodiscard]] PanopticModel read_panoptic_model(const std::filesystem::path& file);

}  // namespace segsim::renderer
