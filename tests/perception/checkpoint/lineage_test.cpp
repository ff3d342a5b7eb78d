#include "perception/checkpoint/lineage.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "perception/data/image_file.h"
#include "perception/training/training.h"
#include "tests/error_message.h"
#include "tests/perception/training_pictures.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using tests::input_error_of;

const std::string kHash(64, 'a'), kOtherHash(64, 'b');

DataUse some_use() {
  DataUse use{DataPurpose::kMix, 2, kHash};
  use.views_sha256 = kOtherHash;
  use.image_hashes = {0x0000000000ffULL, 0xffffffffffffULL};
  use.scenes = std::vector<ImagedScene>{
      {"flat-3", kHash}, {.generator = "source_rooms/1", .first_seed = 1, .last_seed = 250}};
  return use;
}

std::filesystem::path write_with_training(const tests::TemporaryFolder& folder,
                                          const std::string& training) {
  DetectorWeights weights;
  weights.class_names = {"chair"};
  weights.tensors = {{"bias", {1}, {0.5F}}};
  weights.training = training;
  write_weights(folder / "w.weights", weights);
  return folder / "w.weights";
}

TEST(Lineage, RecordComesBackFromAFileAndEqualEntriesStandOnce) {
  const tests::TemporaryFolder folder;
  const DataUse foreign = foreign_data("n.pt", kOtherHash);
  const auto file = write_with_training(
      folder, with_data(R"({"seed":7})", {foreign, some_use(), some_use()}));
  const DetectorWeights read = read_weights(file);
  EXPECT_THAT(read.training, HasSubstr(R"("seed":7)"));
  EXPECT_THAT(data_of(read, file), ElementsAre(foreign, some_use()));
  EXPECT_FALSE(foreign.scenes.has_value());
}

TEST(Lineage, WeightsWithoutARecordAreForeign) {
  const tests::TemporaryFolder folder;
  const auto file = write_with_training(folder, R"({"train_sha256":"78"})");
  EXPECT_FALSE(recorded_data(read_weights(file).training, "w").has_value());
  EXPECT_THAT(data_of(read_weights(file), file),
              ElementsAre(foreign_data("w.weights", core::sha256_of_file(file))));
}

TEST(Lineage, DamagedRecordIsADamagedFile) {
  const tests::TemporaryFolder folder;
  const auto error_of = [&](const std::string& data) {
    const auto file = write_with_training(folder, R"({"data":)" + data + "}");
    return input_error_of([&] { (void)read_weights(file); });
  };
  const auto train = [&](const std::string& rest) {
    return error_of(R"([{"what":"train","images":1,"labels_sha256":")" + kHash + R"(",)" +
                    rest + "}]");
  };
  EXPECT_EQ(train(R"("scenes":"unknown")"), "no error");
  EXPECT_THAT(error_of("7"), HasSubstr("w.weights: training.data: expected a list, found 7"));
  EXPECT_THAT(error_of("[]"), HasSubstr("training.data: expected at least one data set"));
  EXPECT_THAT(error_of(R"([{"what":"seen"}])"),
              HasSubstr("training.data[0].what: expected train, mix, validation or foreign"));
  EXPECT_THAT(error_of(R"([{"what":"foreign","file":"n.pt","sha256":"77"}])"),
              HasSubstr("training.data[0].sha256: expected a SHA-256"));
  EXPECT_THAT(train(R"("scene":[])"),
              HasSubstr("training.data[0].scenes: expected a value, found nothing"));
  EXPECT_THAT(train(R"("scenes":[{"name":"flat-3"}])"),
              HasSubstr("scenes[0].surfels_sha256: expected a value"));
  EXPECT_THAT(train(R"("scenes":[{"generator":"rooms/1","first_seed":5,"last_seed":4}])"),
              HasSubstr("scenes[0].last_seed: expected an integer in [5, "));
  EXPECT_THAT(train(R"("image_hashes":"00ff","scenes":[])"),
              HasSubstr("image_hashes: expected 12 hexadecimal digits for each of 1 images"));
  EXPECT_EQ(train("\"scenes\":7").find('\n'), std::string::npos);
}

CocoDataset pictures(const tests::TemporaryFolder& folder,
                     const std::vector<core::Image<core::Rgb8>>& images) {
  CocoDataset dataset;
  dataset.folder = folder.path();
  for (std::size_t i = 0; i < images.size(); ++i) {
    LabeledImage entry{static_cast<std::int64_t>(i),
                       "p" + std::to_string(i) + ".png",
                       images[i].width_px(),
                       images[i].height_px(),
                       {}};
    write_image(folder / entry.file, images[i]);
    dataset.images.push_back(entry);
  }
  return dataset;
}

TEST(Lineage, ImagesAreKnownByTheirPixels) {
  const tests::TemporaryFolder folder;
  const core::Image<core::Rgb8> dot(1, 1, {255, 0, 7}), wide(4, 2, {1, 2, 3}),
      high(2, 4, {1, 2, 3});
  const DataUse one = data_use(DataPurpose::kTrain, pictures(folder, {dot}));
  // By hand: the size, then the bytes.
  const std::string dot_sha256 = core::sha256_hex(std::string("1x1:\xff\x00\x07", 7));
  EXPECT_THAT(one.image_hashes,
              ElementsAre(std::stoull(dot_sha256.substr(0, 12), nullptr, 16)));
  EXPECT_EQ(one.views_sha256, core::sha256_hex(dot_sha256));

  // Another order and other names: the same views. The same bytes in another shape: others.
  const DataUse first = data_use(DataPurpose::kTrain, pictures(folder, {dot, wide}));
  const DataUse second = data_use(DataPurpose::kValidation, pictures(folder, {wide, dot}));
  EXPECT_EQ(first.views_sha256, second.views_sha256);
  EXPECT_TRUE(has_image(first, one.image_hashes[0]));
  const DataUse other = data_use(DataPurpose::kTrain, pictures(folder, {high}));
  EXPECT_FALSE(has_image(first, other.image_hashes[0]));
}

TEST(Lineage, ScenesAreKnownIfEachImageNamesAListedOne) {
  const tests::TemporaryFolder folder;
  CocoDataset dataset = pictures(folder, {{1, 1}, {2, 1}});
  EXPECT_FALSE(data_use(DataPurpose::kTrain, dataset).scenes.has_value());
  dataset.scenes = std::vector<ImagedScene>{{"a", kHash}};
  dataset.images[0].scene = "a";
  EXPECT_EQ(data_use(DataPurpose::kTrain, dataset).scenes, dataset.scenes);
  dataset.images[1].scene = "b";  // Somebody added it.
  EXPECT_FALSE(data_use(DataPurpose::kTrain, dataset).scenes.has_value());
}

TEST(Lineage, PlacesAreTheSameByHashOrBySeed) {
  const auto rooms = [](std::uint64_t first, std::uint64_t last) {
    return ImagedScene{.generator = "rooms/1", .first_seed = first, .last_seed = last};
  };
  EXPECT_TRUE(is_same_place({"a", kHash}, {"b", kHash}));
  EXPECT_FALSE(is_same_place({"a", kHash}, {"a", kOtherHash}));
  EXPECT_TRUE(is_same_place(rooms(1, 4), rooms(4, 9)));
  EXPECT_TRUE(is_same_place(rooms(4, 9), rooms(1, 4)));
  EXPECT_FALSE(is_same_place(rooms(1, 4), rooms(5, 9)));
  ImagedScene other = rooms(1, 4);
  other.generator = "rooms/2";
  EXPECT_FALSE(is_same_place(rooms(1, 4), other));
  EXPECT_FALSE(is_same_place(rooms(1, 4), {}));
}

TrainOptions one_step(const tests::TemporaryFolder& folder, const std::string& output) {
  TrainOptions options;
  options.train_json = folder / "train.json";
  options.output = folder / output;
  options.width = 0.25;
  options.input_px = 64;
  options.steps = 1;
  options.batch = 2;
  options.threads = 1;
  options.checkpoint_every = 0;
  options.show_progress = false;
  return options;
}

TEST(Lineage, FineTuningInheritsWhatItsWeightsWereTrainedOn) {
  const tests::TemporaryFolder folder;
  CocoDataset dataset = read_coco(write_rectangles(folder));
  dataset.scenes = std::vector<ImagedScene>{{"a", kHash}};
  write_coco(folder / "train.json", dataset);
  dataset.images.resize(1);
  dataset.scenes.reset();
  write_coco(folder / "foreign.json", dataset);

  const TrainOptions first = one_step(folder, "first.weights");
  (void)train(first);
  TrainOptions second = one_step(folder, "second.weights");
  second.initial_weights = first.output;
  second.mix_json = second.validation_json = folder / "foreign.json";
  second.mix_share = 0.5;
  (void)train(second);

  const std::vector<DataUse> data = data_of(read_weights(second.output), second.output);
  const DataUse trained = data_use(DataPurpose::kTrain, read_coco(folder / "train.json"));
  const CocoDataset foreign = read_coco(folder / "foreign.json");
  EXPECT_EQ(trained.scenes->front().name, "a");
  // The second training on the same data set is the same entry.
  EXPECT_THAT(data, ElementsAre(trained, data_use(DataPurpose::kMix, foreign),
                                data_use(DataPurpose::kValidation, foreign)));
  EXPECT_FALSE(data[1].scenes.has_value());
  EXPECT_EQ(data[1].image_hashes.size(), 1U);
  EXPECT_TRUE(has_image(data[0], data[1].image_hashes[0]));

  // Of weights that do not say it, what was learnt before stays unknown.
  DetectorWeights silent = read_weights(first.output);
  silent.training = "{}";
  write_weights(folder / "silent.weights", silent);
  TrainOptions third = one_step(folder, "third.weights");
  third.initial_weights = folder / "silent.weights";
  (void)train(third);
  EXPECT_THAT(
      data_of(read_weights(third.output), third.output),
      ElementsAre(foreign_data("silent.weights", core::sha256_of_file(third.initial_weights)),
                  trained));
}

}  // namespace
}  // namespace segsim::perception
