#pragma once

/// @file
/// What the kernels share with the host code that launches them: plain structs of device
/// pointers. docs/performance.md walks through the frame.

#include <cstddef>
#include <cstdint>

#include "renderer/scene/surfel_geometry.h"

namespace segsim::renderer::cuda {

inline constexpr int kTilePx = 16;
inline constexpr int kTilePixels = kTilePx * kTilePx;
/// Surfels that share a bounding sphere; internal/packed_surfels.h sorts them.
inline constexpr int kClusterSurfels = 64;
inline constexpr int kMaxCameras = 256;  ///< Of one batch.
inline constexpr int kQueueWords = 8;
/// Surfels with many tiles are put aside in parts, so that many warps share them.
inline constexpr std::size_t kLargePartBytes = 64;

/// The scene, along a Morton curve: entry m of the arrays. Padded to whole clusters with
/// surfels too faint to be drawn.
struct SceneView {
  const float *x_m, *y_m, *z_m;
  const float *ux_m, *uy_m, *uz_m;  ///< s_u t_u
  const float *vx_m, *vy_m, *vz_m;  ///< s_v t_v
  const float* k2;
  const float *nx, *ny, *nz;        ///< Unit normal.
  const float *red, *green, *blue;  /// Of scenes of degree 0.
  const float* sh;                  ///< [padded, coefficients, 3]; null at degree 0.
  const std::uint32_t* id;          ///< Index in the cloud.
  const std::uint32_t* place;       ///< By index in the cloud: m.
  const float* cluster;             ///< [clusters, 4]: centre, radius.
  const std::uint32_t* label;  ///< By index in the cloud: class | instance << 16; or null.
  int sh_degree;
  int clusters;
};

/// A surfel's largest class and query, in one sector.
struct alignas(32) PanopticHead {
  std::uint16_t class_index, query_index;  ///< kNoIndex: there is none.
  float class_score, next_class_score;     ///< The largest and the one after.
  float query_excess, next_query_excess;
  float query_base;
  std::uint32_t unused[2];
};
inline constexpr std::uint16_t kNoIndex = 0xFFFF;

/// Rows of a surfel's scores by index in the cloud, largest first; what a row lacks has index
/// kNoIndex and score 0. Rows are padded to a multiple of eight entries.
struct PanopticRows {
  const std::uint16_t* index;
  const float* score;
  int capacity;
};

/// PanopticField by index in the cloud.
struct PanopticView {
  const PanopticHead* head;  ///< Null: there is no field.
  PanopticRows classes, queries;
  const std::uint16_t* class_id;  ///< By index in the model.
  const std::uint8_t* class_is_thing;
  const std::uint16_t* query_id;
  const std::uint16_t*
      query_class;  ///< PanopticField::instance_class; null: queries have none.
};

/// Features of the scene by index in the cloud; null: none.
struct FeatureView {
  const float* semantic;  ///< [surfels, 16]
  const float* instance;  ///< [surfels, 32]
};

enum SurfelFlags : std::uint32_t {
  kThin = 1,  ///< The low pass may matter.
  kCare = 2,  ///< Reaches the near plane: e must be looked at, and the outline is no ellipse.
};

/// A surfel on the screen of one camera. M' = M sqrt(1 / (2 ln 2)), so that rho' = |M' d|^2 /
/// e^2 is an exponent of 2.
struct alignas(64) SurfelRecord {
  float x0_px, y0_px, m00, m01;
  float m10, m11, g0, g1;
  float c_k2;  ///< k^2 / (2 ln 2): log2 of 255 times the opacity.
  float z0_m, e_min, e_max;
  std::uint32_t rg, b_nx, ny_nz;  ///< Colour and normal as halves.
  std::uint32_t flags;
};
static_assert(sizeof(SurfelRecord) == 64);

/// Entry of a tile's list: depth bits << 32 | index in the cloud << 4 | quarters of the tile
/// that the surfel reaches. Ties of depth are in order of index.
using ListKey = unsigned long long;
inline constexpr int kQuarterBits = 4;
inline constexpr std::size_t kMaxSurfels = std::size_t{1} << (32 - kQuarterBits);

/// Image plane widened by the low pass: it reaches this far past a surfel's outline.
inline constexpr float kFrustumMarginPx = 3.0F;

/// A camera, and its image's sides widened by the low pass: left, right, top, bottom.
struct ViewCamera {
  ProjectionCamera<float> pinhole;
  float slope[4];  ///< x / z, or y / z, of the side.
  float norm[4];   ///< sqrt(1 + slope^2)
};

/// Numbers that a frame leaves behind; see also core::RenderStats.
struct FrameStatus {
  std::uint32_t longest_list;  ///< Longer than the buckets: the frame must be redone.
  std::uint32_t fixed_tiles;   ///< Drawn again with the surfels that culling had left out.
  unsigned long long surfels_projected, pairs_binned, pairs_touched;
  unsigned long long evaluations, contributions, feature_fetches;
};

/// Image `camera` of a channel starts at camera * width * height elements.
struct ImageView {
  std::uint8_t* rgb;  ///< 3 a pixel.
  float* depth_m;
  float* normal;  ///< 3 a pixel.
  float* alpha;
  std::uint16_t *semantic, *instance;
  float *confidence, *instance_confidence;
  float *semantic_feature, *instance_feature;  ///< 16 and 32 a pixel.
};

enum class BoundsRule : int { kAabb, kSnugBox, kAccuTile, kPaper };

/// A batch of frames of one size. Tile (camera, y, x) is number camera * tiles_x * tiles_y + y
/// * tiles_x + x.
struct FrameView {
  int width_px, height_px, tiles_x, tiles_y, cameras;
  float near_m;
  BoundsRule bounds;
  bool colours, normals, labels, features;
  bool labels_only;  ///< Pixels end when their Top-K is final.
  bool median_depth;
  bool culls;       ///< By termination depth.
  bool first_hits;  ///< TopKRule::kFirst.
  int top_k;
  bool counts;  ///< Count contributions too.

  const ViewCamera* camera;           ///< [cameras]
  const ViewCamera* previous_camera;  ///< [cameras]
  SurfelRecord* record;               ///< [cameras, padded surfels]

  std::uint32_t* count;  ///< [tiles] List lengths, also of what did not fit.
  ListKey* bucket;       ///< [tiles, capacity]
  std::uint32_t capacity;
  float* bound_m;            ///< [tiles] Surfels beyond are not listed at first.
  float* ended_m;            ///< [tiles] Depth at which the last frame's tile was finished.
  std::uint8_t* redo;        ///< [tiles] Finished too late: needs the rest of its list.
  std::uint32_t* order;      ///< [tiles] Tiles, longest lists first.
  std::uint32_t* redo_list;  ///< [tiles]
  /// [kQueueWords] Next of `order`; next of `redo_list`; length of that; parts of large
  /// surfels, asked for and stored.
  std::uint32_t* queue;
  std::byte* large;  ///< [large_capacity, kLargePartBytes]
  std::uint32_t large_capacity;
  bool* history;  ///< [cameras] Is ended_m of an earlier frame?
  FrameStatus* status;
  ImageView image;
};

}  // namespace segsim::renderer::cuda
