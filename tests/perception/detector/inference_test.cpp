#include "perception/detector/internal/inference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <tuple>

#include "core/random.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/detector/detector.h"
#include "perception/internal/network/onednn_attention.h"
#include "perception/training/internal/trainable_network.h"
#include "tests/error_message.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using core::Image;
using core::Rgb8;
using testing::HasSubstr;

constexpr int kSide_px = 64;

Image<Rgb8> picture(int width_px, int height_px, std::uint64_t seed) {
  Image<Rgb8> image(width_px, height_px);
  core::RandomStream random(seed, "picture");
  for (Rgb8& pixel : image.pixels()) {
    const auto level = [&] { return static_cast<std::uint8_t>(random.index(256)); };
    pixel = {level(), level(), level()};
  }
  return image;
}

/// An untrained network: any score is as good as another.
std::filesystem::path write_small_detector(const tests::TemporaryFolder& folder) {
  const auto network =
      make_trainable_network(DetectorWeights::kArchitecture, 0.25, 3, kSide_px, 4);
  DetectorWeights weights;
  weights.width = 0.25;
  weights.input_px = kSide_px;
  weights.class_names = {"a", "b", "c"};
  weights.score_threshold = 0.0F;
  weights.tensors = export_tensors(*network.module);
  write_weights(folder / "small.weights", weights);
  return folder / "small.weights";
}

core::DeviceFrames frames_of(const Image<Rgb8>& image) {
  core::DeviceFrames frames;
  frames.count = 1;
  frames.width_px = image.width_px();
  frames.height_px = image.height_px();
  frames.rgb = &image.data()->r;
  return frames;
}

void expect_alike(const std::vector<core::Detection>& a, const std::vector<core::Detection>& b,
                  float tolerance_px) {
  ASSERT_EQ(a.size(), b.size());
  ASSERT_FALSE(a.empty());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].class_index, b[i].class_index);
    EXPECT_NEAR(a[i].score, b[i].score, 1e-5F);
    EXPECT_NEAR(a[i].box.x0, b[i].box.x0, tolerance_px);
    EXPECT_NEAR(a[i].box.y0, b[i].box.y0, tolerance_px);
    EXPECT_NEAR(a[i].box.x1, b[i].box.x1, tolerance_px);
    EXPECT_NEAR(a[i].box.y1, b[i].box.y1, tolerance_px);
  }
}

std::vector<core::Detection> detect_one(core::Detector& detector, const Image<Rgb8>& image) {
  core::Observation observation;
  observation.rgb = &image;
  return detector.detect(observation);
}

TEST(BatchDetector, FindsWhatItFindsOneByOne) {
  const tests::TemporaryFolder folder;
  const auto detector = load_detector(write_small_detector(folder),
                                      {.score_threshold = {}, .max_detections = 5});
  const Image<Rgb8> pictures[] = {picture(64, 48, 1), picture(200, 100, 2), picture(1, 1, 3)};
  const Image<Rgb8>* const pointers[] = {&pictures[0], &pictures[1], &pictures[2]};
  const auto together = detector->detect_batch(pointers);
  ASSERT_EQ(together.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    expect_alike(together[i], detect_one(*detector, pictures[i]), 1e-3F);
  }
  EXPECT_TRUE(detector->detect_batch({}).empty());
}

TEST(BatchDetector, FramesOfARendererGiveTheSame) {
  const tests::TemporaryFolder folder;
  const auto detector = load_detector(write_small_detector(folder),
                                      {.score_threshold = {}, .max_detections = 5});
  // Neither scaled; then shrunk and grown by whole numbers, where both round alike.
  for (const auto& image : {picture(64, 48, 1), picture(128, 96, 2)}) {
    const auto found = detector->detect_frames(frames_of(image));
    ASSERT_EQ(found.size(), 1U);
    expect_alike(found[0], detect_one(*detector, image), 1e-3F);
  }
}

TEST(BatchDetector, FramesElsewhereAndDevicesThatAreNotThereAreRefused) {
  const tests::TemporaryFolder folder;
  const auto file = write_small_detector(folder);
  const auto detector = load_detector(file);
  const Image<Rgb8> image = picture(64, 48, 1);
  core::DeviceFrames frames = frames_of(image);
  frames.device = 0;
  EXPECT_THAT(tests::input_error_of([&] { (void)detector->detect_frames(frames); }),
              HasSubstr("images: expected in the host's memory, found on a GPU"));
  EXPECT_THAT(tests::input_error_of([&] {
                (void)load_detector(file, {.score_threshold = {}, .mixed_precision = true});
              }),
              HasSubstr("mixed precision: expected device cuda"));
  if (torch::cuda::is_available()) GTEST_SKIP() << "CUDA is there";
  EXPECT_THAT(tests::input_error_of([&] {
                (void)load_detector(file,
                                    {.score_threshold = {}, .device = ComputeDevice::kCuda});
              }),
              HasSubstr("device: expected cpu, found cuda"));
}

TEST(LetterboxOnDevice, IsTheLetterboxUpToOneLevel) {
  Inference inference({}, kSide_px, torch::kCPU, false);
  for (const auto& [width, height] : {std::pair{64, 48},
                                      {48, 64},
                                      {128, 96},
                                      {640, 480},
                                      {100, 73},
                                      {31, 64},
                                      {20, 7},
                                      {1, 1},
                                      {3, 500}}) {
    const Image<Rgb8> image = picture(width, height, 9);
    const Letterbox fit = Letterbox::fit(width, height, kSide_px);
    const Image<Rgb8> squares[] = {letterbox(image, fit)};
    const auto wanted = inference.upload(squares);
    const auto rgb = torch::from_blob(const_cast<Rgb8*>(image.data()), {1, height, width, 3},
                                      torch::kUInt8);
    const auto found = inference.letterbox_on_device(rgb, fit);
    ASSERT_EQ(found.sizes(), wanted.sizes());
    const bool scaled = fit.scaled_width_px() != width || fit.scaled_height_px() != height;
    EXPECT_LE((found - wanted).abs().max().item<double>(), scaled ? 1.001 / 255.0 : 1e-7)
        << width << " x " << height;
  }
}

TEST(Candidates, AreTheSameByTensorsAndByLoops) {
  torch::manual_seed(3);
  const Anchors anchors = make_anchors(kSide_px, torch::kFloat32);
  const int64_t count = anchors.stride_px.numel();
  const RawOutput raw{torch::randn({2, count, 4 * kRegBins}) * 3.0,
                      torch::randn({2, count, 3}) * 2.0};
  for (const float threshold : {0.7F, 0.99F, 0.02F, 0.0F, 1.0F}) {
    const auto loops = candidates_on_host(raw, anchors, threshold);
    const auto tensors = candidates_on_device(raw, anchors, threshold);
    ASSERT_EQ(loops.size(), 2U);
    ASSERT_EQ(tensors.size(), 2U);
    for (std::size_t i = 0; i < 2; ++i) {
      if (threshold == 1.0F) {
        EXPECT_TRUE(loops[i].empty() && tensors[i].empty());
        continue;
      }
      expect_alike(tensors[i], loops[i], 1e-3F);
    }
  }
}

using ConvolutionCase = std::tuple<int, int, int>;  // Kernel, stride, groups.
class FoldedConvolutionCases : public testing::TestWithParam<ConvolutionCase> {};

TEST_P(FoldedConvolutionCases, AgreesWithLibtorch) {
  const auto [kernel, stride, groups] = GetParam();
  torch::manual_seed(5);
  const auto weight = torch::randn({24, 12 / groups, kernel, kernel}) * 0.2;
  const auto bias = torch::randn({24});
  for (const auto& [activation, less_before] :
       {std::pair(Activation::kNone, 0), std::pair(Activation::kSilu, 0),
        std::pair(Activation::kRelu, 1), std::pair(Activation::kHardSwish, 1)}) {
    const ConvolutionForm form{stride, groups, activation, kernel == 1 ? 0 : less_before};
    FoldedConvolution with(weight, bias, form), without(weight, {}, form);
    // Other sizes, and maps that lie otherwise: channels first, last, a part of more channels.
    const auto wide = torch::randn({2, 30, 9, 14});
    for (const auto& x :
         {torch::randn({1, 12, 16, 16}),
          torch::randn({3, 12, 7, 11}).contiguous(torch::MemoryFormat::ChannelsLast),
          wide.narrow(1, 5, 12), torch::randn({1, 12, 1 + less_before, 1 + less_before})}) {
      const auto wanted = [&](const torch::Tensor& b) -> torch::Tensor {
        const std::int64_t after = kernel / 2, before = after - form.less_before;
        const std::int64_t step[] = {stride, stride}, none[] = {0, 0}, one[] = {1, 1};
        const torch::Tensor y =
            torch::conv2d(torch::constant_pad_nd(x, {before, after, before, after}), weight, b,
                          step, none, one, groups);
        switch (form.activation) {
          case Activation::kNone:
            return y;
          case Activation::kSilu:
            return y * y.sigmoid();
          case Activation::kRelu:
            return y.clamp_min(0);
          case Activation::kHardSwish:
            break;
        }
        return y * (y + 3).clamp(0, 6) * 0.1666259765625;
      };
      const torch::Tensor expected = wanted(bias), plain = wanted({});
      {
        const torch::NoGradGuard no_grad;
        EXPECT_TRUE(torch::allclose(with.run(x), expected, 1e-4, 1e-4));
        EXPECT_TRUE(torch::allclose(without.run(x), plain, 1e-4, 1e-4));
        const auto base = torch::randn(expected.sizes());
        const auto inner = base.contiguous(torch::MemoryFormat::ChannelsLast).clone();
        const torch::Tensor sum = base + expected, plain_sum = base + plain;
        EXPECT_TRUE(torch::allclose(with.run_onto(base.clone(), x), sum, 1e-4, 1e-4));
        EXPECT_TRUE(torch::allclose(without.run_onto(inner, x), plain_sum, 1e-4, 1e-4));
      }
      EXPECT_TRUE(torch::allclose(with.run(x), expected, 1e-4, 1e-4));  // With gradients.
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Kernels, FoldedConvolutionCases,
                         testing::Values(ConvolutionCase{1, 1, 1}, ConvolutionCase{3, 1, 1},
                                         ConvolutionCase{3, 2, 1}, ConvolutionCase{5, 1, 1},
                                         ConvolutionCase{7, 1, 12}, ConvolutionCase{3, 2, 12},
                                         ConvolutionCase{3, 1, 4}));

TEST(BandAttention, AgreesWithItsFormula) {
  constexpr int kHeads = 3, kHeadChannels = 8, kBands = 2;
  constexpr int64_t kChannels = kHeads * kHeadChannels;
  BandAttention attention(kHeads, kHeadChannels, kBands);
  const torch::NoGradGuard no_grad;
  torch::manual_seed(6);
  for (const auto& [height, width] : {std::pair<int64_t, int64_t>{4, 5}, {6, 3}, {2, 1}}) {
    const auto qk = torch::randn({2, 2 * kChannels, height, width}) * 2.0;
    const auto v = torch::randn({2, kChannels, height, width});
    if (!BandAttention::available(v)) GTEST_SKIP() << "built without oneDNN";
    const int64_t tokens = height * width / kBands;
    auto wanted = torch::empty({2, kChannels, height * width});
    for (int64_t image = 0; image < 2; ++image) {
      for (int64_t group = 0; group < kBands * kHeads; ++group) {
        const int64_t channel = group % kHeads * kHeadChannels,
                      first = group / kHeads * tokens;
        const auto part = [&](const torch::Tensor& map, int64_t from) {
          return map[image].flatten(1).narrow(0, from, kHeadChannels).narrow(1, first, tokens);
        };
        const auto q = part(qk, channel), k = part(qk, kChannels + channel);
        const auto weights = (q.t().mm(k) / std::sqrt(double{kHeadChannels})).softmax(1);
        wanted[image]
            .narrow(0, channel, kHeadChannels)
            .narrow(1, first, tokens)
            .copy_(part(v, channel).mm(weights.t()));
      }
    }
    const auto found = attention.run(qk, v).flatten(2);
    EXPECT_LE((found - wanted).abs().max().item<double>(), 1e-5) << height << " x " << width;
    // Channels innermost.
    const auto inner = attention.run(qk.contiguous(torch::MemoryFormat::ChannelsLast),
                                     v.contiguous(torch::MemoryFormat::ChannelsLast));
    EXPECT_TRUE(torch::equal(inner.flatten(2), found));
  }
}

TEST(FoldedConvolution, IsEmptyUntilOneIsAssigned) {
  FoldedConvolution folded;
  EXPECT_TRUE(folded.empty());
  folded = FoldedConvolution(torch::ones({1, 1, 1, 1}), {}, ConvolutionForm{});
  EXPECT_FALSE(folded.empty());
  EXPECT_EQ(folded.macs_per_value(), 1);
}

}  // namespace
}  // namespace segsim::perception
