#include "reconstruction/training/training_evaluation.h"

#include <cmath>
#include <map>
#include <string>

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

TEST(HeldOutQuality, WhatWasMeasuredIsARowOfARecord) {
  EXPECT_TRUE(HeldOutQuality().measured("nothing").empty());
  HeldOutQuality quality;
  const core::Image<core::Rgb8> grey(16, 16, {100, 100, 100}), light(16, 16, {110, 110, 110});
  quality.color.add(grey, light);
  quality.gain_fitted_color.add(grey, grey);  // Equal: its PSNR is infinite, so none.
  quality.depth.add(core::Image<float>(16, 16, 2.1F), core::Image<float>(16, 16, 2.0F));
  std::map<std::string, core::MeasuredValue> values;
  for (const core::MeasuredValue& value : quality.measured("30000 steps")) {
    EXPECT_EQ(value.case_name, "30000 steps");
    EXPECT_TRUE(values.emplace(value.name, value).second) << value.name;
  }
  EXPECT_NEAR(values.at("PSNR").value, 10.0 * std::log10(255.0 * 255.0 / 100.0), 1e-9);
  EXPECT_EQ(values.at("PSNR").unit, "dB");
  EXPECT_FALSE(values.contains("PSNR with a fitted gain"));
  EXPECT_NEAR(values.at("depth L1").value, 10.0, 1e-4);
  EXPECT_NEAR(values.at("depth RMS").value, 10.0, 1e-4);
  EXPECT_NEAR(values.at("depth, relative error").value, 5.0, 1e-4);
  EXPECT_DOUBLE_EQ(values.at("depth within a factor of 1.25").value, 100.0);
  EXPECT_FALSE(values.contains("PQ"));
}

}  // namespace
}  // namespace segsim::reconstruction
