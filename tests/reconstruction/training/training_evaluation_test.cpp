#include "reconstruction/training/training_evaluation.h"

#include <gtest/gtest.h>

#include "core/check.h"

namespace segsim::reconstruction {
namespace {

TEST(ExposureBetween, IsLinearInTheFramesAndConstantAtTheEnds) {
  TrainingSet set;
  for (const std::size_t frame : {2U, 6U}) {
    set.training.emplace_back();
    set.training.back().frame = frame;
  }
  const std::vector<Exposure> exposures{
      {.gain = {1.0F, 2.0F, 4.0F}, .offset = {0.0F, 0.1F, 0.0F}},
      {.gain = {2.0F, 2.0F, 0.0F}, .offset = {0.4F, 0.1F, 0.0F}}};
  const Exposure between = exposure_between(set, exposures, 3);
  EXPECT_FLOAT_EQ(between.gain.r, 1.25F);
  EXPECT_FLOAT_EQ(between.gain.g, 2.0F);
  EXPECT_FLOAT_EQ(between.gain.b, 3.0F);
  EXPECT_FLOAT_EQ(between.offset.r, 0.1F);
  EXPECT_FLOAT_EQ(between.offset.g, 0.1F);
  EXPECT_EQ(exposure_between(set, exposures, 0).gain, exposures[0].gain);
  EXPECT_EQ(exposure_between(set, exposures, 9).gain, exposures[1].gain);
  EXPECT_THROW((void)exposure_between(set, {exposures[0]}, 3), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::reconstruction
