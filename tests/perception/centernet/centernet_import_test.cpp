#include "perception/centernet/import.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>

#include "perception/checkpoint/lineage.h"
#include "perception/data/coco_names.h"
#include "perception/internal/centernet/network.h"
#include "tests/error_message.h"
#include "tests/perception/tfjs_writer.h"
#include "tests/temporary_folder.h"

namespace segsim::perception::centernet {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kClasses = 3;

std::vector<NamedTensor> some_weights() {
  Network network(kClasses);
  network->initialize(5);
  return export_tensors(*network);
}

/// Under the published names and in the published order of axes, of numbers that float16
/// holds.
std::vector<NamedTensor> published(const std::vector<NamedTensor>& ours) {
  std::map<std::string, NamedTensor> by_name;
  for (const NamedTensor& tensor : ours) by_name[tensor.name] = tensor;
  std::vector<NamedTensor> result;
  for (const PublishedName& name : published_names()) {
    const NamedTensor& tensor = by_name.at(name.ours);
    auto value = torch::tensor(tensor.values).view(tensor.shape);
    if (!name.axes.empty()) {
      std::vector<std::int64_t> inverse(4);
      for (std::size_t i = 0; i < 4; ++i)
        inverse[static_cast<std::size_t>(name.axes[i])] = static_cast<std::int64_t>(i);
      value = value.permute(inverse);
    }
    const auto flat = value.contiguous().view({-1});
    const float* data = flat.data_ptr<float>();
    result.push_back(
        {name.published, value.sizes().vec(), std::vector<float>(data, data + flat.numel())});
  }
  return result;
}

DetectorWeights import_file(const std::filesystem::path& file,
                            const ImportOptions& options = {}) {
  return read_published_weights(read_tensor_file(file), file, options);
}

TEST(CenterNetImport, EveryTensorArrivesWithItsAxesTurned) {
  const tests::TemporaryFolder folder;
  const std::vector<NamedTensor> ours = some_weights();
  ASSERT_EQ(published_names().size(), ours.size());
  const auto file = write_tfjs(folder, published(ours));
  EXPECT_TRUE(is_published(read_tensor_file(file)));
  const DetectorWeights weights =
      import_file(file, {.input_px = 256, .score_threshold = 0.4F});
  EXPECT_EQ(weights.architecture, "mobilenetv3-centernet/1");
  EXPECT_EQ(weights.input_px, 256);
  EXPECT_EQ(weights.score_threshold, 0.4F);
  EXPECT_THAT(weights.class_names, ElementsAre("class 0", "class 1", "class 2"));
  ASSERT_EQ(weights.tensors.size(), ours.size());
  for (std::size_t i = 0; i < ours.size(); ++i) {
    EXPECT_EQ(weights.tensors[i].name, ours[i].name);
    ASSERT_EQ(weights.tensors[i].shape, ours[i].shape);
    const float scale = ours[i].name == "stem.weight" ? 255.0F : 1.0F;
    for (std::size_t k = 0; k < ours[i].values.size(); ++k) {
      ASSERT_EQ(weights.tensors[i].values[k], scale * from_half(to_half(ours[i].values[k])))
          << ours[i].name;
    }
  }
  // A weights file keeps all of it, and what it came from.
  write_weights(folder / "c.weights", weights);
  const DetectorWeights back = read_weights(folder / "c.weights");
  for (std::size_t i = 0; i < ours.size(); ++i)
    EXPECT_EQ(back.tensors[i].values, weights.tensors[i].values);
  const auto data = data_of(back, folder / "c.weights");
  ASSERT_EQ(data.size(), 1U);
  EXPECT_EQ(data[0].purpose, DataPurpose::kForeign);
  EXPECT_EQ(data[0].file, "model.bin");
  EXPECT_EQ(data[0].labels_sha256, core::sha256_of_file(folder / "model.bin"));
}

TEST(CenterNetImport, RefusesInOneLineWithTensorAndShape) {
  const tests::TemporaryFolder folder;
  const std::vector<NamedTensor> whole = published(some_weights());
  const auto refusal = [&](const auto& change, const ImportOptions& options = {}) {
    std::vector<NamedTensor> tensors = whole;
    change(tensors);
    const auto file = write_tfjs(folder, tensors);
    const std::string line = tests::input_error_of([&] { (void)import_file(file, options); });
    EXPECT_THAT(line, HasSubstr("model.json"));
    EXPECT_EQ(std::count(line.begin(), line.end(), '\n'), 0);
    return line;
  };
  const auto same = [](std::vector<NamedTensor>&) {};
  for (std::size_t i = 0; i < whole.size(); i += 33) {
    EXPECT_THAT(refusal([i](auto& tensors) {
                  tensors.erase(tensors.begin() + static_cast<std::ptrdiff_t>(i));
                }),
                HasSubstr(whole[i].name + ": expected a tensor of CenterNet"));
  }
  EXPECT_THAT(refusal([](auto& tensors) {
                tensors[0].shape = {3, 3, 16, 3};
              }),
              HasSubstr("Conv2D_weights: expected [3, 3, 3, 16], found [3, 3, 16, 3]"));
  EXPECT_THAT(refusal([](auto& tensors) {
                tensors[0].shape = {27, 16};
              }),
              HasSubstr("Conv2D_weights: expected 4 axes, found [27, 16]"));
  EXPECT_THAT(refusal([](auto& tensors) { tensors[1].values[3] = INFINITY; }),
              HasSubstr("Conv2D_bn_offset: expected finite values, found inf"));
  EXPECT_THAT(refusal(same, {.class_names = {"a", "b"}}),
              HasSubstr("expected 3 class names, found 2"));
}

TEST(CenterNetImport, ThePublishedFileHasTheClassesOfCoco) {
  const char* data = std::getenv("SEGSIM_DATA");
  if (data == nullptr) GTEST_SKIP() << "SEGSIM_DATA does not name the folder with centernet";
  const auto file = std::filesystem::path(data) / "centernet/centernet.json";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " does not exist";
  const DetectorWeights weights = import_file(file);
  EXPECT_EQ(weights.class_names, coco_names());
  std::size_t count = 0;
  for (const NamedTensor& tensor : weights.tensors) count += tensor.values.size();
  EXPECT_EQ(count, 2'014'924U);
}

}  // namespace
}  // namespace segsim::perception::centernet
