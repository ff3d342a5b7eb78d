// TorchScript archives that libtorch's own compiler makes here.
#include <torch/csrc/jit/frontend/resolver.h>
#include <torch/csrc/jit/frontend/sugared_value.h>
#include <torch/script.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/models/object_detector.h"
#include "tests/perception/models/onnx_operator_case.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using testing::HasSubstr;

/// Finds torchvision's operators under the name "vision".
struct VisionResolver final : torch::jit::Resolver {
  std::shared_ptr<torch::jit::SugaredValue> resolveValue(
      const std::string& name, torch::jit::GraphFunction& method,
      const torch::jit::SourceRange& place) override {
    if (name == "vision") return std::make_shared<torch::jit::BuiltinModule>("torchvision");
    return torch::jit::nativeResolver()->resolveValue(name, method, place);
  }
};

std::filesystem::path save(const tests::TemporaryFolder& folder, const std::string& source,
                           const torch::jit::ExtraFilesMap& extra = {}) {
  torch::jit::Module module("Net");
  module.define(source, std::make_shared<VisionResolver>());
  module.save((folder / "net.torchscript").string(), extra);
  return folder / "net.torchscript";
}

TEST(TorchScript, TuplesAndDictsBecomeNamedOutputs) {
  const tests::TemporaryFolder folder;
  const auto session = open_model(save(folder, R"(
def forward(self, x, y):
    return {"sum": x + y, "product": x * y}
)"));
  EXPECT_EQ(session->runtime(), "TorchScript");
  ASSERT_EQ(session->inputs().size(), 2U);
  EXPECT_EQ(session->inputs()[1].name, "y");
  const auto outputs = session->run({{"x", real({2}, {1, 2})}, {"y", real({2}, {3, 4})}});
  EXPECT_EQ(find_output(outputs, "product", "test").floats(), (Floats{3, 8}));
  EXPECT_THROW((void)find_output(outputs, "none", "test"), core::InputError);
}

TEST(TorchScript, OperatorsOfNewerAndOtherLibraries) {
  const tests::TemporaryFolder folder;
  const auto session = open_model(save(folder, R"(
def forward(self, boxes, scores, q):
    kept = vision.nms(boxes, scores, 0.5)
    rois = torch.cat([torch.zeros([1, 1]), boxes[0:1]], 1)
    image = torch.ones([1, 1, 16, 16])
    pooled = vision.roi_align(image, rois, 1.0, 2, 2, 2, True)
    seen = torch.scaled_dot_product_attention(q, q, q, None, 0.0, True)
    return kept, pooled, seen
)"));
  const auto outputs =
      session->run({{"boxes", real({3, 4}, {1, 1, 9, 9, 1, 1, 9, 8.5F, 10, 10, 12, 12})},
                    {"scores", real({3}, {0.3F, 0.9F, 0.5F})},
                    {"q", real({1, 2, 1}, {0, 1})}});
  EXPECT_EQ(outputs[0].tensor.integers(), (Ints{1, 2}));
  EXPECT_EQ(outputs[1].tensor.shape, (Ints{1, 1, 2, 2}));
  EXPECT_NEAR(outputs[1].tensor.floats()[0], 1, 1e-6F);
  // The first sees itself alone; the second weighs 0 and 1 by exp(0) and exp(1).
  EXPECT_NEAR(outputs[2].tensor.floats()[0], 0, 1e-6F);
  EXPECT_NEAR(outputs[2].tensor.floats()[1], std::exp(1.0F) / (1 + std::exp(1.0F)), 1e-6F);
}

TEST(TorchScript, YoloExportsWithTheirMetadata) {
  const tests::TemporaryFolder folder;
  const auto file = save(folder, R"(
def forward(self, x):
    top = torch.max(x)
    return torch.tensor([[[8.0], [24.0], [16.0], [16.0], [0.9]]]) * top
)",
                         {{"config.txt", R"({"imgsz": [64, 64], "names": {"0": "chair"}})"}});
  const auto detector = load_object_detector(file);
  const core::Image<core::Rgb8> image(64, 64, {255, 255, 255});
  core::Observation observation;
  observation.rgb = &image;
  const auto found = detector->detect(observation);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].box.y1, 32, 1e-3F);
  EXPECT_EQ(detector->class_names().at(0), "chair");
}

std::string message_of(const std::filesystem::path& file,
                       const std::map<std::string, HostTensor>& inputs) {
  try {
    (void)open_model(file)->run(inputs);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "";
}

TEST(TorchScript, FaultsAreNamed) {
  const tests::TemporaryFolder folder;
  const auto file = save(folder, R"(
def forward(self, x):
    return x.reshape([7])
)");
  EXPECT_THAT(message_of(file, {{"x", real({2}, {1, 2})}}), HasSubstr("forward(): "));
  EXPECT_THAT(message_of(file, {}), HasSubstr("input 'x'"));
  std::string bytes = core::read_file(file);
  for (const std::size_t cut : {bytes.size() / 3, bytes.size() - 5}) {
    core::write_file_atomically(folder / "cut",
                                [&](std::ostream& out) { out << bytes.substr(0, cut); });
    EXPECT_NE(message_of(folder / "cut", {}), "");
  }
  const std::size_t at = bytes.find("reshape");  // Code is checked before it is compiled.
  ASSERT_NE(at, std::string::npos);
  bytes[at] = 'R';
  core::write_file_atomically(folder / "flip", [&](std::ostream& out) { out << bytes; });
  EXPECT_NE(message_of(folder / "flip", {}), "");
}

}  // namespace
}  // namespace segsim::perception
