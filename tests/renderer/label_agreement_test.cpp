#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "renderer/cpu_renderer.h"
#include "renderer/scene/room_scene.h"
#include "tests/renderer/label_agreement.h"

namespace segsim::renderer {
namespace {

core::Frame frame_of(std::initializer_list<float> alpha,
                     std::initializer_list<std::uint16_t> semantic,
                     std::initializer_list<std::uint16_t> instance) {
  core::Frame frame;
  const auto n = static_cast<int>(alpha.size());
  frame.alpha = core::Image<float>(n, 1);
  frame.semantic = frame.instance = core::Image<std::uint16_t>(n, 1);
  frame.alpha.pixels() = alpha;
  frame.semantic.pixels() = semantic;
  frame.instance.pixels() = instance;
  return frame;
}

TEST(LabelAgreement, CountsSurfacesOnly) {
  const core::Frame all =
      frame_of({1.0F, 1.0F, 1.0F, 0.4F, 1.0F}, {1, 2, 3, 0, 5}, {1, 2, 3, 0, 5});
  const core::Frame few =
      frame_of({1.0F, 1.0F, 1.0F, 1.0F, 0.3F}, {1, 9, 3, 0, 5}, {1, 2, 8, 0, 5});
  LabelAgreement agreement;
  add_labels(few, all, agreement);
  EXPECT_EQ(agreement.pixels, 3U);
  EXPECT_EQ(agreement.same_semantic, 2U);
  EXPECT_EQ(agreement.same_instance, 2U);
  EXPECT_EQ(agreement.same_panoptic, 1U);
  add_labels(all, all, agreement);
  EXPECT_EQ(agreement.pixels, 7U);
  EXPECT_DOUBLE_EQ(agreement.share(agreement.same_panoptic), 5.0 / 7.0);
  EXPECT_DOUBLE_EQ(LabelAgreement{}.share(0), 1.0);
  core::Frame unlabelled = all;
  unlabelled.semantic = {};
  EXPECT_THROW(add_labels(unlabelled, all, agreement), core::ContractViolation);
  EXPECT_THROW(add_labels(frame_of({1.0F}, {1}, {1}), all, agreement),
               core::ContractViolation);
}

TEST(LabelAgreement, CsvHasALinePerRow) {
  LabelAgreement row{.rule = TopKRule::kFirst, .top_k = 4, .pixels = 8};
  row.same_semantic = 8, row.same_instance = 6, row.same_panoptic = 4;
  row.feature_fetches = 99;
  EXPECT_EQ(agreement_csv(std::vector{row, LabelAgreement{}}),
            "rule,top_k,pixels,semantic,instance,panoptic,feature_fetches\n"
            "first,4,8,1,0.75,0.5,99\nheaviest,all,0,1,1,1,0\n");
}

/// Set SEGSIM_AGREEMENT_CSV to keep the table for a plot.
TEST(LabelAgreement, GrowsWithKInARoom) {
  const auto room =
      std::make_shared<const SurfelCloud>(make_room_scene({.surfel_count = 100'000}));
  const std::vector<int> top_ks = {1, 3, 4, 8, 16, 24, kAllSurfels};
  const std::vector<LabelAgreement> rows = label_agreement(
      [&](const RenderOptions& options) { return make_cpu_renderer(room, options); },
      room_camera_ring(3), room_camera(320, 240), top_ks);
  ASSERT_EQ(rows.size(), 2 * top_ks.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::size_t k = i % top_ks.size();
    EXPECT_EQ(rows[i].top_k, top_ks[k]);
    EXPECT_GT(rows[i].pixels, 200000U);
    const double share = rows[i].share(rows[i].same_panoptic);
    if (top_ks[k] == kAllSurfels) {
      EXPECT_EQ(rows[i].same_panoptic, rows[i].pixels);
    } else if (k > 0) {
      EXPECT_GE(share, rows[i - 1].share(rows[i - 1].same_panoptic) - 2e-3);
      EXPECT_GE(rows[i].feature_fetches, rows[i - 1].feature_fetches);
    }
    EXPECT_GT(share, 0.5);
  }
  // The heaviest K agree better than the first K.
  for (std::size_t k = 0; k + 1 < top_ks.size(); ++k) {
    EXPECT_GE(rows[k].same_panoptic + rows[k].pixels / 500,
              rows[k + top_ks.size()].same_panoptic);
  }
  if (const char* csv = std::getenv("SEGSIM_AGREEMENT_CSV"))
    std::ofstream(csv) << agreement_csv(rows);
}

}  // namespace
}  // namespace segsim::renderer
