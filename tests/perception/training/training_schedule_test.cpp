#include "perception/training/internal/training_schedule.h"

#include <gtest/gtest.h>

#include "perception/training/internal/training_inputs.h"
#include "perception/training/training_config.h"

namespace segsim::perception {
namespace {

TEST(TrainingSchedule, WarmUpAndCosineAreThoseOfTheFormula) {
  TrainOptions o;
  o.steps = 100;
  o.learning_rate = 0.2;
  o.final_rate_share = 0.1;
  o.warmup_steps = 3;
  o.momentum = 0.9;
  o.warmup_momentum = 0.5;
  o.warmup_bias_rate = 0.4;
  // First step: a quarter of the way.
  EXPECT_NEAR(rates_at(o, 0).rate, 0.2 * 0.25, 1e-12);
  EXPECT_NEAR(rates_at(o, 0).bias_rate, 0.75 * 0.4 + 0.05, 1e-12);
  EXPECT_NEAR(rates_at(o, 0).momentum, 0.5 + 0.25 * 0.4, 1e-12);
  // Half: the cosine is 0, so 0.1 + 0.9 / 2.
  EXPECT_NEAR(rates_at(o, 50).rate, 0.2 * 0.55, 1e-12);
  EXPECT_NEAR(rates_at(o, 50).bias_rate, 0.2 * 0.55, 1e-12);
  EXPECT_NEAR(rates_at(o, 50).momentum, 0.9, 1e-12);
  o.schedule = Schedule::kLinear;
  EXPECT_NEAR(rates_at(o, 75).rate, 0.2 * (0.1 + 0.9 * 0.25), 1e-12);
  EXPECT_NEAR(rates_at(o, 2).rate, 0.2 * 0.75 * (0.1 + 0.9 * 0.98), 1e-12);
}

TEST(TrainingSchedule, AverageFollowsCloselyAtFirst) {
  TrainOptions o;
  o.ema_decay = 0.9999;
  o.ema_ramp_steps = 2000;
  // 1 - 0.9999 (1 - e^-0.0005) and 1 - 0.9999 (1 - e^-1).
  EXPECT_NEAR(average_follow(o, 1), 0.9995001749, 1e-9);
  EXPECT_NEAR(average_follow(o, 2000), 0.3679426535, 1e-9);
  EXPECT_NEAR(average_follow(o, 1'000'000), 1e-4, 1e-9);
}

TEST(TrainingSchedule, BatchesAreGatheredToTheNominalOne) {
  TrainOptions o;
  o.weight_decay = 5e-4;
  o.batch = 16;
  EXPECT_EQ(batches_per_step(o), 1);
  EXPECT_EQ(step_weight_decay(o), 5e-4);
  o.nominal_batch = 64;
  EXPECT_EQ(batches_per_step(o), 4);
  EXPECT_NEAR(step_weight_decay(o), 5e-4, 1e-12);
  o.batch = 256;
  EXPECT_EQ(batches_per_step(o), 1);
  EXPECT_NEAR(step_weight_decay(o), 2e-3, 1e-12);
  o.batch = 24;  // 2.67 rounds to 3 batches, 72 images.
  EXPECT_EQ(batches_per_step(o), 3);
  EXPECT_NEAR(step_weight_decay(o), 5e-4 * 72 / 64, 1e-12);
}

TEST(TrainingSchedule, EpochsBecomeStepsAndAutoBecomesAnOptimiser) {
  TrainOptions o = default_train_options("yolov13n");
  o.validation_json = "val.json";
  resolve_train_options(o, 1000, 6);  // 16 steps of 64 images pass 1000 once.
  EXPECT_EQ(o.steps, 600 * 16);
  EXPECT_EQ(o.warmup_steps, 100);  // 48, but at least 100.
  EXPECT_EQ(o.closing_steps, 160);
  EXPECT_EQ(o.validate_every, 16);
  EXPECT_EQ(o.optimizer, Optimizer::kAdamW);
  EXPECT_NEAR(o.learning_rate, 1e-3, 1e-12);
  EXPECT_EQ(o.momentum, 0.9);
  EXPECT_EQ(o.warmup_bias_rate, 0.0);

  o = default_train_options("yolov13s");
  resolve_train_options(o, 118287, 80);
  EXPECT_EQ(o.steps, 600 * 1849);
  EXPECT_EQ(o.warmup_steps, 3 * 1849);
  EXPECT_EQ(o.optimizer, Optimizer::kSgd);
  EXPECT_EQ(o.learning_rate, 0.01);
  EXPECT_EQ(o.validate_every, 0);  // Without a validation set.
}

}  // namespace
}  // namespace segsim::perception
