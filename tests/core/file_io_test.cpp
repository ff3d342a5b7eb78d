#include "core/file_io.h"

#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

#include <gtest/gtest.h>

#include "core/error.h"

namespace segsim::core {
namespace {

namespace fs = std::filesystem;

class FileIo : public ::testing::Test {
 protected:
  FileIo()
      : folder_(fs::temp_directory_path() / ("segsim_file_io_" + std::to_string(::getpid()))) {
    fs::create_directories(folder_);
  }
  ~FileIo() override { fs::remove_all(folder_); }
  [[nodiscard]] std::size_t files() const {
    std::size_t count = 0;
    for (const auto& entry : fs::directory_iterator(folder_)) count += entry.is_regular_file();
    return count;
  }
  fs::path folder_;
};

TEST_F(FileIo, WritesWholeFilesAndMakesParents) {
  const fs::path file = folder_ / "a" / "b.txt";
  write_file_atomically(file, [](std::ostream& out) { out << "hello"; });
  EXPECT_EQ(read_file(file), "hello");
}

TEST_F(FileIo, FailureLeavesTheOldFileAndNoRubbish) {
  const fs::path file = folder_ / "a.txt";
  write_file_atomically(file, [](std::ostream& out) { out << "old"; });
  EXPECT_THROW(write_file_atomically(file,
                                     [](std::ostream& out) {
                                       out << "half";
                                       throw std::runtime_error("stop");
                                     }),
               std::runtime_error);
  EXPECT_EQ(read_file(file), "old");
  EXPECT_EQ(files(), 1U);
}

TEST_F(FileIo, UnwritablePlaceIsAnInputError) {
  EXPECT_THROW(write_file_atomically("/proc/nowhere/x", [](std::ostream&) {}), InputError);
  EXPECT_THROW((void)read_file(folder_ / "none"), InputError);
  EXPECT_THROW((void)read_file(folder_), InputError);
}

TEST_F(FileIo, Sha256MatchesTheStandardsExample) {
  // FIPS 180-2, "abc".
  EXPECT_EQ(sha256_hex("abc"),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  write_file_atomically(folder_ / "x", [](std::ostream& out) { out << "abc"; });
  EXPECT_EQ(sha256_of_file(folder_ / "x"), sha256_hex("abc"));
}

/// Opening a pipe would wait for a writer, and a device has no end.
TEST_F(FileIo, OnlyRegularFilesAreOpened) {
  const fs::path pipe = folder_ / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  for (const fs::path& file : {pipe, fs::path("/dev/zero"), folder_}) {
    EXPECT_THROW((void)read_file(file), InputError) << file;
    EXPECT_THROW((void)sha256_of_file(file), InputError) << file;
  }
}

TEST_F(FileIo, NamesThatNoSystemTakesAreBadInput) {
  EXPECT_THROW((void)read_file(folder_ / std::string(5000, 'a')), InputError);
  EXPECT_THROW((void)sha256_of_file(folder_ / std::string(300, 'a')), InputError);
}

}  // namespace
}  // namespace segsim::core
