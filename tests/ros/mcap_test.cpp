#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "ros/mcap/mcap_reader.h"
#include "ros/mcap/mcap_writer.h"
#include "ros/mcap/topic.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/std_msgs.h"
#include "tests/error_message.h"
#include "tests/temporary_folder.h"

namespace segsim::ros::mcap {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

struct Kept {
  std::string topic;
  std::uint64_t time_ns = 0;
  std::uint32_t sequence = 0;
  std::vector<std::byte> data;
  bool operator==(const Kept&) const = default;
};

std::vector<Kept> read_all(Reader& reader, std::span<const std::string> topics = {}) {
  std::vector<Kept> kept;
  reader.read(
      [&](const StoredMessage& message) {
        kept.push_back({message.channel->topic,
                        message.log_time_ns,
                        message.sequence,
                        {message.data.begin(), message.data.end()}});
      },
      topics);
  return kept;
}

std::string written(const WriterOptions& options, int messages) {
  std::ostringstream out;
  Writer writer(out, options);
  TopicWriter<std_msgs::String> text(writer, "/text");
  TopicWriter<std_msgs::Header> header(writer, "/header", {.transient_local = true});
  for (int k = 0; k < messages; ++k) {
    const auto time_ns = static_cast<std::uint64_t>(k) * 1000;
    text.write(time_ns, {"message " + std::to_string(k) + std::string(50, 'x')});
    if (k % 3 == 0) header.write(time_ns, {{k, 7U}, "frame"});
  }
  writer.add_metadata({"segsim", {{"scene", "flat"}, {"arm", "after"}}});
  writer.close();
  return std::move(out).str();
}

std::vector<Kept> read_all(const fs::path& file, std::span<const std::string> topics = {}) {
  Reader reader(file);
  return read_all(reader, topics);
}

fs::path save(const tests::TemporaryFolder& folder, const std::string& bytes) {
  fs::path file = folder / "file.mcap";
  std::ofstream(file, std::ios::binary) << bytes;
  return file;
}

class EveryCompression : public ::testing::TestWithParam<Compression> {
 protected:
  [[nodiscard]] WriterOptions options(std::size_t chunk_bytes = 1000) const {
    return {GetParam(), chunk_bytes, "ros2"};
  }
};

INSTANTIATE_TEST_SUITE_P(Mcap, EveryCompression,
                         ::testing::Values(Compression::kNone, Compression::kLz4,
                                           Compression::kZstd),
                         [](const auto& with) { return std::string(to_string(with.param)); });

TEST_P(EveryCompression, WhatIsWrittenIsRead) {
  const tests::TemporaryFolder folder;
  const fs::path file = save(folder, written(options(), 100));
  Reader reader(file);
  EXPECT_TRUE(reader.has_index());
  EXPECT_EQ(reader.truncation(), "");
  EXPECT_EQ(reader.profile(), "ros2");
  EXPECT_THAT(reader.library(), HasSubstr("segsim"));
  EXPECT_EQ(reader.message_count(), 134U);
  ASSERT_EQ(reader.metadata().size(), 1U);
  EXPECT_EQ(reader.metadata()[0], (Metadata{"segsim", {{"scene", "flat"}, {"arm", "after"}}}));
  ASSERT_EQ(reader.channels().size(), 2U);
  EXPECT_EQ(*reader.channels()[1],
            ros2_channel("/header", describe<std_msgs::Header>(), {.transient_local = true}));
  int texts = 0, headers = 0;
  reader.read([&](const StoredMessage& message) {
    if (message.channel->topic == "/text") {
      EXPECT_EQ(message.sequence, static_cast<std::uint32_t>(texts));
      EXPECT_EQ(message.log_time_ns, static_cast<std::uint64_t>(texts) * 1000);
      EXPECT_THAT(decode<std_msgs::String>(message).data,
                  HasSubstr("message " + std::to_string(texts++)));
    } else {
      EXPECT_EQ(decode<std_msgs::Header>(message).stamp.sec, 3 * headers++);
    }
  });
  EXPECT_EQ(texts, 100);
  EXPECT_EQ(headers, 34);
}

TEST_P(EveryCompression, WithoutItsEndAFileIsReadAsFarAsItGoes) {
  const tests::TemporaryFolder folder;
  const fs::path file = save(folder, written(options(300), 6));
  const std::vector<Kept> all = read_all(file);
  std::size_t most = all.size();
  for (std::uintmax_t size = fs::file_size(file) - 1; size > 0; --size) {
    fs::resize_file(file, size);
    std::vector<Kept> kept;
    try {
      Reader reader(file);
      EXPECT_FALSE(reader.has_index());
      EXPECT_THAT(reader.truncation(), HasSubstr("the end of the file at byte"));
      kept = read_all(reader);
    } catch (const core::InputError& error) {
      // Only what does not even hold the header is no MCAP file.
      ASSERT_LT(size, 120U) << error.what();
      continue;
    }
    ASSERT_LE(kept.size(), most) << "a shorter part has no more messages";
    EXPECT_TRUE(std::equal(kept.begin(), kept.end(), all.begin())) << size;
    most = kept.size();
  }
  EXPECT_EQ(most, 0U);
}

TEST_P(EveryCompression, AFlippedBitIsFoundOrChangesNoMessage) {
  const tests::TemporaryFolder folder;
  const std::string bytes = written(options(300), 6);
  const fs::path file = save(folder, bytes);
  const std::vector<Kept> all = read_all(file);
  std::fstream patch(file, std::ios::in | std::ios::out | std::ios::binary);
  const auto put = [&](std::size_t at, char byte) {
    patch.seekp(static_cast<std::streamoff>(at));
    patch.put(byte).flush();
  };
  std::size_t found = 0;
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    put(at, static_cast<char>(bytes[at] ^ (1 << at % 8)));
    try {
      EXPECT_EQ(read_all(file), all) << "bit " << at % 8 << " of byte " << at;
    } catch (const core::InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("file.mcap"));
      EXPECT_THAT(error.what(), HasSubstr("expected"));
      ++found;
    }
    put(at, bytes[at]);
  }
  // What is stored twice, or tells nothing about messages, may change.
  EXPECT_GT(found, bytes.size() / 2);
}

TEST(Mcap, AnEmptyFileIsAFile) {
  const tests::TemporaryFolder folder;
  std::ostringstream out;
  Writer(out).close();
  const fs::path file = save(folder, out.str());
  const Reader reader(file);
  EXPECT_EQ(reader.message_count(), 0U);
  EXPECT_EQ(reader.truncation(), "");
  EXPECT_TRUE(read_all(file).empty());
}

TEST(Mcap, MessagesComeInOrderOfTime) {
  const tests::TemporaryFolder folder;
  std::ostringstream out;
  Writer writer(out, {Compression::kLz4, 400, "ros2"});
  TopicWriter<std_msgs::String> text(writer, "/text");
  core::RandomStream random(7, "order");
  for (int k = 0; k < 200; ++k) {
    text.write(random.index(1000), {std::to_string(k)});
  }
  writer.close();
  const std::vector<Kept> kept = read_all(save(folder, out.str()));
  ASSERT_EQ(kept.size(), 200U);
  for (std::size_t k = 1; k < kept.size(); ++k) {
    EXPECT_LE(kept[k - 1].time_ns, kept[k].time_ns);
    if (kept[k - 1].time_ns == kept[k].time_ns) {
      EXPECT_LT(kept[k - 1].sequence, kept[k].sequence);
    }
  }
}

TEST(Mcap, TopicsAreChosen) {
  const tests::TemporaryFolder folder;
  const fs::path file = save(folder, written({}, 30));
  const std::vector<std::string> topics = {"/header", "/nothing"};
  const std::vector<Kept> kept = read_all(file, topics);
  EXPECT_EQ(kept.size(), 10U);
  for (const Kept& one : kept) EXPECT_EQ(one.topic, "/header");
}

TEST(Mcap, AMessageOfAnotherTypeIsNotDecoded) {
  const tests::TemporaryFolder folder;
  Reader reader(save(folder, written({}, 1)));
  const std::vector<std::string> topics = {"/text"};
  EXPECT_THAT(tests::input_error_of([&] {
                reader.read([](const StoredMessage& m) { (void)decode<std_msgs::Header>(m); },
                            topics);
              }),
              HasSubstr("message on /text at 0 ns: expected std_msgs/msg/Header, found "
                        "std_msgs/msg/String"));
}

TEST(Mcap, OtherFilesAreRefused) {
  const tests::TemporaryFolder folder;
  const auto error = [&](const std::string& bytes) {
    return tests::input_error_of([&] { (void)read_all(save(folder, bytes)); });
  };
  EXPECT_THAT(error(""), HasSubstr("expected an MCAP file, found another"));
  EXPECT_THAT(error("SQLite format 3 and more"), HasSubstr("expected an MCAP file"));
  EXPECT_THAT(tests::input_error_of([&] { (void)read_all(folder.path()); }),
              HasSubstr("expected a readable file"));
}

TEST(Mcap, WhatIsCompressedIsNoLongerThanItSays) {
  // A chunk whose size was set to nearly nothing: its checksum is not even asked.
  const tests::TemporaryFolder folder;
  std::string bytes = written({Compression::kZstd, 1000, "ros2"}, 30);
  const std::size_t chunk = bytes.find(std::string("\x06", 1), 50);
  ASSERT_NE(chunk, std::string::npos);
  for (int k = 0; k < 8; ++k) bytes[chunk + 9 + 16 + k] = k == 0 ? '\x05' : '\0';
  EXPECT_THAT(tests::input_error_of([&] { (void)read_all(save(folder, bytes)); }),
              HasSubstr("expected 5 bytes compressed by zstd, found more"));
}

TEST(Mcap, AChunkCannotAskForMemory) {
  const tests::TemporaryFolder folder;
  std::string bytes = written({Compression::kLz4, 1000, "ros2"}, 30);
  const std::size_t chunk = bytes.find(std::string("\x06", 1), 50);
  bytes[chunk + 9 + 16 + 5] = '\x7f';
  EXPECT_THAT(tests::input_error_of([&] { (void)read_all(save(folder, bytes)); }),
              HasSubstr("expected at most 268435456 bytes, decompressed, found 13963"));
}

/// Each message lies in a chunk of 16 MB that compresses to next to nothing.
TEST(Mcap, ASmallFileCannotTakeLong) {
  const tests::TemporaryFolder folder;
  std::ostringstream out;
  Writer writer(out, {Compression::kZstd, 1U << 24U, "ros2"});
  TopicWriter<std_msgs::String> text(writer, "/text");
  const std_msgs::String blank{std::string(1U << 24U, ' ')};
  for (std::uint64_t k = 0; k < 45; ++k) text.write(k, blank);
  writer.close();
  const fs::path file = save(folder, out.str());
  ASSERT_LT(fs::file_size(file), 200'000U);
  EXPECT_THAT(tests::input_error_of([&] { (void)read_all(file); }),
              HasSubstr("bytes, decompressed"));
}

}  // namespace
}  // namespace segsim::ros::mcap
