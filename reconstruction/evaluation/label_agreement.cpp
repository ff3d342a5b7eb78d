#include "reconstruction/evaluation/label_agreement.h"

#include <ostream>
#include <string>

#include "core/check.h"
#include "core/file_io.h"

namespace segsim::reconstruction {

void add_labels(const core::Frame& frame, const core::Frame& all_surfels,
                LabelAgreement& agreement) {
  SEGSIM_CHECK(frame.semantic.size() == frame.alpha.size() &&
                   all_surfels.semantic.size() == all_surfels.alpha.size(),
               "frames without labels");
  SEGSIM_CHECK(frame.semantic.size() == all_surfels.semantic.size(), "size of the frames");
  for (std::size_t i = 0; i < frame.alpha.size(); ++i) {
    if (frame.alpha.pixels()[i] < renderer::kMinSurfaceAlpha ||
        all_surfels.alpha.pixels()[i] < renderer::kMinSurfaceAlpha) {
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

std::vector<LabelAgreement> label_agreement(const RendererFactory& make_renderer,
                                            std::span<const core::CameraPose> T_world_camera,
                                            const core::CameraIntrinsics& intrinsics,
                                            std::span<const int> top_ks,
                                            const renderer::RenderOptions& options) {
  renderer::RenderOptions with = options;
  with.top_k = renderer::kAllSurfels;
  const auto all = make_renderer(with);
  std::vector<core::Frame> expected;
  for (const core::CameraPose& pose : T_world_camera) {
    expected.push_back(all->render(pose, intrinsics, core::Channels::kAll));
  }
  std::vector<LabelAgreement> rows;
  for (const renderer::TopKRule rule :
       {renderer::TopKRule::kHeaviest, renderer::TopKRule::kFirst}) {
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

void write_agreement_csv(const std::filesystem::path& file,
                         std::span<const LabelAgreement> rows) {
  core::write_file_atomically(file, [rows](std::ostream& out) {
    out << "rule,top_k,pixels,semantic,instance,panoptic,feature_fetches\n";
    for (const LabelAgreement& row : rows) {
      out << (row.rule == renderer::TopKRule::kHeaviest ? "heaviest" : "first") << ','
          << (row.top_k == renderer::kAllSurfels ? std::string("all")
                                                 : std::to_string(row.top_k))
          << ',' << row.pixels << ',' << row.share(row.same_semantic) << ','
          << row.share(row.same_instance) << ',' << row.share(row.same_panoptic) << ','
          << row.feature_fetches << '\n';
    }
  });
}

}  // namespace segsim::reconstruction
