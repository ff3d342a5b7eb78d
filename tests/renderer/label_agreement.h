#pragma once

/// @file
/// How much the Top-K selection changes a scene's labels: agreement with the labels of all
/// surfels, for every K and both readings of the rule.

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <sstream>
#include <string>
#include <vector>

#include "core/check.h"
#include "core/render.h"
#include "renderer/scene/render_options.h"

namespace segsim::renderer {

struct LabelAgreement {
  TopKRule rule = TopKRule::kHeaviest;
  int top_k = kAllSurfels;
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
inline void add_labels(const core::Frame& frame, const core::Frame& all_surfels,
                       LabelAgreement& agreement) {
  SEGSIM_CHECK(frame.semantic.size() == frame.alpha.size() &&
                   all_surfels.semantic.size() == all_surfels.alpha.size(),
               "frames without labels");
  SEGSIM_CHECK(frame.semantic.size() == all_surfels.semantic.size(), "size of the frames");
  for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
    if (frame.alpha.pixels()[i] < kMinSurfaceAlpha ||
        all_surfels.alpha.pixels()[i] < kMinSurfaceAlpha) {
      continue;
    }
    const bool semantic = frame.semantic.pixels()[i] == all_surfels.semantic.pixels()[i];
    const bool instance = frame.instance.pixels()[i] == all_surfels.instance.pixels()[i];
    ++agreement.pixels;
    agreement.same_semantic += semantic ? 1 : 0;
    agreement.same_instance += instance ? 1 : 0;
    agreement.same_panoptic += semantic && instance ? 1 : 0;
  }
}

/// Makes a renderer of one scene; called once for every row, and once with kAllSurfels.
using RendererFactory =
    std::function<std::unique_ptr<core::Renderer>(const RenderOptions& options)>;

/// Renders the views with each rule and K.
/// @param options  For everything but K and the rule.
inline std::vector<LabelAgreement> label_agreement(
    const RendererFactory& make_renderer, std::span<const core::CameraPose> T_world_camera,
    const core::CameraIntrinsics& intrinsics, std::span<const int> top_ks,
    const RenderOptions& options = {}) {
  RenderOptions with = options;
  with.top_k = kAllSurfels;
  const auto all = make_renderer(with);
  std::vector<core::Frame> expected;
  for (const core::CameraPose& pose : T_world_camera) {
    expected.push_back(all->render(pose, intrinsics, core::Channels::kAll));
  }
  std::vector<LabelAgreement> rows;
  for (const TopKRule rule : {TopKRule::kHeaviest, TopKRule::kFirst}) {
    for (const int top_k : top_ks) {
      with.top_k = top_k;
      with.top_k_rule = rule;
      const auto renderer = make_renderer(with);
      LabelAgreement row{.rule = rule, .top_k = top_k};
      for (std::size_t view = 0; view < T_world_camera.size(); ++view) {
        const core::Frame frame =
            renderer->render(T_world_camera[view], intrinsics, core::Channels::kAll);
        add_labels(frame, expected[view], row);
        row.feature_fetches += frame.stats.feature_fetches;
      }
      rows.push_back(row);
    }
  }
  return rows;
}

/// CSV with a header line: rule,top_k,pixels,semantic,instance,panoptic,feature_fetches, where
/// top_k is "all" for kAllSurfels and the three are shares.
inline std::string agreement_csv(std::span<const LabelAgreement> rows) {
  std::ostringstream out;
  out << "rule,top_k,pixels,semantic,instance,panoptic,feature_fetches\n";
  for (const LabelAgreement& row : rows) {
    out << (row.rule == TopKRule::kHeaviest ? "heaviest" : "first") << ','
        << (row.top_k == kAllSurfels ? std::string("all") : std::to_string(row.top_k)) << ','
        << row.pixels << ',' << row.share(row.same_semantic) << ','
        << row.share(row.same_instance) << ',' << row.share(row.same_panoptic) << ','
        << row.feature_fetches << '\n';
  }
  return out.str();
}

}  // namespace segsim::renderer
