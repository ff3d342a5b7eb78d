#include "perception/detector/device_frame_tensors.h"

#include <gtest/gtest.h>
#include <torch/cuda.h>
#include <torch/types.h>

#include <numeric>
#include <string>
#include <vector>

#include "core/check.h"
#include "core/error.h"

namespace segsim::perception {
namespace {

constexpr int kCount = 2, kHeight = 3, kWidth = 4;
constexpr int kPixels = kCount * kHeight * kWidth;

/// Images in host memory; element i of a channel is i.
struct HostFrames {
  std::vector<std::uint8_t> bytes = std::vector<std::uint8_t>(3 * kPixels);
  std::vector<float> floats = std::vector<float>(32 * kPixels);
  std::vector<std::uint16_t> ids = std::vector<std::uint16_t>(kPixels);
  core::DeviceFrames frames;

  HostFrames() {
    std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
    std::iota(floats.begin(), floats.end(), 0.0F);
    std::iota(ids.begin(), ids.end(), std::uint16_t{40000});
    frames.count = kCount, frames.height_px = kHeight, frames.width_px = kWidth;
    frames.rgb = bytes.data();
    frames.depth_m = frames.normal = frames.alpha = floats.data();
    frames.confidence = frames.instance_confidence = floats.data();
    frames.semantic_feature = frames.instance_feature = floats.data();
    frames.semantic = frames.instance = ids.data();
  }
};

TEST(DeviceFrameTensors, AreViewsOfTheRenderersMemory) {
  HostFrames host;
  const torch::Tensor depth = image_tensor(host.frames, DeviceImage::kDepth);
  EXPECT_EQ(depth.data_ptr(), host.floats.data());
  host.floats[kWidth * kHeight + 2 * kWidth + 3] = -7.0F;  // Image 1, row 2, column 3.
  EXPECT_EQ(depth[1][2][3].item<float>(), -7.0F);
}

TEST(DeviceFrameTensors, HaveTheDocumentedShapesAndTypes) {
  const HostFrames host;
  struct Case {
    DeviceImage image;
    torch::ScalarType type;
    std::vector<std::int64_t> more;
  };
  const std::vector<Case> cases{
      {DeviceImage::kRgb, torch::kUInt8, {3}},
      {DeviceImage::kDepth, torch::kFloat32, {}},
      {DeviceImage::kNormal, torch::kFloat32, {3}},
      {DeviceImage::kAlpha, torch::kFloat32, {}},
      {DeviceImage::kSemantic, torch::kInt16, {}},
      {DeviceImage::kInstance, torch::kInt16, {}},
      {DeviceImage::kConfidence, torch::kFloat32, {}},
      {DeviceImage::kInstanceConfidence, torch::kFloat32, {}},
      {DeviceImage::kSemanticFeature, torch::kFloat32, {16}},
      {DeviceImage::kInstanceFeature, torch::kFloat32, {32}},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(static_cast<int>(c.image));
    std::vector<std::int64_t> shape{kCount, kHeight, kWidth};
    shape.insert(shape.end(), c.more.begin(), c.more.end());
    const torch::Tensor tensor = image_tensor(host.frames, c.image);
    EXPECT_EQ(tensor.sizes(), torch::IntArrayRef(shape));
    EXPECT_EQ(tensor.scalar_type(), c.type);
    EXPECT_EQ(tensor.device().type(), torch::kCPU);
    EXPECT_TRUE(tensor.is_contiguous());
  }
}

TEST(DeviceFrameTensors, LastAxisIsTheChannel) {
  const HostFrames host;
  const torch::Tensor rgb = image_tensor(host.frames, DeviceImage::kRgb);
  EXPECT_EQ(rgb[0][1][2][1].item<int>(), 3 * (kWidth + 2) + 1);
  const torch::Tensor feature = image_tensor(host.frames, DeviceImage::kInstanceFeature);
  EXPECT_EQ(feature[1][0][1][31].item<float>(), 32.0F * (kHeight * kWidth + 1) + 31.0F);
}

TEST(DeviceFrameTensors, IdsKeepTheirBits) {
  const HostFrames host;
  const torch::Tensor semantic = image_tensor(host.frames, DeviceImage::kSemantic);
  const auto id = static_cast<std::uint16_t>(semantic[0][0][1].item<std::int16_t>());
  EXPECT_EQ(id, 40001);
}

TEST(DeviceFrameTensors, AnImageThatWasNotRenderedIsRefused) {
  HostFrames host;
  host.frames.normal = nullptr;
  EXPECT_THROW(image_tensor(host.frames, DeviceImage::kNormal), core::ContractViolation);
}

TEST(DeviceFrameTensors, AGpuThatLibtorchDoesNotHaveIsNamed) {
  HostFrames host;
  host.frames.device = 63;
  try {
    const torch::Tensor rgb = image_tensor(host.frames, DeviceImage::kRgb);
    FAIL() << "accepted on " << rgb.device();
  } catch (const core::InputError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("expected CUDA with GPU 63"), std::string::npos) << text;
    if (!torch::cuda::is_available()) {
      EXPECT_NE(text.find("found a libtorch without CUDA"), std::string::npos) << text;
    }
  }
}

}  // namespace
}  // namespace segsim::perception
