#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <numeric>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/training/training.h"
#include "perception/training/training_config.h"
#include "perception/yolov13/model.h"
#include "tests/perception/training_pictures.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

/// The published options, but for a budget of seconds.
TrainOptions short_options(const tests::TemporaryFolder& folder) {
  TrainOptions options = default_train_options("yolov13n");
  options.train_json = folder / "train.json";
  options.output = folder / "yolo.bin";
  options.input_px = 64;
  options.epochs = 0;
  options.steps = 4;
  options.batch = 3;
  options.nominal_batch = 0;
  options.warmup_steps = 2;
  options.ema_decay = 0.9;
  options.ema_ramp_steps = 1.0;
  options.threads = 1;
  options.checkpoint_every = 0;
  options.show_progress = false;
  return options;
}

TEST(Yolov13Training, LearnsThreePicturesByHeart) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = short_options(folder);
  options.augment = false;
  options.steps = 40;
  options.optimizer = Optimizer::kAdamW;
  options.learning_rate = 4e-3;
  options.warmup_bias_rate = 0.0;
  const TrainReport report = train(options);
  EXPECT_EQ(report.parameters, yolov13::Model(yolov13::Scale::kN, 2).parameter_count());
  // The first losses say little: targets are as large as the CIoU of the present boxes, so the
  // loss rises until boxes overlap (seen: 0.6, 7.7 in step 6, 2.0 in step 30).
  ASSERT_EQ(report.losses.size(), 40U);
  const double peak = *std::max_element(report.losses.begin(), report.losses.end());
  const double end = std::accumulate(report.losses.end() - 5, report.losses.end(), 0.0) / 5.0;
  EXPECT_LT(end, peak / 2.5) << testing::PrintToString(report.losses);
}

TEST(Yolov13Training, ResumedRunEqualsUninterruptedRun) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  // Everything that has a memory: SGD's momentum, mosaics until they close, gathered batches,
  // the best of the validations, dropout.
  TrainOptions whole = short_options(folder);
  whole.optimizer = Optimizer::kSgd;
  whole.closing_steps = 1;
  whole.batch = 2;
  whole.nominal_batch = 4;
  whole.validation_json = whole.train_json;
  whole.validate_every = 2;
  const TrainReport report = train(whole);
  ASSERT_EQ(report.losses.size(), 4U);

  TrainOptions broken = whole;
  broken.output = folder / "broken.bin";
  broken.on_step = [](int done, double) { return done != 2; };
  EXPECT_FALSE(train(broken).finished);
  broken.on_step = nullptr;
  const TrainReport second = train(broken);
  EXPECT_EQ(second.first_step, 2);
  ASSERT_EQ(second.losses.size(), 2U);
  EXPECT_EQ(second.losses[0], report.losses[2]);
  EXPECT_EQ(second.losses[1], report.losses[3]);
  EXPECT_EQ(second.best_step, report.best_step);
  EXPECT_EQ(core::read_file(whole.output), core::read_file(broken.output));
}

TEST(Yolov13Training, OtherClassesKeepEverythingButTheClassBranches) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = short_options(folder);
  options.steps = 1;
  // 70 classes make the class branches of scale n wider than two do.
  options.class_names = {"cold", "warm"};
  for (int i = 2; i < 70; ++i) options.class_names.push_back("class " + std::to_string(i));
  (void)train(options);
  const DetectorWeights before = read_weights(options.output);

  TrainOptions finetune = short_options(folder);
  finetune.initial_weights = options.output;
  finetune.output = folder / "two.bin";
  finetune.class_names = {"warm", "cold"};
  finetune.steps = 1;
  finetune.frozen = {"backbone"};
  for (int layer = 9; layer < 32; ++layer) {
    const bool has_parameters = layer != 10 && layer != 15 && layer != 16 && layer != 19 &&
                                layer != 20 && layer != 25 && layer != 29;
    if (has_parameters) finetune.frozen.push_back("model." + std::to_string(layer));
  }
  finetune.frozen.push_back("model.32.cv2");
  (void)train(finetune);
  const DetectorWeights after = read_weights(finetune.output);
  EXPECT_EQ(after.architecture, "yolov13-n/1");
  EXPECT_EQ(after.class_names, finetune.class_names);
  ASSERT_EQ(after.tensors.size(), before.tensors.size());
  int kept = 0, anew = 0;
  for (std::size_t i = 0; i < before.tensors.size(); ++i) {
    const std::string& name = before.tensors[i].name;
    ASSERT_EQ(after.tensors[i].name, name);
    if (name.rfind("model.32.cv3.", 0) == 0) {
      anew += after.tensors[i].shape != before.tensors[i].shape ? 1 : 0;
      continue;
    }
    ++kept;
    EXPECT_EQ(after.tensors[i].values, before.tensors[i].values) << name;
  }
  EXPECT_GT(kept, 500);
  EXPECT_GT(anew, 10);
}

TEST(Yolov13Training, CudaIsRefusedWhereThereIsNone) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = short_options(folder);
  options.device = TrainDevice::kCuda;
  options.mixed_precision = true;
  options.steps = 2;
  if (torch::cuda::is_available()) {
    EXPECT_EQ(train(options).steps_done, 2);
    return;
  }
  try {
    (void)train(options);
    FAIL() << "trained on CUDA, which is not there";
  } catch (const core::InputError& error) {
    EXPECT_THAT(error.what(),
                testing::HasSubstr("training: device: expected cpu, found cuda"));
  }
}

}  // namespace
}  // namespace segsim::perception
