#include "perception/yolov13/tensor_run.h"

#include <gmock/gmock.h>

#include "core/error.h"
#include "core/random.h"
#include "perception/checkpoint/tensor_file.h"
#include "perception/yolov13/model.h"
#include "tests/temporary_folder.h"

namespace segsim::perception::yolov13 {
namespace {

using testing::HasSubstr;

class Yolov13TensorRun : public testing::Test {
 protected:
  Yolov13TensorRun() : model_(Scale::kN, 2, 4) {
    DetectorWeights weights;
    weights.architecture = architecture_of(Scale::kN);
    weights.width = table_of(Scale::kN).width;
    weights.input_px = 64;
    weights.class_names = {"chair", "table"};
    weights.tensors = model_.tensors();
    write_weights(folder_ / "n.weights", weights);
    core::RandomStream random(1, "image");
    for (float& value : images_.values) value = static_cast<float>(random.uniform());
  }
  std::optional<LossValues> run(const std::vector<NamedTensor>& input) {
    write_safetensors(folder_ / "in.safetensors", input);
    return run_on_tensors(folder_ / "n.weights", folder_ / "in.safetensors",
                          folder_ / "out.safetensors");
  }
  std::string refusal(const std::vector<NamedTensor>& input) {
    try {
      (void)run(input);
    } catch (const core::InputError& error) {
      return error.what();
    }
    return "no error";
  }

  tests::TemporaryFolder folder_;
  Model model_;
  NamedTensor images_{"images", {2, 3, 32, 64}, std::vector<float>(2 * 3 * 32 * 64)};
};

TEST_F(Yolov13TensorRun, WritesPredictionsAndLogits) {
  EXPECT_FALSE(run({images_}).has_value());
  const HeadOutput wanted = model_.forward({2, 32, 64, images_.values});
  const TensorFile file = read_tensor_file(folder_ / "out.safetensors");
  ASSERT_EQ(file.tensors.size(), 3U);
  const NamedTensor predictions = file.read(file.tensors[0]);
  EXPECT_EQ(predictions.name, "predictions");
  EXPECT_EQ(predictions.shape, (std::vector<std::int64_t>{2, 6, 32 + 8 + 2}));
  EXPECT_EQ(predictions.values, decode(wanted));
  EXPECT_EQ(file.read(file.tensors[1]).values, wanted.box);
  EXPECT_EQ(file.read(file.tensors[2]).values, wanted.classes);
}

TEST_F(Yolov13TensorRun, ReturnsTheLossIfThereIsATruth) {
  const NamedTensor rows{"truth", {2, 6}, {0, 1, 4, 4, 40, 30, 1, 0, 10, 2, 60, 20}};
  const auto found = run({images_, rows});
  LabeledBox first, second;
  first.class_index = 1;
  first.box = {4, 4, 40, 30};
  second.box = {10, 2, 60, 20};
  const LossValues wanted =
      loss(model_.forward({2, 32, 64, images_.values}), {{first}, {second}});
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->total, wanted.total);
  EXPECT_GT(found->box, 0.0);
}

TEST_F(Yolov13TensorRun, SaysWhatDoesNotFit) {
  EXPECT_THAT(refusal({{"other", {1}, {0.0F}}}),
              HasSubstr("images: expected [batch, 3, height"));
  EXPECT_THAT(refusal({{"images", {1, 3, 32, 40}, std::vector<float>(3 * 32 * 40)}}),
              HasSubstr("found another shape"));
  EXPECT_THAT(refusal({images_, {"truth", {1, 5}, {0, 0, 1, 1, 2}}}),
              HasSubstr("truth: expected [objects, 6]"));
  for (const std::vector<float>& row :
       {std::vector<float>{2, 0, 1, 1, 2, 2}, {0, 2, 1, 1, 2, 2}, {0, 0, 2, 1, 2, 2}}) {
    EXPECT_THAT(refusal({images_, {"truth", {1, 6}, row}}), HasSubstr("truth, row 0"));
  }
}

}  // namespace
}  // namespace segsim::perception::yolov13
