#pragma once

/// @file
/// How much the Top-K selection changes a scene's labels: agreement with the labels of all
/// surfels, for every K and both readings of the rule.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "core/render.h"
#include "renderer/scene/render_options.h"

namespace segsim::reconstruction {

struct LabelAgreement {
  renderer::TopKRule rule = renderer::TopKRule::kHeaviest;
  int top_k = renderer::kAllSurfels;
  std::uint64_t pixels = 0;  ///< Compared: those with a surface in both pictures.
  std::uint64_t same_semantic = 0, same_instance = 0;
  std::uint64_t same_panoptic = 0;    ///< Both at once.
  std::uint64_t feature_fetches = 0;  ///< Of all views.

  /// Share of the pixels; 1 if there are none.
  [[nodiscard]] double share(std::uint64_t same) const {
    return pixels == 0 ? 1.0 : static_cast<double>(same) / static_cast<double>(pixels);
  }
};

/// Adds the pixels of a frame, compared with the frame of the same view that keeps all
/// surfels.
void add_labels(const core::Frame& frame, const core::Frame& all_surfels,
                LabelAgreement& agreement);

/// Makes a renderer of one scene; called once for every row, and once with kAllSurfels.
using RendererFactory =
    std::function<std::unique_ptr<core::Renderer>(const renderer::RenderOptions& options)>;

/// Renders the views with each rule and K.
/// @param options  For everything but K and the rule.
[[nodiscard]] std::vector<LabelAgreement> label_agreement(
    const RendererFactory& make_renderer, std::span<const core::CameraPose> T_world_camera,
    const core::CameraIntrinsics& intrinsics, std::span<const int> top_ks,
    const renderer::RenderOptions& options = {});

/// CSV with a header line: rule,top_k,pixels,semantic,instance,panoptic,feature_fetches, where
/// top_k is "all" for kAllSurfels and the three are shares.
void write_agreement_csv(const std::filesystem::path& file,
                         std::span<const LabelAgreement> rows);

}  // namespace segsim::reconstruction
