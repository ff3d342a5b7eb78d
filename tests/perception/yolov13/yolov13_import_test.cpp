#include "perception/yolov13/import.h"

#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <map>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/lineage.h"
#include "perception/yolov13/model.h"
#include "tests/error_message.h"
#include "tests/perception/checkpoint_writer.h"
#include "tests/temporary_folder.h"

namespace segsim::perception::yolov13 {
namespace {

using segsim::tests::input_error_of;

using pickled::dict;
using pickled::object;
using pickled::text;
using testing::AllOf;
using testing::HasSubstr;

void write_bytes(const std::filesystem::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

/// A module tree as the trainer pickles it, with a counter in every batch norm.
struct Node {
  std::map<std::string, Node> children;
  std::vector<std::pair<std::string, std::string>> tensors;

  void add(const std::string& path, const std::string& value) {
    const std::size_t dot = path.find('.');
    if (dot == std::string::npos) {
      tensors.emplace_back(text(path), value);
    } else {
      children[path.substr(0, dot)].add(path.substr(dot + 1), value);
    }
  }
  [[nodiscard]] std::string pickle(
      const std::vector<std::pair<std::string, std::string>>& more) const {
    std::vector<std::pair<std::string, std::string>> modules, attributes = more;
    for (const auto& [name, child] : children)
      modules.emplace_back(text(name), child.pickle({}));
    attributes.emplace_back(text("_parameters"), pickled::ordered_dict(tensors));
    attributes.emplace_back(text("_buffers"), pickled::ordered_dict({}));
    attributes.emplace_back(text("_modules"), pickled::ordered_dict(modules));
    return object("ultralytics.nn.modules.block", "Anything", attributes);
  }
};

std::string make_official_file(const std::vector<NamedTensor>& tensors,
                               const std::vector<std::string>& names) {
  Records records{{"archive/data.pkl", ""}};
  TensorPickler pickle(records, true);
  Node root;
  for (const NamedTensor& tensor : tensors) {
    root.add(tensor.name, pickle(tensor));
    const std::size_t mean = tensor.name.rfind("running_mean");
    if (mean != std::string::npos)
      root.add(tensor.name.substr(0, mean) + "num_batches_tracked", pickle({"", {}, {7.0F}}));
  }
  std::vector<std::pair<std::string, std::string>> pairs;
  for (std::size_t i = 0; i < names.size(); ++i)
    pairs.emplace_back(pickled::integer(static_cast<std::int64_t>(i)), text(names[i]));
  records[0].second =
      pickled::kBegin +
      dict({{text("epoch"), pickled::integer(-1)},
            {text("ema"), pickled::kNone},
            {text("train_args"), dict({{text("imgsz"), pickled::integer(640)}})},
            {text("model"), root.pickle({{text("names"), dict(pairs)}})}}) +
      pickled::kEnd;
  return make_zip(records);
}

std::vector<NamedTensor> some_weights(int classes) {
  return Model(Scale::kN, classes, 3).tensors();
}

TEST(Yolov13Import, ReadsAWholePickledModelOfHalves) {
  const tests::TemporaryFolder folder;
  const auto tensors = some_weights(2);
  write_bytes(folder / "n.pt", make_official_file(tensors, {"chair", "table"}));
  const DetectorWeights made =
      import_weights({.source = folder / "n.pt"}, folder / "n.weights");
  EXPECT_EQ(made.architecture, "yolov13-n/1");
  EXPECT_EQ(made.class_names, (std::vector<std::string>{"chair", "table"}));
  const DetectorWeights read = read_weights(folder / "n.weights");
  ASSERT_EQ(read.tensors.size(), tensors.size());
  for (std::size_t i = 0; i < tensors.size(); ++i) {
    EXPECT_EQ(read.tensors[i].name, tensors[i].name);
    for (std::size_t k = 0; k < tensors[i].values.size(); ++k) {
      ASSERT_EQ(read.tensors[i].values[k], from_half(to_half(tensors[i].values[k])));
    }
  }
  // What somebody else trained it on is not known.
  const auto data = data_of(read, folder / "n.weights");
  ASSERT_EQ(data.size(), 1U);
  EXPECT_EQ(data[0], foreign_data("n.pt", core::sha256_of_file(folder / "n.pt")));
  EXPECT_FALSE(data[0].scenes.has_value());
  // Halves stay halves on disk: 2 bytes a parameter and a little more.
  EXPECT_LT(std::filesystem::file_size(folder / "n.weights"), 3 * 2'500'000U);
}

TEST(Yolov13Import, KeepsEveryBitOfSinglePrecision) {
  const tests::TemporaryFolder folder;
  const auto tensors = some_weights(80);
  const auto check = [&](const std::string& bytes) {
    write_bytes(folder / "file", bytes);
    (void)import_weights({.source = folder / "file"}, folder / "n.weights");
    const DetectorWeights read = read_weights(folder / "n.weights");
    for (std::size_t i = 0; i < tensors.size(); ++i)
      ASSERT_EQ(read.tensors[i].values, tensors[i].values);
    EXPECT_EQ(read.class_names.at(0), "person");
    EXPECT_EQ(read.class_names.at(79), "toothbrush");
  };
  check(make_state_dict_file(tensors, false));
  check(make_safetensors_file(tensors, false));
  auto wrapped = tensors;
  for (NamedTensor& tensor : wrapped) tensor.name = "model." + tensor.name;
  check(make_safetensors_file(wrapped, false));
}

TEST(Yolov13Import, ListsEveryDifference) {
  const tests::TemporaryFolder folder;
  auto tensors = some_weights(6);
  for (NamedTensor& tensor : tensors) {
    if (tensor.name == "model.12.gate") tensor.name = "model.12.gates";
    if (tensor.name == "model.9.cv2.conv.weight")
      tensor.shape = {tensor.shape[1], tensor.shape[0], 1, 1};
  }
  write_bytes(folder / "n.pt", make_state_dict_file(tensors, false));
  const ImportedWeights imported = read_official_weights({.source = folder / "n.pt"});
  EXPECT_THAT(imported.differences.missing, testing::ElementsAre("model.12.gate []"));
  EXPECT_THAT(imported.differences.unexpected, testing::ElementsAre("model.12.gates []"));
  EXPECT_THAT(
      imported.differences.reshaped,
      testing::ElementsAre("model.9.cv2.conv.weight [320,128,1,1] instead of [128,320,1,1]"));
  EXPECT_TRUE(imported.weights.tensors.empty());
  EXPECT_THAT(input_error_of([&] {
                (void)import_weights({.source = folder / "n.pt"}, folder / "n.weights");
              }),
              AllOf(HasSubstr("n.pt: expected the tensors of yolov13-n/1 for 6 classes"),
                    HasSubstr("missing model.12.gate []; unexpected model.12.gates []; shape "
                              "of model.9.cv2")));
  EXPECT_FALSE(std::filesystem::exists(folder / "n.weights"));
}

TEST(Yolov13Import, RefusesWhatIsNoYolov13) {
  const tests::TemporaryFolder folder;
  const auto refusal = [&](const std::vector<NamedTensor>& tensors,
                           ImportOptions options = {}) {
    write_bytes(folder / "n.pt", make_state_dict_file(tensors, false));
    options.source = folder / "n.pt";
    return input_error_of([&] { (void)read_official_weights(options); });
  };
  EXPECT_THAT(refusal({{"conv1.weight", {64, 3, 7, 7}, std::vector<float>(64 * 147)}}),
              HasSubstr("expected a YOLOv13 with model.0.conv.weight"));
  auto odd = some_weights(2);
  odd[0] = {odd[0].name, {20, 3, 3, 3}, std::vector<float>(540)};
  EXPECT_THAT(refusal(odd),
              HasSubstr("expected 16, 32, 64 or 96 channels (n, s, l, x), found 20"));
  auto constants = some_weights(2);
  for (NamedTensor& tensor : constants) {
    if (tensor.name == "model.32.dfl.conv.weight") tensor.values[3] = 4.0F;
  }
  EXPECT_THAT(refusal(constants), HasSubstr("expected 0 ... 15"));
  auto nan = some_weights(2);
  nan[5].values[0] = std::nanf("");
  EXPECT_THAT(refusal(nan), HasSubstr("expected finite values"));
  EXPECT_THAT(refusal(some_weights(2), {.scale = Scale::kX}),
              HasSubstr("expected scale x, found scale n"));
  EXPECT_THAT(refusal(some_weights(2), {.class_names = {"a", "b", "c"}}),
              HasSubstr("expected 2 class names, found 3"));
  EXPECT_EQ(refusal(some_weights(2), {.class_names = {"a", "b"}}), "no error");
}

}  // namespace
}  // namespace segsim::perception::yolov13
