#include "core/file_io.h"

#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "core/error.h"
#include "core/system/remakeable_file.h"
#include "core/system/sync_to_disk.h"
#include "core/system/system_random.h"

namespace {

/// What was waited for, in order; with what was in it, if it was a file.
struct Synced {
  std::filesystem::path path;
  std::string content;
};
std::vector<Synced> synced;
int sync_error = 0;  ///< What the next calls fail with.

}  // namespace

/// In the place of the C library's.
extern "C" int fsync(int descriptor) {
  const auto path =
      std::filesystem::read_symlink("/proc/self/fd/" + std::to_string(descriptor));
  std::string content;
  if (std::filesystem::is_regular_file(path)) content = segsim::core::read_file(path);
  synced.push_back({path, content});
  if (sync_error != 0) {
    errno = sync_error;
    return -1;
  }
  return static_cast<int>(::syscall(SYS_fsync, descriptor));
}

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

/// A name may not outlive a power cut without what it stands for.
TEST_F(FileIo, FilesAndThenTheirNamesAreOnTheDisk) {
  const fs::path file = folder_ / "a.txt";
  synced.clear();
  write_file_atomically(file, [](std::ostream& out) { out << "whole"; });
  ASSERT_EQ(synced.size(), 2U);
  EXPECT_EQ(synced[0].content, "whole");
  EXPECT_NE(synced[0].path, file) << "before the file has its name";
  EXPECT_EQ(synced[1].path, folder_);

  synced.clear();
  write_via_temporary(file, [](const fs::path& to) { std::ofstream(to) << "by name"; });
  ASSERT_EQ(synced.size(), 2U);
  EXPECT_EQ(synced[0].content, "by name");
}

TEST_F(FileIo, PicturesDoNotWaitForTheDisk) {
  synced.clear();
  write_remakeable_file(folder_ / "a.png", [](std::ostream& out) { out << "x"; });
  EXPECT_TRUE(synced.empty());
  EXPECT_EQ(read_file(folder_ / "a.png"), "x");
}

TEST_F(FileIo, ADiskThatFailsLeavesTheOldFile) {
  const fs::path file = folder_ / "a.txt";
  write_file_atomically(file, [](std::ostream& out) { out << "old"; });
  sync_error = EIO;
  EXPECT_THROW(write_file_atomically(file, [](std::ostream& out) { out << "new"; }),
               InputError);
  EXPECT_THROW(sync_to_disk(folder_), InputError);
  sync_error = 0;
  EXPECT_EQ(read_file(file), "old");
  EXPECT_EQ(files(), 1U);
  sync_error = EINVAL;  // File systems that have nothing to wait for.
  EXPECT_NO_THROW(sync_to_disk(folder_));
  sync_error = 0;
}

/// Process ids are the same in two containers that share a folder.
TEST_F(FileIo, TemporaryNamesDoNotComeFromTheProcess) {
  std::set<std::string> names;
  for (int k = 0; k < 3; ++k) {
    write_via_temporary(folder_ / "a.txt", [&](const fs::path& to) {
      names.insert(to.filename().string());
      EXPECT_EQ(to.extension(), ".txt");
      std::ofstream(to) << "x";
    });
  }
  EXPECT_EQ(names.size(), 3U);
  EXPECT_EQ(random_hex(16).size(), 32U);
}

/// As another user than root, which may write everywhere.
TEST_F(FileIo, AFolderThatMayNotBeWrittenToIsNamed) {
  fs::permissions(folder_, fs::perms::owner_read | fs::perms::owner_exec |
                               fs::perms::others_read | fs::perms::others_exec);
  const bool root = ::geteuid() == 0;
  ASSERT_EQ(::seteuid(root ? 65534 : ::geteuid()), 0);
  std::string said;
  try {
    write_file_atomically(folder_ / "a.txt", [](std::ostream&) {});
  } catch (const InputError& error) {
    said = error.what();
  }
  ASSERT_EQ(::seteuid(root ? 0 : ::geteuid()), 0);
  fs::permissions(folder_, fs::perms::owner_all);
  EXPECT_EQ(said, (folder_ / "a.txt").string() + ": expected a folder that can be written to" +
                      ", found " + folder_.string() + ", which may not be: Permission denied");
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
