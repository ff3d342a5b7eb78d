#include "perception/training/training.h"

#include <atomic>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/data/image_file.h"
#include "perception/detector/detector.h"
#include "perception/detector/evaluate.h"
#include "perception/training/training_config.h"
#include "tests/error_message.h"
#include "tests/perception/training_pictures.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using core::Image;
using core::Rgb8;
using testing::HasSubstr;

TrainOptions tiny_options(const tests::TemporaryFolder& folder) {
  TrainOptions options;
  options.train_json = folder / "train.json";
  options.output = folder / "weights.bin";
  options.width = 0.25;
  options.input_px = 64;
  options.steps = 6;
  options.batch = 3;
  options.warmup_steps = 2;
  options.threads = 1;
  options.checkpoint_every = 0;
  options.show_progress = false;
  return options;
}

std::string message_of(const TrainOptions& options) {
  return tests::input_error_of([&] { (void)train(options); });
}

TEST(Training, LearnsThreePicturesByHeart) {
  const tests::TemporaryFolder folder;
  const auto json = write_rectangles(folder);
  TrainOptions options = tiny_options(folder);
  options.width = 0.5;
  options.input_px = 128;
  options.steps = 160;
  options.warmup_steps = 10;
  options.augment = false;
  options.learning_rate = 4e-3;
  const TrainReport report = train(options);
  EXPECT_TRUE(report.finished);
  EXPECT_LT(report.losses.back(), 0.5 * report.losses.front());

  const EvaluationReport evaluation = evaluate(options.output, json);
  EXPECT_GT(evaluation.precision.ap50, 0.9);
  EXPECT_GT(evaluation.precision.ap, 0.5);
  EXPECT_EQ(evaluation.precision.operating.missed, 0);
  EXPECT_EQ(report.operating.f1(), evaluation.precision.operating.f1());

  // The pictures as test cards: with red and blue exchanged, warm and cold are too. A detector
  // that read BGR would do the opposite.
  const auto detector = load_detector(options.output);
  EXPECT_EQ(detector->class_names(), (std::vector<std::string>{"cold", "warm"}));
  std::vector<ImageResult> as_is, exchanged;
  const CocoDataset dataset = read_coco(json);
  for (const LabeledImage& entry : dataset.images) {
    Image<Rgb8> card = read_image(dataset.image_file(entry));
    core::Observation observation;
    observation.rgb = &card;
    as_is.push_back({entry.boxes, detector->detect(observation)});
    const auto again = detector->detect(observation);  // Bit for bit the same.
    ASSERT_EQ(again.size(), as_is.back().detections.size());
    for (std::size_t i = 0; i < again.size(); ++i) {
      EXPECT_EQ(again[i].score, as_is.back().detections[i].score);
      EXPECT_EQ(again[i].box.x0, as_is.back().detections[i].box.x0);
    }
    for (Rgb8& pixel : card.pixels()) std::swap(pixel.r, pixel.b);
    exchanged.push_back({entry.boxes, detector->detect(observation)});
  }
  EXPECT_GT(average_precision(as_is, 2, 0.5F).ap50, 0.9);
  EXPECT_LT(average_precision(exchanged, 2, 0.5F).ap50, 0.5);
}

TEST(Training, ResumedRunEqualsUninterruptedRun) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions whole = tiny_options(folder);
  const TrainReport report = train(whole);

  TrainOptions broken = tiny_options(folder);
  broken.output = folder / "broken.bin";
  broken.on_step = [](int done, double) { return done != 4; };
  const TrainReport first = train(broken);
  EXPECT_FALSE(first.finished);
  EXPECT_FALSE(std::filesystem::exists(broken.output));
  EXPECT_TRUE(std::filesystem::exists(folder / "broken.bin.state"));
  broken.on_step = nullptr;
  const TrainReport second = train(broken);
  EXPECT_EQ(second.first_step, 4);
  EXPECT_TRUE(second.finished);
  EXPECT_FALSE(std::filesystem::exists(folder / "broken.bin.state"));

  ASSERT_EQ(second.losses.size(), 2U);
  EXPECT_EQ(second.losses[0], report.losses[4]);
  EXPECT_EQ(second.losses[1], report.losses[5]);
  EXPECT_EQ(core::read_file(whole.output), core::read_file(broken.output));
}

/// Trains with several seeds, one after another and side by side.
void expect_equal_side_by_side(const std::string& model, int seeds, int thread_count) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  const auto options = [&](const std::string& name, int seed) {
    TrainOptions o = default_train_options(model);
    const TrainOptions tiny = tiny_options(folder);
    o.train_json = tiny.train_json;
    o.output = folder / (name + std::to_string(seed) + ".bin");
    o.width = tiny.width;
    o.input_px = tiny.input_px;
    o.epochs = 0;
    o.steps = 3;
    o.batch = 2;
    o.nominal_batch = 0;
    o.warmup_steps = o.closing_steps = 0;
    o.seed = static_cast<std::uint64_t>(seed);
    o.threads = thread_count;
    o.checkpoint_every = 0;
    o.show_progress = false;
    return o;
  };
  for (int seed = 0; seed < seeds; ++seed) (void)train(options("alone", seed));
  std::vector<std::thread> trainings;
  for (int seed = 0; seed < seeds; ++seed) {
    trainings.emplace_back([&, seed] { (void)train(options("beside", seed)); });
  }
  EXPECT_EQ(threads(), 1);  // Nobody else's count is touched.
  std::atomic<bool> done = false;
  std::thread bystander([&] {
    while (!done) (void)torch::rand({16});  // Moves libtorch's one generator of the process.
  });
  for (std::thread& thread : trainings) thread.join();
  done = true;
  bystander.join();
  EXPECT_EQ(threads(), 1);
  for (int seed = 0; seed < seeds; ++seed) {
    const std::string name = std::to_string(seed) + ".bin";
    EXPECT_EQ(core::sha256_of_file(folder / ("alone" + name)),
              core::sha256_of_file(folder / ("beside" + name)))
        << model << ", seed " << seed;
  }
  EXPECT_NE(core::read_file(folder / "beside0.bin"), core::read_file(folder / "beside1.bin"));
}

TEST(Training, SideBySideEqualsOneAfterAnother) { expect_equal_side_by_side("small", 3, 1); }

TEST(Training, SideBySideWithTwoThreadsEach) { expect_equal_side_by_side("small", 2, 2); }

/// YOLOv13 has dropout.
TEST(Training, SideBySideWithDropout) { expect_equal_side_by_side("yolov13n", 2, 1); }

TEST(Training, StateOfAnotherRunIsRefused) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = tiny_options(folder);
  options.on_step = [](int done, double) { return done != 2; };
  (void)train(options);
  options.rename = {{"cold", ""}};
  options.class_names = {"cold", "warm"};  // As without.
  EXPECT_THAT(message_of(options), HasSubstr("weights.bin.state"));
  options.rename.clear();
  options.learning_rate *= 2;
  EXPECT_THAT(message_of(options), HasSubstr("weights.bin.state"));
  core::write_file_atomically(folder / "weights.bin.state",
                              [](std::ostream& out) { out << "not an archive"; });
  EXPECT_THAT(message_of(options), HasSubstr("weights.bin.state: expected a training state"));
}

TEST(Training, FineTuningMatchesClassesByName) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = tiny_options(folder);
  (void)train(options);

  // A vanishing rate keeps the weights: the row of "warm" must appear at its new index.
  TrainOptions finetune = tiny_options(folder);
  finetune.initial_weights = options.output;
  finetune.output = folder / "finetuned.bin";
  finetune.class_names = {"warm", "new", "cold"};
  finetune.learning_rate = 1e-12;
  finetune.steps = 1;
  (void)train(finetune);
  const auto values = [](const DetectorWeights& weights) {
    for (const NamedTensor& tensor : weights.tensors) {
      if (tensor.name == "class0.last.weight") return tensor.values;
    }
    return std::vector<float>();
  };
  const DetectorWeights after = read_weights(finetune.output);
  const auto before_rows = values(read_weights(options.output)), after_rows = values(after);
  const std::size_t row = before_rows.size() / 2;
  ASSERT_EQ(after_rows.size(), 3 * row);
  EXPECT_EQ(after.class_names, finetune.class_names);
  for (std::size_t i = 0; i < row; ++i) {
    EXPECT_NEAR(after_rows[i], before_rows[row + i], 1e-4);
    EXPECT_NEAR(after_rows[2 * row + i], before_rows[i], 1e-4);
  }

  finetune.class_names = {"warm"};
  EXPECT_THAT(message_of(finetune), HasSubstr("cold"));
  finetune.rename = {{"cold", ""}};
  EXPECT_EQ(message_of(finetune), "no error");
}

TEST(Training, WrongOptionsAreNamed) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = tiny_options(folder);
  options.input_px = 100;
  EXPECT_THAT(message_of(options), HasSubstr("input_px: expected a multiple of 32"));
  options = tiny_options(folder);
  options.mix_share = 1.0;
  EXPECT_THAT(message_of(options), HasSubstr("mix_share"));
  options.mix_json = options.train_json;
  for (const double share : {0.1, 0.9}) {  // Of 3: none, and all.
    options.mix_share = share;
    EXPECT_THAT(message_of(options),
                HasSubstr("mix_share: expected a share that is at least"));
  }
  options = tiny_options(folder);
  options.train_json = folder / "none.json";
  EXPECT_THAT(message_of(options), HasSubstr("none.json"));
}

TEST(Training, FrozenLayersAndFrozenStatisticsDoNotMove) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = tiny_options(folder);
  (void)train(options);
  const DetectorWeights before = read_weights(options.output);
  options.initial_weights = options.output;
  options.steps = 3;

  options.output = folder / "frozen_layers.bin";
  options.frozen = {"backbone", "up4.mix"};
  (void)train(options);
  const DetectorWeights layers = read_weights(options.output);
  options.output = folder / "frozen_norms.bin";
  options.frozen.clear();
  options.norm_policy = NormPolicy::kFrozen;
  (void)train(options);
  const DetectorWeights norms = read_weights(options.output);

  int moved_layers = 0;
  for (std::size_t i = 0; i < before.tensors.size(); ++i) {
    const std::string& name = before.tensors[i].name;
    const bool frozen = name.rfind("down", 0) == 0 || name.rfind("stage", 0) == 0 ||
                        name.rfind("up4.mix.", 0) == 0;
    const bool statistic = name.find(".running_") != std::string::npos;
    if (frozen) {
      EXPECT_EQ(layers.tensors[i].values, before.tensors[i].values) << name;
    } else {
      moved_layers += layers.tensors[i].values != before.tensors[i].values ? 1 : 0;
    }
    EXPECT_EQ(norms.tensors[i].values == before.tensors[i].values, statistic) << name;
  }
  EXPECT_GT(moved_layers, 50);

  options.frozen = {"layer77"};
  EXPECT_THAT(message_of(options), HasSubstr("freeze: expected backbone"));
}

TEST(Training, BestOfValidationIsKeptAndPatienceEnds) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = tiny_options(folder);
  options.steps = 40;
  options.validation_json = options.train_json;
  options.validate_every = 2;
  options.patience = 2;
  options.learning_rate = 1e-12;  // Nothing changes, so nothing gets better.
  options.norm_policy = NormPolicy::kFrozen;
  const TrainReport report = train(options);
  EXPECT_TRUE(report.finished);
  EXPECT_TRUE(report.stopped_early);
  EXPECT_EQ(report.best_step, 2);
  EXPECT_EQ(report.steps_done, 6);
  EXPECT_FALSE(std::filesystem::exists(folder / "weights.bin.best"));
  EXPECT_FALSE(std::filesystem::exists(folder / "weights.bin.candidate"));

  // A state that was saved when patience had ended is not trained any further.
  options.output = folder / "stopped.bin";
  options.on_step = [](int done, double) { return done != 6; };
  EXPECT_FALSE(train(options).finished);
  options.on_step = nullptr;
  const TrainReport resumed = train(options);
  EXPECT_TRUE(resumed.finished);
  EXPECT_TRUE(resumed.stopped_early);
  EXPECT_EQ(resumed.best_step, 2);
  EXPECT_EQ(resumed.steps_done, 6);
}

TEST(Training, LossThatIsNoNumberStopsAndKeepsTheWeightsBefore) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = tiny_options(folder);
  options.checkpoint_every = 1;
  options.steps = 4;
  options.on_step = [](int done, double) { return done != 2; };
  (void)train(options);
  const std::string state = core::read_file(folder / "weights.bin.state");
  // A state is only continued by a run of the same options, so another file diverges.
  options.output = folder / "diverged.bin";
  options.class_gain = 1e60;
  EXPECT_THAT(message_of(options), HasSubstr("loss at step 0: expected a finite number"));
  EXPECT_FALSE(std::filesystem::exists(options.output));
  const DetectorWeights kept = read_weights(folder / "diverged.bin.last_good");
  EXPECT_EQ(kept.class_names.size(), 2U);
  EXPECT_EQ(core::read_file(folder / "weights.bin.state"), state);
}

TEST(Training, DataWithoutBoxesAreRefusedAndClassesWithoutAreNamed) {
  const tests::TemporaryFolder folder;
  const auto json = write_rectangles(folder);
  CocoDataset dataset = read_coco(json);
  for (LabeledImage& image : dataset.images) image.boxes.erase(image.boxes.begin());
  write_coco(json, dataset);
  TrainOptions options = tiny_options(folder);
  options.steps = 1;
  EXPECT_EQ(train(options).classes_without_boxes, (std::vector<std::string>{"cold"}));
  for (LabeledImage& image : dataset.images) image.boxes.clear();
  write_coco(json, dataset);
  EXPECT_THAT(message_of(options),
              HasSubstr("train.json: annotations: expected at least one box"));
  dataset.images.clear();
  write_coco(json, dataset);
  EXPECT_THAT(message_of(options), HasSubstr("train.json: images: expected at least one"));
}

TEST(Training, PictureOfOnePixelIsTrainedOnAndSearched) {
  const tests::TemporaryFolder folder;
  CocoDataset dataset;
  dataset.class_names = {"all"};
  LabeledBox box;
  box.box = {0, 0, 1, 1};
  box.area_px2 = 1;
  dataset.images.push_back({0, "dot.png", 1, 1, {box}});
  write_image(folder / "dot.png", Image<Rgb8>(1, 1, {250, 0, 0}));
  write_coco(folder / "train.json", dataset);
  TrainOptions options = tiny_options(folder);
  options.steps = 2;
  (void)train(options);
  const auto detector = load_detector(options.output, {.score_threshold = 0.0F});
  const Image<Rgb8> dot(1, 1, {250, 0, 0});
  core::Observation observation;
  observation.rgb = &dot;
  const auto found = detector->detect(observation);
  EXPECT_FALSE(found.empty());
  for (const core::Detection& detection : found) {
    EXPECT_GE(detection.box.x0, 0.0F);
    EXPECT_LE(detection.box.x1, 1.0F);
  }
}

TEST(Training, DevicesThatAreNotThereAreRefused) {
  const tests::TemporaryFolder folder;
  write_rectangles(folder);
  TrainOptions options = tiny_options(folder);
  options.mixed_precision = true;
  EXPECT_THAT(message_of(options),
              HasSubstr("mixed_precision: expected device cuda, found cpu"));
  options.model = "yolov14";
  EXPECT_THAT(message_of(options), HasSubstr("model: expected one of small, yolov13n"));
}

}  // namespace
}  // namespace segsim::perception
