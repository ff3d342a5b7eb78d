#include "experiments/support/gzip_file.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;

class GzipTest : public testing::Test {
 protected:
  void put(const std::string& bytes) const { std::ofstream(file_, std::ios::binary) << bytes; }
  [[nodiscard]] std::string refusal(std::size_t most = std::size_t{1} << 30U) const {
    try {
      (void)support::read_gzip(file_, most);
    } catch (const core::InputError& error) {
      return error.what();
    }
    return {};
  }
  TemporaryFolder folder_{"gzip"};
  std::filesystem::path file_ = folder_.path() / "x.json.gz";
};

TEST_F(GzipTest, GivesBackWhatWasWritten) {
  // Empty, short, and longer than any buffer in every state of compressibility.
  std::string noise;
  core::RandomStream random(1, "noise");
  for (int k = 0; k < 300000; ++k) noise += static_cast<char>(random.index(256));
  for (const std::string& text :
       {std::string(), std::string("a"), std::string(1000000, 'z'), noise}) {
    support::write_gzip(file_, text);
    EXPECT_EQ(support::read_gzip(file_), text) << text.size();
  }
}

TEST_F(GzipTest, EqualTextsGiveEqualFiles) {
  support::write_gzip(file_, "hello");
  const std::string first = core::read_file(file_);
  support::write_gzip(file_, "hello");
  EXPECT_EQ(core::read_file(file_), first);
}

TEST_F(GzipTest, MembersFollowOneAnother) {
  support::write_gzip(file_, "one ");
  const std::string first = core::read_file(file_);
  support::write_gzip(file_, "two");
  put(first + core::read_file(file_));
  EXPECT_EQ(support::read_gzip(file_), "one two");
}

TEST_F(GzipTest, DamageIsNamed) {
  EXPECT_THAT(refusal(), HasSubstr("x.json.gz"));  // There is no file.
  put("");
  EXPECT_THAT(refusal(), HasSubstr("empty"));
  put("{\"episodes\": []}");
  EXPECT_THAT(refusal(), HasSubstr("whole gzip file"));
  support::write_gzip(file_, std::string(5000, 'q') + "end");
  const std::string good = core::read_file(file_);
  put(good.substr(0, good.size() - 9));
  EXPECT_THAT(refusal(), HasSubstr("cut short"));
  std::string wrong = good;
  wrong[wrong.size() - 6] = static_cast<char>(wrong[wrong.size() - 6] ^ 0x55);  // Checksum.
  put(wrong);
  EXPECT_THAT(refusal(), HasSubstr("whole gzip file"));
  put(good + "tail");
  EXPECT_THAT(refusal(), HasSubstr("whole gzip file"));
}

TEST_F(GzipTest, ABombIsRefused) {
  support::write_gzip(file_, std::string(1000000, '\0'));
  EXPECT_THAT(refusal(10000), HasSubstr("10000"));
}

}  // namespace
}  // namespace segsim::experiments
