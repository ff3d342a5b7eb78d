#include "perception/checkpoint/weights_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "perception/detector/detector.h"
#include "tests/error_message.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using segsim::tests::input_error_of;

using testing::HasSubstr;

DetectorWeights some_weights() {
  DetectorWeights weights;
  weights.class_names = {"chair", "couch"};
  weights.score_threshold = 0.31F;
  weights.training = R"({"seed":7})";
  core::RandomStream random(1, "weights");
  NamedTensor kernel{"conv.weight", {4, 3, 3, 3}, {}}, bias{"conv.bias", {4}, {}};
  for (int i = 0; i < 108; ++i) kernel.values.push_back(static_cast<float>(random.normal()));
  for (int i = 0; i < 4; ++i) bias.values.push_back(static_cast<float>(random.normal() * 1e6));
  weights.tensors = {kernel, bias};
  return weights;
}

TEST(Half, EveryHalfReturnsToItself) {
  for (std::uint32_t bits = 0; bits < 0x10000; ++bits) {
    const auto half = static_cast<std::uint16_t>(bits);
    const float value = from_half(half);
    if (std::isnan(value)) continue;
    ASSERT_EQ(to_half(value), half) << bits;
  }
  EXPECT_EQ(from_half(0x3C00), 1.0F);
  EXPECT_EQ(from_half(0xC000), -2.0F);
  EXPECT_EQ(from_half(0x7BFF), 65504.0F);
}

TEST(Half, RoundsToNearestEven) {
  // Between two neighbours the middle goes to the even one, anything else to the nearer.
  for (std::uint32_t bits = 0; bits < 0x7BFF; ++bits) {
    const float lo = from_half(static_cast<std::uint16_t>(bits));
    const float hi = from_half(static_cast<std::uint16_t>(bits + 1));
    const float middle = 0.5F * (lo + hi);
    ASSERT_EQ(to_half(middle), bits + (bits & 1U)) << bits;
    ASSERT_EQ(to_half(std::nextafter(middle, lo)), bits);
    ASSERT_EQ(to_half(std::nextafter(middle, hi)), bits + 1);
  }
  EXPECT_TRUE(std::isinf(from_half(to_half(65520.0F))));
}

TEST(WeightsFile, RoundTripKeepsEverything) {
  const tests::TemporaryFolder folder;
  const DetectorWeights written = some_weights();
  write_weights(folder / "w.bin", written);
  const DetectorWeights read = read_weights(folder / "w.bin");
  EXPECT_EQ(read.class_names, written.class_names);
  EXPECT_EQ(read.score_threshold, written.score_threshold);
  EXPECT_EQ(read.width, written.width);
  EXPECT_EQ(read.input_px, written.input_px);
  EXPECT_EQ(read.training, written.training);
  EXPECT_EQ(describe_difference(read.tensors, written.tensors), "");
  EXPECT_EQ(read.tensors[1].values, written.tensors[1].values);  // float32
  for (std::size_t i = 0; i < 108; ++i) {
    EXPECT_EQ(read.tensors[0].values[i], from_half(to_half(written.tensors[0].values[i])));
  }
}

TEST(WeightsFile, EveryTruncationIsRefused) {
  const tests::TemporaryFolder folder;
  write_weights(folder / "w.bin", some_weights());
  const std::string bytes = core::read_file(folder / "w.bin");
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    std::ofstream(folder / "cut.bin", std::ios::binary)
        .write(bytes.data(), std::streamsize(size));
    ASSERT_THAT(input_error_of([&] { (void)read_weights(folder / "cut.bin"); }),
                HasSubstr("cut.bin"));
  }
}

TEST(WeightsFile, AlteredDataIsRefused) {
  const tests::TemporaryFolder folder;
  write_weights(folder / "w.bin", some_weights());
  std::string bytes = core::read_file(folder / "w.bin");
  bytes.back() = static_cast<char>(bytes.back() ^ 1);
  std::ofstream(folder / "w.bin", std::ios::binary) << bytes;
  EXPECT_THAT(input_error_of([&] { (void)read_weights(folder / "w.bin"); }),
              HasSubstr("data_sha256"));
}

/// Replaces a text of the header, which is no longer than it was, and the data; the header's
/// own checks of the data hold again.
void rewrite(const std::filesystem::path& file, const std::string& from, const std::string& to,
             const std::function<void(std::string&)>& change_data) {
  std::string bytes = core::read_file(file);
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 8, sizeof length);
  std::string header = bytes.substr(12, length), data = bytes.substr(12 + length);
  const std::string sha256 = core::sha256_hex(data);
  change_data(data);
  header.replace(header.find(from), from.size(), to);
  header.replace(header.find(sha256), sha256.size(), core::sha256_hex(data));
  const auto changed = static_cast<std::uint32_t>(header.size());
  std::memcpy(bytes.data() + 8, &changed, sizeof changed);
  std::ofstream(file, std::ios::binary) << bytes.substr(0, 12) + header + data;
}

TEST(WeightsFile, ValuesThatAreNoNumbersAreRefused) {
  const tests::TemporaryFolder folder;
  for (const float value :
       {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
    write_weights(folder / "w.bin", some_weights());
    rewrite(folder / "w.bin", "conv.bias", "conv.bias", [&](std::string& data) {
      std::memcpy(data.data() + data.size() - sizeof value, &value, sizeof value);
    });
    EXPECT_THAT(input_error_of([&] { (void)read_weights(folder / "w.bin"); }),
                HasSubstr("conv.bias: expected finite values"));
  }
}

/// A list of tensors that all name the same numbers would fill the memory.
TEST(WeightsFile, TensorsDoNotShareTheirNumbers) {
  const tests::TemporaryFolder folder;
  write_weights(folder / "w.bin", some_weights());
  const std::string first = R"({"name":"conv.weight")";
  rewrite(folder / "w.bin", first,
          R"({"name":"again","shape":[108],"type":"float16","offset":0},)" + first,
          [](std::string&) {});
  EXPECT_THAT(input_error_of([&] { (void)read_weights(folder / "w.bin"); }),
              HasSubstr("tensors that have the data to themselves"));
}

TEST(WeightsFile, ValuesOutsideHalfAreRefused) {
  const tests::TemporaryFolder folder;
  DetectorWeights weights = some_weights();
  weights.tensors[0].values[5] = 1e6F;
  EXPECT_THAT(input_error_of([&] { write_weights(folder / "w.bin", weights); }),
              HasSubstr("conv.weight"));
  EXPECT_FALSE(std::filesystem::exists(folder / "w.bin"));
}

TEST(WeightsFile, DifferencesAreTold) {
  const NamedTensor a{"a", {1}, {0}}, b{"b", {2, 3}, {}}, c{"c", {1}, {0}};
  NamedTensor other_b = b;
  other_b.shape = {3, 2};
  EXPECT_EQ(describe_difference({a, other_b}, {b, c}),
            "missing c; unknown a; shape of b [3, 2] instead of [2, 3]");
  EXPECT_EQ(describe_difference({a, b}, {b, a}), "");
}

TEST(LoadDetector, WeightsOfAnotherNetworkAreRefusedInOneLine) {
  const tests::TemporaryFolder folder;
  write_weights(folder / "w.bin", some_weights());
  const std::string message = input_error_of([&] { (void)load_detector(folder / "w.bin"); });
  EXPECT_THAT(message, HasSubstr("w.bin: the tensors do not fit the network: missing "));
  EXPECT_THAT(message, HasSubstr("unknown conv.bias, conv.weight"));
  EXPECT_EQ(message.find('\n'), std::string::npos);
}

}  // namespace
}  // namespace segsim::perception
