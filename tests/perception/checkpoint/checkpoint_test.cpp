#include <gmock/gmock.h>

#include <fstream>

#include "core/error.h"
#include "core/input/crc32.h"
#include "core/random.h"
#include "perception/checkpoint/pickle.h"
#include "perception/checkpoint/tensor_file.h"
#include "tests/error_message.h"
#include "tests/perception/checkpoint_writer.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {
namespace {

using segsim::tests::input_error_of;

using pickled::dict;
using pickled::object;
using pickled::text;
using testing::HasSubstr;

std::vector<NamedTensor> some_tensors() {
  return {{"a.weight", {2, 3}, {0.5F, -1.0F, 2.0F, 0.25F, 8.0F, -0.125F}},
          {"a.bias", {2}, {1.0F, -3.0F}},
          {"gate", {}, {0.75F}},
          {"none", {0, 4}, {}}};
}

TensorFile read_bytes(const tests::TemporaryFolder& folder, const std::string& bytes) {
  std::ofstream(folder / "file.pt", std::ios::binary) << bytes;
  return read_tensor_file(folder / "file.pt");
}

/// A file of one pickle and one storage of 6 floats 0 ... 5.
std::string file_of(const std::string& value) {
  return make_zip({{"x/data.pkl", pickled::kBegin + value + pickled::kEnd},
                   {"x/data/0", raw({0, 1, 2, 3, 4, 5}, false)}});
}
std::string tensor_of(std::int64_t first, const std::vector<std::int64_t>& shape,
                      const std::vector<std::int64_t>& strides) {
  return pickled::tensor("FloatStorage", "0", 6, first, shape, strides);
}
std::string state_of(const std::string& tensor) {
  return pickled::ordered_dict({{text("w"), tensor}});
}

void expect_equal(const TensorFile& file, const std::vector<NamedTensor>& wanted) {
  ASSERT_EQ(file.tensors.size(), wanted.size());
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const NamedTensor found = file.read(file.tensors[i]);
    EXPECT_EQ(found.name, wanted[i].name);
    EXPECT_EQ(found.shape, wanted[i].shape);
    EXPECT_EQ(found.values, wanted[i].values);
  }
}

TEST(Checkpoint, ReadsStateDictsAndSafetensorsInBothPrecisions) {
  const tests::TemporaryFolder folder;
  for (const bool half : {false, true}) {
    expect_equal(read_bytes(folder, make_state_dict_file(some_tensors(), half)),
                 some_tensors());
    expect_equal(read_bytes(folder, make_safetensors_file(some_tensors(), half)),
                 some_tensors());
  }
}

TEST(Checkpoint, ReadsTheDirectoryIn64Bit) {
  const tests::TemporaryFolder folder;
  const std::string pickle =
      pickled::kBegin + state_of(tensor_of(0, {6}, {1})) + pickled::kEnd;
  const auto bytes =
      make_zip({{"x/data.pkl", pickle}, {"x/data/0", raw({0, 1, 2, 3, 4, 5}, false)}}, true);
  expect_equal(read_bytes(folder, bytes), {{"w", {6}, {0, 1, 2, 3, 4, 5}}});
}

TEST(Checkpoint, FollowsOffsetsAndStrides) {
  const tests::TemporaryFolder folder;
  expect_equal(read_bytes(folder, file_of(state_of(tensor_of(1, {2, 2}, {1, 3})))),
               {{"w", {2, 2}, {1, 4, 2, 5}}});
}

TEST(Checkpoint, WalksAModuleTreeAsData) {
  const tests::TemporaryFolder folder;
  const auto leaf = object(
      "torch.nn.modules.conv", "Conv2d",
      {{text("training"), pickled::kTrue},
       {text("_parameters"),
        dict({{text("weight"), pickled::name("torch._utils", "_rebuild_parameter") +
                                   pickled::tuple({tensor_of(0, {6}, {1}), pickled::kTrue,
                                                   pickled::ordered_dict({})}) +
                                   "R"},
              {text("bias"), pickled::kNone}})},
       {text("_buffers"), dict({{text("mean"), tensor_of(2, {2}, {1})}})},
       {text("_modules"), dict({})}});
  const auto model = object("ultralytics.nn.tasks", "DetectionModel",
                            {{text("names"), dict({{pickled::integer(1), text("table")},
                                                   {pickled::integer(0), text("chair")}})},
                             {text("_modules"), dict({{text("model"), leaf}})}});
  const auto other = object("ultralytics.nn.tasks", "DetectionModel", {});
  // Averaged weights win over plain ones; None does not.
  for (const auto& checkpoint :
       {dict({{text("model"), other}, {text("ema"), model}}),
        dict({{text("ema"), pickled::kNone}, {text("model"), model}})}) {
    const TensorFile file = read_bytes(folder, file_of(checkpoint));
    expect_equal(file,
                 {{"model.weight", {6}, {0, 1, 2, 3, 4, 5}}, {"model.mean", {2}, {2, 3}}});
    EXPECT_EQ(file.class_names, (std::vector<std::string>{"chair", "table"}));
  }
}

TEST(Checkpoint, ReadsTorchScriptAttributes) {
  const tests::TemporaryFolder folder;
  const auto leaf =
      object("__torch__.Inner", "Inner", {{text("weight"), tensor_of(0, {2}, {1})}});
  const auto root =
      object("__torch__", "Outer", {{text("training"), pickled::kTrue}, {text("0"), leaf}});
  expect_equal(read_bytes(folder, file_of(root)), {{"0.weight", {2}, {0, 1}}});
}

TEST(Checkpoint, RefusesWhateverCouldRun) {
  const tests::TemporaryFolder folder;
  const auto refusal = [&](const std::string& value) {
    return input_error_of([&] { (void)read_bytes(folder, file_of(value)); });
  };
  const auto call = [](const std::string& module, const std::string& name) {
    return pickled::name(module, name) + pickled::tuple({text("touch here")}) + "R";
  };
  EXPECT_THAT(refusal(call("posix", "system")), HasSubstr("found \"posix system\""));
  EXPECT_THAT(refusal(call("builtins", "eval")), HasSubstr("found \"builtins eval\""));
  EXPECT_THAT(refusal(call("__builtin__", "getattr")), HasSubstr("__builtin__ getattr"));
  EXPECT_THAT(refusal(call("torchx", "Tensor")), HasSubstr("torchx Tensor"));
  // INST, EXT1, PERSID and GET: instructions that torch never writes.
  EXPECT_THAT(refusal("(iposix\nsystem\n"),
              HasSubstr("expected an instruction of plain data, found code 105"));
  EXPECT_THAT(refusal(std::string("\x82\x01")), HasSubstr("code 130"));
  EXPECT_THAT(refusal("Psomewhere\n"), HasSubstr("code 80"));
  EXPECT_THAT(refusal("\x80\x05"), HasSubstr("expected protocol 2 to 4, found 5"));
}

TEST(Checkpoint, RefusesTensorsThatLeaveTheirStorage) {
  const tests::TemporaryFolder folder;
  const auto refusal = [&](const std::string& tensor) {
    return input_error_of([&] { (void)read_bytes(folder, file_of(state_of(tensor))); });
  };
  constexpr std::int64_t kLarge = 2'000'000'000;
  EXPECT_THAT(refusal(tensor_of(0, {7}, {1})),
              HasSubstr("w: expected elements inside its storage of 6"));
  EXPECT_THAT(refusal(tensor_of(1, {6}, {1})), HasSubstr("inside its storage"));
  EXPECT_THAT(refusal(tensor_of(-1, {2}, {1})), HasSubstr("inside its storage"));
  EXPECT_THAT(refusal(tensor_of(0, {2, 2}, {1, -1})), HasSubstr("inside its storage"));
  EXPECT_THAT(refusal(tensor_of(0, {-2}, {1})), HasSubstr("inside its storage"));
  EXPECT_THAT(refusal(tensor_of(0, {kLarge, kLarge, kLarge}, {kLarge, kLarge, kLarge})),
              HasSubstr("inside its storage"));
  EXPECT_THAT(refusal(tensor_of(0, {1000}, {0})), HasSubstr("inside its storage"));
  EXPECT_THAT(refusal(tensor_of(0, {2, 2}, {1})), HasSubstr("one stride per side"));
  EXPECT_THAT(refusal(pickled::tensor("FloatStorage", "1", 6, 0, {1}, {1})),
              HasSubstr("record data/1"));
  EXPECT_THAT(refusal(pickled::tensor("QInt8Storage", "0", 6, 0, {1}, {1})),
              HasSubstr("QInt8Storage"));
}

TEST(Checkpoint, BoundsTheWalk) {
  const tests::TemporaryFolder folder;
  // A module that holds itself: stored in the memo before its state is set.
  const std::string cycle =
      pickled::name("torch.nn", "Module") + ")\x81q\x01" +
      dict({{text("_modules"), dict({{text("m"), std::string("h\x01")}})}}) + "b";
  EXPECT_THAT(input_error_of([&] { (void)read_bytes(folder, file_of(cycle)); }),
              HasSubstr("expected a tree of modules"));
  // Each level holds the one below twice: 2^40 modules.
  std::string tower =
      object("torch.nn", "Module", {{text("_modules"), dict({})}}) + std::string("q\x00", 2);
  for (char level = 1; level < 40; ++level) {
    const std::string below = std::string("h") + static_cast<char>(level - 1);
    tower += "0" +
             object("torch.nn", "Module",
                    {{text("_modules"), dict({{text("a"), below}, {text("b"), below}})}}) +
             "q" + level;
  }
  EXPECT_THAT(input_error_of([&] { (void)read_bytes(folder, file_of(tower)); }),
              HasSubstr("expected a tree of modules"));
}

/// What is stored once can be named a million times: memory is asked for by the names.
TEST(Checkpoint, BoundsWhatManyNamesAskFor) {
  const tests::TemporaryFolder folder;
  const auto refusal = [&](const std::string& value) {
    return input_error_of([&] { (void)read_bytes(folder, file_of(value)); });
  };
  // So many views of one storage, which is most of the file.
  const auto refusal_of_views = [&](int count) {
    std::vector<std::pair<std::string, std::string>> views;
    for (int k = 0; k < count; ++k) {
      views.emplace_back(text("w" + std::to_string(k)),
                         pickled::tensor("FloatStorage", "0", 20'000, 0, {20'000}, {1}));
    }
    const std::string bytes = make_zip(
        {{"x/data.pkl", pickled::kBegin + pickled::ordered_dict(views) + pickled::kEnd},
         {"x/data/0", raw(std::vector<float>(20'000, 1.0F), false)}});
    return input_error_of([&] { (void)read_bytes(folder, bytes); });
  };
  EXPECT_EQ(refusal_of_views(4), "no error");
  EXPECT_THAT(refusal_of_views(10), HasSubstr("times the file's bytes"));
  EXPECT_THAT(refusal(state_of(tensor_of(0, std::vector<std::int64_t>(9, 1),
                                         std::vector<std::int64_t>(9, 1)))),
              HasSubstr("at most 8 sides"));
  const std::string long_name(2000, 'n');
  EXPECT_THAT(refusal(pickled::ordered_dict({{text(long_name), tensor_of(0, {6}, {1})}})),
              HasSubstr("names of at most 1024 characters"));
  EXPECT_THAT(refusal(pickled::name("torch", long_name)),
              HasSubstr("names of at most 1024 characters"));
  const std::string deep(1000, '[');
  std::string bytes;
  append(bytes, std::uint64_t{deep.size() + 5});
  EXPECT_THAT(input_error_of([&] { (void)read_bytes(folder, bytes + R"({"w":)" + deep); }),
              HasSubstr("nested beyond any use"));
}

TEST(Checkpoint, SaysWhatAFileIsNot) {
  const tests::TemporaryFolder folder;
  const auto refusal = [&](const std::string& bytes) {
    return input_error_of([&] { (void)read_bytes(folder, bytes); });
  };
  EXPECT_THAT(refusal(""), HasSubstr("expected a .pt file"));
  EXPECT_THAT(refusal("\x80\x02\x8a\x0al\xfc\x9c"
                      "F\xf9 j\xa8P\x19.\x80\x02M\xe9\x03."),
              HasSubstr("expected a .pt file"));
  EXPECT_THAT(refusal(make_zip({{"x/other", "1"}})),
              HasSubstr("expected a torch file with data.pkl"));
  EXPECT_THAT(refusal(make_zip({{"x/data.pkl", "1"}}, false, 8)),
              HasSubstr("neither compressed nor encrypted"));
  EXPECT_THAT(refusal(make_zip({{"x/data.pkl", "N."}, {"x/data.pkl", "N."}})),
              HasSubstr("each record once"));
  EXPECT_THAT(
      refusal(make_zip({{"x/data.pkl", pickled::kBegin + "N."}, {"x/byteorder", "big"}})),
      HasSubstr("byteorder: expected little, found big"));
  EXPECT_THAT(refusal(file_of(dict({{text("epoch"), pickled::integer(3)}}))),
              HasSubstr("a state dict or a module with tensors"));
}

TEST(Checkpoint, RefusesSafetensorsOutsideTheFile) {
  const tests::TemporaryFolder folder;
  const auto refusal = [&](const std::string& header) {
    std::string bytes;
    append(bytes, std::uint64_t{header.size()});
    return input_error_of([&] { (void)read_bytes(folder, bytes + header + "12345678"); });
  };
  EXPECT_THAT(refusal(R"({"w":{"dtype":"F32","shape":[3],"data_offsets":[0,12]}})"),
              HasSubstr("w: expected as many bytes"));
  EXPECT_THAT(refusal(R"({"w":{"dtype":"F32","shape":[3],"data_offsets":[0,8]}})"),
              HasSubstr("w: expected as many bytes"));
  EXPECT_THAT(refusal(R"({"w":{"dtype":"F32","shape":[2],"data_offsets":[8,0]}})"),
              HasSubstr("w: expected as many bytes"));
  EXPECT_THAT(refusal(R"({"w":{"dtype":"F4","shape":[2],"data_offsets":[0,8]}})"),
              HasSubstr("found F4"));
  EXPECT_THAT(refusal(R"({"w":{"dtype":"F32","shape":[2]}})"),
              HasSubstr("a safetensors header"));
  EXPECT_THAT(refusal(R"({"w":[]})"), HasSubstr("a safetensors header"));
  EXPECT_THAT(refusal(R"({"w":{"dtype":"F32","shape":[2],"data_offsets":[1e30,8]}})"),
              HasSubstr("expected a whole number from 0"));
  EXPECT_THAT(refusal(R"({"w":{"dtype":"F32","shape":[2],"data_offsets":[-8,0]}})"),
              HasSubstr("expected a whole number from 0"));
}

/// Reading must end in tensors or in an InputError, whatever the bytes.
void expect_defined(const tests::TemporaryFolder& folder, const std::string& bytes,
                    int& refused) {
  try {
    const TensorFile file = read_bytes(folder, bytes);
    for (const StoredTensor& tensor : file.tensors) (void)file.read(tensor);
  } catch (const core::InputError&) {
    ++refused;
  }
}

TEST(Checkpoint, EveryTruncationIsRefused) {
  const tests::TemporaryFolder folder;
  for (const std::string& whole : {make_state_dict_file(some_tensors(), true),
                                   make_safetensors_file(some_tensors(), true)}) {
    int refused = 0;
    for (std::size_t length = 0; length < whole.size(); ++length)
      expect_defined(folder, whole.substr(0, length), refused);
    EXPECT_EQ(refused, static_cast<int>(whole.size()));
  }
}

TEST(Checkpoint, DamagedFilesAreReadOrRefused) {
  const tests::TemporaryFolder folder;
  for (const std::string& whole : {make_state_dict_file(some_tensors(), false),
                                   make_safetensors_file(some_tensors(), false)}) {
    int refused = 0;
    for (std::size_t bit = 0; bit < 8 * whole.size(); ++bit) {
      std::string damaged = whole;
      damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
      expect_defined(folder, damaged, refused);
    }
    EXPECT_GT(refused, static_cast<int>(whole.size()));
  }
}

TEST(Pickle, DamagedPicklesAreReadOrRefused) {
  // Without the checksum of the zip file in front of it.
  const std::string whole =
      pickled::kBegin + state_of(tensor_of(0, {2, 3}, {3, 1})) + pickled::kEnd;
  core::RandomStream random(1, "damage");
  int refused = 0;
  for (int round = 0; round < 20'000; ++round) {
    std::string damaged = whole;
    for (std::uint32_t i = 0; i <= random.index(3); ++i) {
      damaged[random.index(static_cast<std::uint32_t>(damaged.size()))] =
          static_cast<char>(random.index(256));
    }
    try {
      (void)Pickle::read(damaged, "p");
    } catch (const core::InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 1000);
}

TEST(Pickle, ReadsNumbersOfEveryKind) {
  const Pickle pickle =
      Pickle::read(std::string("\x80\x02(K\x07M\x01\x02J\xfe\xff\xff\xff", 13) +
                       std::string("\x8a\x01\xff\x8a\x02\x00\x01\x8a\x00", 9) +
                       std::string("G\x3f\xf8\0\0\0\0\0\0t.", 11),
                   "p");
  const auto& items = pickle.at(pickle.root()).items;
  ASSERT_EQ(items.size(), 7U);
  const std::int64_t wanted[] = {7, 513, -2, -1, 256, 0};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(pickle.at(items[i]).integer, wanted[i]);
  EXPECT_EQ(pickle.at(items[6]).real, 1.5);
}

TEST(Zip, ChecksumIsTheStandardOne) { EXPECT_EQ(core::crc32("123456789"), 0xCBF43926U); }

}  // namespace
}  // namespace segsim::perception
