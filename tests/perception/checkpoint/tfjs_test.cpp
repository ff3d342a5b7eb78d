#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "perception/checkpoint/tensor_file.h"
#include "tests/error_message.h"
#include "tests/perception/tfjs_writer.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::vector<NamedTensor> some_tensors() {
  return {{"a", {2, 3}, {0.5F, 1.0F, -2.0F, 3.0F, 4.0F, 5.0F}}, {"b", {2}, {7.0F, 8.0F}}};
}

TEST(Tfjs, TensorsOfEveryTypeLieOneBehindTheOther) {
  const tests::TemporaryFolder folder;
  std::string data;
  append(data, to_half(1.5F));
  append(data, std::int32_t{-7});
  append(data, 2.25F);
  data += '\1';
  write_bytes(folder / "one.bin", data.substr(0, 4));  // Shards may end inside a tensor.
  write_bytes(folder / "two.bin", data.substr(4));
  write_bytes(folder / "m.json",
              R"({"weightsManifest": [{"paths": ["one.bin", "two.bin"], "weights": [
                {"name": "half", "shape": [], "dtype": "float32",
                 "quantization": {"dtype": "float16"}},
                {"name": "int", "shape": [1], "dtype": "int32"},
                {"name": "float", "shape": [1, 1], "dtype": "float32"},
                {"name": "flag", "shape": [1], "dtype": "bool"}]}]})");
  const TensorFile file = read_tensor_file(folder / "m.json");
  ASSERT_EQ(file.tensors.size(), 4U);
  EXPECT_EQ(file.data_name, "one.bin");
  const float wanted[] = {1.5F, -7.0F, 2.25F, 1.0F};
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_THAT(file.read(file.tensors[i]).values, ElementsAre(wanted[i]));
  }
}

TEST(Tfjs, RefusesInOneLineWhatDoesNotFit) {
  const tests::TemporaryFolder folder;
  const auto file = write_tfjs(folder, some_tensors());
  const std::string data = tfjs_data(some_tensors());
  const auto refusal = [&] {
    return tests::input_error_of([&] { (void)read_tensor_file(file); });
  };
  write_bytes(folder / "model.bin", data.substr(0, data.size() - 1));
  EXPECT_THAT(refusal(), HasSubstr("model.json: b: expected a tensor inside model.bin, found "
                                   "[2] with 3 bytes left"));
  write_bytes(folder / "model.bin", data + "x");
  EXPECT_THAT(refusal(), HasSubstr("expected 16 bytes in model.bin, found 17"));
  std::filesystem::remove(folder / "model.bin");
  EXPECT_THAT(refusal(), HasSubstr("model.bin"));

  write_bytes(folder / "model.bin", data);
  const auto changed = [&](const auto& change) {
    auto manifest = tfjs_manifest(some_tensors(), "model.bin");
    change(manifest["weightsManifest"][0]);
    write_bytes(file, manifest.dump());
    return refusal();
  };
  EXPECT_THAT(changed([](auto& group) {
                group["weights"][0]["shape"] = {-2, -3};
              }),
              HasSubstr("a: expected a tensor inside"));
  EXPECT_THAT(changed([](auto& group) {
                group["weights"][0]["shape"] = {1LL << 40, 1LL << 40};
              }),
              HasSubstr("a: expected a tensor inside"));
  EXPECT_THAT(
      changed([](auto& group) { group["weights"][0]["dtype"] = "complex64"; }),
      HasSubstr("a: expected float32, stored as it is or as float16, found complex64"));
  EXPECT_THAT(changed([](auto& group) { group["weights"][1].erase("quantization"); }),
              HasSubstr("b: expected a tensor inside"));
  EXPECT_THAT(
      changed([](auto& group) { group["weights"][1]["quantization"]["dtype"] = "uint8"; }),
      HasSubstr("b: expected float32, stored as it is or as float16, found float32 stored"));
  for (const char* name : {"../model.bin", "/etc/passwd", "..", ""}) {
    EXPECT_THAT(changed([&](auto& group) { group["paths"] = {name}; }),
                HasSubstr("paths: expected names of files beside it"));
  }
  EXPECT_THAT(changed([](auto& group) { group["weights"][1]["name"] = "a"; }),
              HasSubstr("expected each tensor once, found a again"));
  EXPECT_THAT(changed([](auto& group) { group.erase("weights"); }),
              HasSubstr("expected a TensorFlow.js model"));
}

/// Reading must end in tensors or in an InputError, whatever the bytes.
bool is_refused(const std::filesystem::path& file) {
  try {
    const TensorFile read = read_tensor_file(file);
    for (const StoredTensor& tensor : read.tensors) (void)read.read(tensor);
    return false;
  } catch (const core::InputError&) {
    return true;
  }
}

TEST(Tfjs, TruncatedAndDamagedModelsAreReadOrRefused) {
  const tests::TemporaryFolder folder;
  const auto file = write_tfjs(folder, some_tensors());
  const std::string text = core::read_file(file);
  ASSERT_FALSE(is_refused(file));
  for (std::size_t length = 0; length < text.size(); ++length) {
    write_bytes(file, text.substr(0, length));
    EXPECT_TRUE(is_refused(file)) << length;
  }
  std::size_t refused = 0;
  for (std::size_t bit = 0; bit < 8 * text.size(); ++bit) {
    std::string damaged = text;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    write_bytes(file, damaged);
    refused += is_refused(file) ? 1 : 0;
  }
  EXPECT_GT(refused, 4 * text.size());
  EXPECT_LT(refused, 8 * text.size());  // Another letter in a name is another name.
}

}  // namespace
}  // namespace segsim::perception
