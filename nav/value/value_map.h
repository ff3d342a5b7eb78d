#pragma once

/// @file
/// VLFM's value map: how much each place promises to lead to the
/// target, with a confidence that falls off the optical axis.
///
///     c(theta) = c_min + (1 - c_min) cos^2( theta / (fov / 2) * pi / 2 ),  c_min = 0.25
///
/// at bearing theta; the paper's formula has c_min = 0. A view counts as far as its depth
/// reaches. Old (c1, v1) and new (c2, v2) of a cell are fused by one of four rules; before it,
/// a new confidence below 0.35 and below the old one counts as 0:
///
///     weighted:  v = (c1 v1 + c2 v2) / (c1 + c2),  c = (c1^2 + c2^2) / (c1 + c2)

#include <optional>
#include <span>

#include "core/stages.h"
#include "nav/grid/grid_layer.h"
#include "nav/grid/growing_frame.h"
#include "nav/mapping/vlfm_rules.h"

namespace segsim::nav {

enum class FusionRule : std::uint8_t {
  kWeighted,       ///< As shipped.
  kMaxConfidence,  ///< The more confident one stays.
  kReplace,        ///< The new view wins, with confidence 1 (ablation).
  kEqualWeighting  ///< Mean of the views' values: every view has confidence 1 (ablation).
};

struct ValueMapOptions {
  GrowthOptions growth;
  FusionRule fusion = FusionRule::kWeighted;
  double min_confidence = 0.25;
  double decision_threshold = 0.35;
  double min_depth_m = 0.5, max_depth_m = 5.0;
  /// Heights above the floor whose nearest depth limits a column's view (Q7 fixed).
  double band_min_m = 0.30, band_max_m = 1.20;
};

/// One cell: value with its confidence; (0, 0) = never seen.
struct ValueCell {
  float confidence = 0.0F, value = 0.0F;
};

/// Confidence at a bearing off the optical axis; `min_confidence` at the edge of the view.
[[nodiscard]] double view_confidence(double bearing_rad, double fov_rad,
                                     double min_confidence = 0.25);

/// One cell's old state and a new view's.
[[nodiscard]] ValueCell fuse(const ValueCell& old, const ValueCell& seen,
                             const ValueMapOptions& options);

/// How far forward each column of the image sees [m]. Published (Q7): the maximum over rows,
/// missing depth counts as far or near by Q8's rule. Fixed: the nearest depth among points in
/// the height band; where there is none, the farthest measured depth; without any, nothing.
[[nodiscard]] std::vector<float> column_limits_m(const core::Observation& observation,
                                                 const ValueMapOptions& options,
                                                 const VlfmRules& rules);

class ValueMap {
 public:
  explicit ValueMap(const ValueMapOptions& options = {}, const VlfmRules& rules = VlfmRules());
  void reset();
  /// Fuses a view that promises `value`.
  void update(const core::Observation& observation, double value);

  /// column_limits_m() of the last view.
  [[nodiscard]] std::span<const float> last_limits_m() const { return limits_m_; }
  [[nodiscard]] const GridFrame& frame() const { return frame_; }
  /// (0, 0) outside of the map.
  [[nodiscard]] ValueCell at(const glm::dvec2& p_odom_m) const;
  [[nodiscard]] const GridLayer<ValueCell>& cells() const { return cells_; }
  /// Median of the values that are not 0 within a disc of cells; nullopt if there is none.
  /// VLFM uses a radius of 0.5 m and -1 for none.
  [[nodiscard]] std::optional<double> median_around(const glm::dvec2& p_odom_m,
                                                    double radius_m = 0.5) const;

 private:
  /// Tables over tan(bearing), even from the left edge of the view to the right one.
  struct ConeTables {
    core::CameraIntrinsics camera;           ///< They hold for this one.
    double left_tan = 0.0, right_tan = 0.0;  ///< Positive tangents of the two half openings.
    std::vector<float> confidence;
    std::vector<std::uint32_t> column;  ///< Of the image, by bearing.
    std::vector<float> limit_m;         ///< Forward distance seen; of one view.
  };
  void make_tables(const core::CameraIntrinsics& camera, std::size_t columns);
  void fuse_cone(const core::Observation& observation, std::span<const float> limits_m,
                 float value);

  ValueMapOptions options_;
  VlfmRules rules_;
  GridFrame frame_;
  GridLayer<ValueCell> cells_;
  ConeTables tables_;
  std::vector<float> limits_m_;
};

}  // namespace segsim::nav
