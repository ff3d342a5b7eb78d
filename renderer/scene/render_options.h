#pragma once

/// @file
/// What every surfel renderer can be told, and the constants that they share. The constants
/// are part of the image's definition: changing one changes every picture.

namespace segsim::renderer {

/// Which depth a pixel gets (both along +z, of ray and surfel, not of surfel centres).
enum class DepthMode : unsigned char {
  kMedian,  ///< Of the surfel that brings the transmittance to 0.5 or below: always a surface.
  kExpected,  ///< Mean weighted by alpha * T: smooth, but floats between surfaces at edges.
};

/// Which surfels a tile looks at. All give the same image where they miss nothing; they differ
/// in work. The paper's Table 2 compares them.
enum class TileBounds : unsigned char {
  kAabb,      ///< Square of 3 sigma about the outline's centre, as the 2DGS code bins.
  kSnugBox,   ///< The exact outline's bounding box (Hanson et al. 2025).
  kAccuTile,  ///< Exact tile rows of the outline.
  kPaper,     ///< The paper's own approximate conic; for comparison only, it may miss pixels.
};

/// Whose rules decide about bounds, pixel centres, the near plane, the low pass and depth:
/// checkpoints look best under the rules that they were trained with.
enum class Compat : unsigned char {
  kExact,   ///< This project's: surfel_geometry.h.
  kInria,   ///< hbb1/diff-surfel-rasterization.
  kGsplat,  ///< nerfstudio-project/gsplat, 2DGS.
};

/// Both readings of the paper's "Top-K Hard Selection".
enum class TopKRule : unsigned char {
  kHeaviest,  ///< The K surfels with the largest weight alpha * T.
  kFirst,     ///< The first K that the ray meets.
};

inline constexpr int kAllSurfels = 0;

struct RenderOptions {
  int top_k = 4;  ///< Surfels that vote for a pixel's label, 1 ... 24, or kAllSurfels.
  TopKRule top_k_rule = TopKRule::kHeaviest;
  TileBounds bounds = TileBounds::kAccuTile;
  Compat compat = Compat::kExact;
  float near_m = 0.05F;  ///< Surfels and fragments nearer than this (along +z) are not drawn.
  DepthMode depth = DepthMode::kMedian;
  int threads = 0;  ///< 0 = all processors; 1 = the calling thread only.
  /// Surfels behind finished tiles are neither projected nor binned. The image is the same
  /// without; the counters are then those of a renderer that bins the whole view.
  bool skip_hidden = true;
};

inline constexpr int kMaxTopK = 24;
/// A surfel never hides more than this: keeps 1 - alpha away from 0 (Kerbl et al. 2023).
inline constexpr float kMaxAlpha = 0.99F;
/// Fainter contributions are dropped; it bounds every surfel's extent.
inline constexpr float kMinAlpha = 1.0F / 255.0F;
/// A pixel is finished when the next surfel would bring its transmittance below this; that
/// surfel is not blended. Just under 1e-4, because two surfels at kMaxAlpha leave exactly 1e-4
/// and rounding would decide.
inline constexpr float kStopTransmittance = 0.999e-4F;
/// Depth, normal and labels are given where alpha reaches this; the median depth is that of
/// the surfel at which it does.
inline constexpr float kMinSurfaceAlpha = 0.5F;

/// @throws core::ContractViolation if an option is out of its range.
void check_render_options(const RenderOptions& options);

}  // namespace segsim::renderer
