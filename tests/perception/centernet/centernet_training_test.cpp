#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "core/file_io.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/training/training.h"
#include "perception/training/training_config.h"
#include "tests/perception/training_pictures.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

/// The recipe, but for a budget of seconds.
TrainOptions short_options(const tests::TemporaryFolder& folder) {
  TrainOptions options = default_train_options("centernet");
  options.train_json = folder / "train.json";
  options.output = folder / "center.bin";
  options.input_px = 64;
  options.steps = 4;
  options.batch = 3;
  options.warmup_steps = 2;
  options.ema_decay = 0.9;
  options.ema_ramp_steps = 1.0;
  options.checkpoint_every = 0;
  options.show_progress = false;
  return options;
}

TEST(CenterNetTraining, LearnsThreePicturesByHeart) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = short_options(folder);
  options.augment = false;
  options.steps = 40;
  options.learning_rate = 1e-3;
  options.class_rate = 1.0;
  const TrainReport report = train(options);
  ASSERT_EQ(report.losses.size(), 40U);
  for (const double loss : report.losses) ASSERT_TRUE(std::isfinite(loss));
  const double end = std::accumulate(report.losses.end() - 5, report.losses.end(), 0.0) / 5.0;
  EXPECT_LT(end, report.losses.front() / 2.0) << testing::PrintToString(report.losses);
  EXPECT_EQ(read_weights(options.output).architecture, DetectorWeights::kCenterNet);
}

TEST(CenterNetTraining, ResumedRunEqualsUninterruptedRun) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  const TrainOptions whole = short_options(folder);
  const TrainReport report = train(whole);
  TrainOptions broken = whole;
  broken.output = folder / "broken.bin";
  broken.on_step = [](int done, double) { return done != 2; };
  EXPECT_FALSE(train(broken).finished);
  broken.on_step = nullptr;
  EXPECT_EQ(train(broken).losses[1], report.losses[3]);
  EXPECT_EQ(core::read_file(whole.output), core::read_file(broken.output));
}

/// Largest change of any value of a tensor.
double change(const NamedTensor& before, const NamedTensor& after) {
  double most = 0.0;
  for (std::size_t i = 0; i < before.values.size(); ++i) {
    most = std::max(most, std::abs(double{before.values[i]} - after.values[i]));
  }
  return most;
}

TEST(CenterNetTraining, NewClassesTakeTheRowsOfTheirNamesAndLearnFaster) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = short_options(folder);
  options.class_names = {"person", "cold", "warm", "zebra"};
  options.steps = 1;
  (void)train(options);
  const DetectorWeights before = read_weights(options.output);

  TrainOptions tune = default_train_options("centernet");
  tune.train_json = options.train_json;
  tune.initial_weights = options.output;
  tune.output = folder / "tuned.bin";
  tune.class_names = {"warm", "cold"};
  tune.batch = 1;
  tune.steps = 1;
  tune.warmup_steps = 0;
  tune.ema_decay = 0.0;
  tune.weight_decay = 0.0;
  tune.checkpoint_every = 0;
  tune.show_progress = false;
  tune.frozen = {"backbone"};
  (void)train(tune);
  const DetectorWeights after = read_weights(tune.output);
  EXPECT_EQ(after.class_names, tune.class_names);
  EXPECT_EQ(after.input_px, 64);
  std::map<std::string, const NamedTensor*> tuned;
  for (const NamedTensor& tensor : after.tensors) tuned[tensor.name] = &tensor;
  double body = 0.0, class_rows = 0.0;
  for (const NamedTensor& tensor : before.tensors) {
    const NamedTensor& now = *tuned.at(tensor.name);
    if (tensor.name.rfind("class_head.last", 0) == 0) {
      const std::size_t row = tensor.values.size() / 4;
      for (const auto& [old_row, new_row] :
           {std::pair<std::size_t, std::size_t>{2, 0}, {1, 1}}) {
        const auto part = [row](const NamedTensor& t, std::size_t r) {
          const auto first = t.values.begin() + static_cast<std::ptrdiff_t>(r * row);
          return NamedTensor{"", {}, {first, first + static_cast<std::ptrdiff_t>(row)}};
        };
        class_rows = std::max(class_rows, change(part(tensor, old_row), part(now, new_row)));
      }
      continue;
    }
    const bool frozen = tensor.name.rfind("stem", 0) == 0 ||
                        tensor.name.rfind("blocks", 0) == 0 ||
                        tensor.name.rfind("widen", 0) == 0;
    if (frozen) {
      EXPECT_EQ(now.values, tensor.values) << tensor.name;
    }
    body = std::max(body, change(tensor, now));
  }
  // The first step of Adam moves everything by the rate.
  EXPECT_NEAR(body, 1e-4, 2e-5);
  EXPECT_NEAR(class_rows, 1e-3, 2e-4);
}

}  // namespace
}  // namespace segsim::perception
