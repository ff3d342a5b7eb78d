#include "reconstruction/training/training_config.h"

#include <filesystem>
#include <string>

#include <gmock/gmock.h>

#include "core/error.h"
#include "core/file_io.h"

namespace segsim::reconstruction {
namespace {

using ::testing::HasSubstr;

std::string error_of(const std::string& text) {
  try {
    (void)parse_training_config(text, "mine.yaml");
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "no error";
}

/// The documented file and the program must say the same, key for key.
TEST(TrainingConfig, DefaultsFileIsTheDefault) {
  const std::filesystem::path file = SEGSIM_TRAINING_DEFAULTS;
  const TrainingConfig read = read_training_config(file);
  const std::string expected = training_config_text(TrainingConfig{});
  EXPECT_EQ(training_config_text(read), expected);

  // Every key has a line of its own: the key at the same depth, in the same order.
  const std::string text = core::read_file(file);
  std::size_t at = 0;
  std::size_t begin = 0;
  while (begin < expected.size()) {
    const std::size_t end = expected.find('\n', begin);
    const std::string line = expected.substr(begin, end - begin);
    const std::string key = "\n" + line.substr(0, line.find(':') + 1);
    at = text.find(key, at);
    ASSERT_NE(at, std::string::npos) << "defaults.yaml lacks \"" << line << "\"";
    begin = end + 1;
  }
}

TEST(TrainingConfig, NamesASubset) {
  const TrainingConfig config = parse_training_config(
      "geometry: {iterations: 77, loss: {ssim: 0.5}}\n"
      "panoptic: {query: {variant: literal}, void_policy: negative}\n",
      "mine.yaml");
  EXPECT_EQ(config.geometry.iterations, 77);
  EXPECT_EQ(config.geometry.loss.ssim, 0.5);
  EXPECT_EQ(config.geometry.loss.depth, GeometryConfig{}.loss.depth);
  EXPECT_EQ(config.panoptic.query.variant, renderer::LabelVariant::kLiteral);
  EXPECT_EQ(config.panoptic.void_policy, VoidPolicy::kNegative);
  const std::string text = training_config_text(config);
  EXPECT_EQ(training_config_text(parse_training_config(text, "copy")), text);
}

TEST(TrainingConfig, BadInput) {
  EXPECT_THAT(error_of("geometry: {iterations: 10, los: {}}"),
              ::testing::AllOf(HasSubstr("mine.yaml:1"), HasSubstr("loss")));
  EXPECT_THAT(error_of("geometry:\n  loss:\n    ssim: 1.5\n"),
              ::testing::AllOf(HasSubstr("mine.yaml:3"), HasSubstr("[0, 1]")));
  EXPECT_THAT(error_of("geometry: {loss: {ssim: .nan}}"), HasSubstr("a finite number"));
  EXPECT_THAT(error_of("geometry: {sh_degree: 4}"), HasSubstr("[0, 3]"));
  EXPECT_THAT(error_of("panoptic: {query: {variant: soft}}"), HasSubstr("normalised"));
  EXPECT_THAT(error_of("geometry: {loss: {min_depth_m: 5, max_depth_m: 4}}"),
              HasSubstr("min_depth_m < max_depth_m"));
  EXPECT_THAT(error_of("panoptic: {query: {min_sigma_m: 3}}"), HasSubstr("initial_sigma_m"));
  EXPECT_THAT(error_of("panoptic: {sampling: {stuff_share: 0.9}}"),
              HasSubstr("instance_share"));
  EXPECT_THAT(error_of("- 1"), HasSubstr("mine.yaml"));
}

}  // namespace
}  // namespace segsim::reconstruction
