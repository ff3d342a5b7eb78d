#include "perception/training/training_config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "core/config.h"
#include "core/error.h"
#include "core/file_io.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using testing::HasSubstr;

const std::filesystem::path kDefaults =
    std::filesystem::path(SEGSIM_SOURCE_DIR) / "perception/training_defaults.yaml";

TrainOptions read(const std::filesystem::path& file, const std::string& text,
                  const std::string& model) {
  core::write_file_atomically(file, [&](std::ostream& out) { out << text; });
  TrainOptions options = default_train_options(model);
  read_train_config(file, options);
  return options;
}

std::string message_of(const std::filesystem::path& file, const std::string& text) {
  try {
    (void)read(file, text, "small");
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(TrainingConfig, DefaultsFileNamesEveryKeyWithItsDefault) {
  for (const auto& [section, model] :
       {std::pair("small", "small"), std::pair("yolov13", "yolov13n"),
        std::pair("centernet", "centernet")}) {
    const TrainOptions expected = default_train_options(model);
    // From options that differ everywhere the file must bring all of them back.
    TrainOptions options =
        default_train_options(std::string(model) == "small" ? "yolov13x" : "small");
    options.model = model;
    options.frozen = {"x"};
    options.steps = options.batch = options.checkpoint_every = 7;
    read_train_config(kDefaults, options);
    EXPECT_EQ(describe_train_options(options), describe_train_options(expected));
    std::vector<std::string> keys;
    const auto json = nlohmann::ordered_json::parse(describe_train_options(expected));
    for (const auto& item : json.items()) keys.push_back(item.key());
    EXPECT_THAT(core::ConfigNode::load(kDefaults).child(section).keys(),
                testing::UnorderedElementsAreArray(keys));
  }
}

TEST(TrainingConfig, SectionOfTheNetworkIsRead) {
  const tests::TemporaryFolder folder;
  const std::string text = "small: {steps: 9}\nyolov13: {steps: 11, freeze: [backbone]}\n";
  EXPECT_EQ(read(folder / "a.yaml", text, "small").steps, 9);
  const TrainOptions yolo = read(folder / "a.yaml", text, "yolov13l");
  EXPECT_EQ(yolo.steps, 11);
  EXPECT_EQ(yolo.frozen, (std::vector<std::string>{"backbone"}));
  EXPECT_EQ(yolo.width, 1.0);
}

TEST(TrainingConfig, AdamWHasItsOwnMomentumUnlessTheFileNamesOne) {
  const tests::TemporaryFolder folder;
  const auto fitted = [&](const std::string& text) {
    core::write_file_atomically(folder / "a.yaml", [&](std::ostream& out) { out << text; });
    TrainOptions options = default_train_options("yolov13n");
    const auto named = read_train_config(folder / "a.yaml", options);
    fit_to_adamw(options, named);
    return options;
  };
  TrainOptions o = fitted("yolov13: {optimizer: adamw}\nsmall: {momentum: 0.5}\n");
  EXPECT_EQ(o.momentum, 0.9);
  EXPECT_EQ(o.warmup_bias_rate, 0.0);
  o = fitted("yolov13: {optimizer: adamw, momentum: 0.937}\n");
  EXPECT_EQ(o.momentum, 0.937);
  EXPECT_EQ(o.warmup_bias_rate, 0.0);
  o = fitted("yolov13: {optimizer: adamw, warmup_bias_rate: 0.05}\n");
  EXPECT_EQ(o.warmup_bias_rate, 0.05);
  o = fitted("yolov13: {optimizer: sgd}\n");
  EXPECT_EQ(o.momentum, 0.937);
  EXPECT_EQ(o.warmup_bias_rate, 0.1);
}

TEST(TrainingConfig, ErrorsNameFileLineAndKey) {
  const tests::TemporaryFolder folder;
  const auto file = folder / "a.yaml";
  EXPECT_THAT(message_of(file, "small:\n  stepz: 3\n"),
              testing::AllOf(HasSubstr("a.yaml:2"), HasSubstr("steps")));
  EXPECT_THAT(message_of(file, "small:\n  mosaic: 2\n"), HasSubstr("mosaic"));
  EXPECT_THAT(message_of(file, "small:\n  optimizer: lion\n"),
              HasSubstr("auto | adamw | sgd"));
  EXPECT_THAT(message_of(file, "yolov13:\n  batch: 0\n"), HasSubstr("batch"));
  EXPECT_THAT(message_of(file, "medium: {}\n"), HasSubstr("medium"));
}

TEST(TrainingConfig, ModelsAreNamed) {
  EXPECT_EQ(train_models(), (std::vector<std::string>{"small", "yolov13n", "yolov13s",
                                                      "yolov13l", "yolov13x", "centernet"}));
  for (const std::string& model : train_models()) {
    EXPECT_EQ(model_of_architecture(architecture_of_model(model), "w"), model);
  }
  EXPECT_THROW((void)model_of_architecture("yolov13-m/1", "w"), core::InputError);
}

}  // namespace
}  // namespace segsim::perception
