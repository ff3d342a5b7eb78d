// What is wrong with files and flags ends with exit code 2 and one line, in little time and
// memory, and never with a signal or the exit code for bugs (SECURITY.md).
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

struct Ending {
  int exit_code = -1;  ///< -1: a signal.
  std::string text;    ///< Standard output and error.
  long most_kB = 0;    ///< Of resident memory.
};

/// Under limits: 20 s of processor time, so that a busy machine does not matter; two minutes
/// by the clock for those that wait; no files beyond 1 GB.
Ending run_limited(const std::string& arguments) {
  int ends[2];
  EXPECT_EQ(::pipe(ends), 0);
  const std::string line = "ulimit -t 20 -f 2000000; exec timeout 120 " +
                           std::string(SEGSIM_BINARY) + " " + arguments;
  const pid_t child = ::fork();
  if (child == 0) {
    ::dup2(ends[1], 1);
    ::dup2(ends[1], 2);
    ::close(ends[0]);
    ::close(ends[1]);
    ::execl("/bin/bash", "bash", "-c", line.c_str(), static_cast<char*>(nullptr));
    std::_Exit(127);
  }
  ::close(ends[1]);
  Ending ending;
  char buffer[4096];
  for (ssize_t size = 0; (size = ::read(ends[0], buffer, sizeof buffer)) > 0;) {
    ending.text.append(buffer, static_cast<std::size_t>(size));
  }
  ::close(ends[0]);
  int status = 0;
  rusage usage{};
  EXPECT_EQ(::wait4(child, &status, 0, &usage), child);
  if (WIFEXITED(status)) ending.exit_code = WEXITSTATUS(status);
  ending.most_kB = usage.ru_maxrss;
  return ending;
}

/// The line that says what was wrong; what else was printed may stand before or after it.
std::string error_line(const std::string& text) {
  std::istringstream lines(text);
  std::string line, found;
  while (std::getline(lines, line)) {
    // "segsim: FILE: expected ...", "segsim episodes: expected ...".
    if (line.starts_with("segsim") && line.find(": ") != std::string::npos) found += line;
  }
  return found;
}

void expect_orderly(const std::string& arguments, const Ending& ending) {
  SCOPED_TRACE(arguments + "\n" + ending.text.substr(0, 2000));
  EXPECT_THAT(ending.exit_code, testing::AnyOf(0, 1, 2));
  EXPECT_LT(ending.most_kB, 2'000'000);
  if (ending.exit_code == 2) {
    EXPECT_NE(error_line(ending.text), "");
  }
}

/// Exit code 2 and one line that has `words`.
void expect_refused(const std::string& arguments, const std::string& words) {
  const Ending ending = run_limited(arguments);
  expect_orderly(arguments, ending);
  EXPECT_EQ(ending.exit_code, 2) << arguments;
  EXPECT_THAT(error_line(ending.text), HasSubstr(words));
}

class BadInput : public testing::Test {
 protected:
  [[nodiscard]] std::string in(const std::string& name) const {
    return (folder_ / name).string();
  }
  TemporaryFolder folder_;
};

TEST_F(BadInput, FlagsAreCheckedAtTheDoor) {
  for (const auto& [arguments, words] : std::vector<std::pair<std::string, std::string>>{
           {"nosuch --help", "expected a subcommand of `segsim --help`, found \"nosuch\""},
           {"captrue --help", "did you mean \"capture\"?"},
           {"episodes nosuch --help", "found \"nosuch\""},
           {"capture --flat 3 --width 0 --out x", "--width"},
           {"capture --flat 3 --width 1000000 --height 1000000 --out x", "--width"},
           {"capture --flat 3 --hfov-deg 180 --out x", "--hfov-deg"},
           {"capture --flat 3 --hfov-deg nan --out x", "expected a finite number, found nan"},
           {"capture --flat 3 --frames -1 --out x", "--frames"},
           {"capture --flat 3 --camera-height 1e38 --out x", "--camera-height"},
           {"render x.ply --out x.png --pose nan 0 1 0 0",
            "expected a finite number, found nan"},
           {"render x.ply --out x.png --pose 0 0 1e30 0 0", "--pose"},
           {"episodes generate b -o x.jsonl --min-start nan", "expected a finite number"},
           {"reconstruct s --out b --latitude nan", "expected a finite number"}}) {
    expect_refused(arguments, words);
  }
  EXPECT_EQ(run_limited("episodes --help").exit_code, 0);
}

TEST_F(BadInput, ErrorsOfLibrariesAreBadInput) {
  const std::string long_name(300, 'A');
  expect_refused("capture --flat 3 --frames 1 --out " + in(long_name), "File name too long");
  expect_refused("table " + in(long_name), long_name);
  folder_.write("t/transforms.json", R"({"frames": [{"file_path": 1e999}]})");
  expect_refused("reconstruct --check " + in("t"), "transforms.json: expected JSON");
  ASSERT_EQ(::mkfifo(in("pipe").c_str(), 0600), 0);
  expect_refused("run " + in("pipe"), "expected a readable file, found no regular file");
  expect_refused("render --out " + in("a.png") + " /dev/zero", "/dev/zero: expected");
  folder_.write("t.txt", "-1e308 0 1.2 0 0\n");
  expect_refused(
      "capture --flat 3 --frames 1 --out " + in("o") + " --trajectory " + in("t.txt"),
      "t.txt:1: expected numbers within");
}

/// The files that earlier versions did not get over, each with the command that reads its
/// kind.
class DamagedFiles : public BadInput {
 protected:
  void SetUp() override {
    const char* data = std::getenv("SEGSIM_DATA");
    if (data != nullptr) damaged_ = fs::path(data) / "damaged";
    if (damaged_.empty() || !fs::exists(damaged_)) {
      GTEST_SKIP() << "SEGSIM_DATA has no damaged files";
    }
  }
  [[nodiscard]] std::vector<fs::path> named(const std::string& part) const {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(damaged_)) {
      if (entry.path().filename().string().find(part) != std::string::npos) {
        files.push_back(entry.path());
      }
    }
    std::sort(files.begin(), files.end());
    return files;
  }
  /// @return The ending, for those who expect more.
  Ending try_out(const std::string& arguments) const {
    Ending ending = run_limited(arguments);
    expect_orderly(arguments, ending);
    return ending;
  }
  void expect_all_refused(const std::string& part, const std::string& before,
                          const std::string& after = {}) const {
    int number = 0;
    for (const fs::path& file : named(part)) {
      std::string end = after;
      if (const std::size_t at = end.find('#'); at != std::string::npos) {
        end.replace(at, 1, std::to_string(++number));
      }
      EXPECT_EQ(try_out(before + " " + file.string() + " " + end).exit_code, 2) << file;
    }
  }
  /// A bundle of the shared ones in which `file` is exchanged and its hash mended.
  [[nodiscard]] std::string bundle_with(const std::string& bundle, const fs::path& file,
                                        const std::string& name) const {
    const fs::path copy = folder_ / (file.filename().string() + ".bundle");
    fs::create_directories(copy);
    for (const auto& entry : fs::directory_iterator(damaged_ / bundle)) {
      std::ofstream(copy / entry.path().filename(), std::ios::binary)
          << core::read_file(entry.path());
    }
    std::string scene = core::read_file(copy / "scene.yaml");
    const std::string old_hash = core::sha256_of_file(copy / name);
    std::ofstream(copy / name, std::ios::binary) << core::read_file(file);
    scene.replace(scene.find(old_hash), old_hash.size(), core::sha256_of_file(copy / name));
    std::ofstream(copy / "scene.yaml") << scene;
    return copy.string();
  }
  fs::path damaged_;
};

TEST_F(DamagedFiles, Bundles) {
  EXPECT_EQ(try_out("scene inspect " + (damaged_ / "bundle-navmesh-segv").string()).exit_code,
            2);
  for (const char* part : {"bundle_navmesh", "navmesh-silent"}) {
    for (const fs::path& file : named(part)) {
      try_out("scene inspect " + bundle_with("bundle-navmesh-segv", file, "navmesh.bin"));
    }
  }
  const std::string out = " -o " + in("x.jsonl");
  EXPECT_EQ(try_out("episodes generate " + (damaged_ / "bundle-collision-rc3").string() + out)
                .exit_code,
            2);
  for (const fs::path& file : named("bundle_collision")) {
    const std::string bundle = bundle_with("bundle-collision-rc3", file, "collision.ply");
    EXPECT_EQ(try_out("episodes generate " + bundle + out).exit_code, 2) << file;
  }
  expect_all_refused("accept-episodes", "episodes validate",
                     (damaged_ / "bundle-collision-rc3").string());
}

TEST_F(DamagedFiles, Worlds) {
  const std::string small = " --frames 2 --width 32 --height 24 --out " + in("capture#");
  expect_all_refused("mesh_dae", "capture --mesh", small);
  expect_all_refused("poly.obj", "capture --mesh", small);
  expect_all_refused("sdf_world", "capture --world", small);
  expect_all_refused("trajectory-", "capture --flat 3 --trajectory", small);
  expect_all_refused("props.ply", "render --pose 0 0 1 0 0 --out " + in("x.png"));
}

TEST_F(DamagedFiles, WeightsAndViews) {
  expect_all_refused("shape.pt", "detector import", "--out " + in("x.weights"));
  const fs::path views = damaged_ / "truncated-jpeg-views" / "labels.json";
  expect_all_refused(".weights", "detector evaluate --on " + views.string() + " --weights");
  EXPECT_EQ(try_out("detector evaluate --on " + views.string() +
                    " --weights " SEGSIM_WEIGHTS "/source_rooms.weights")
                .exit_code,
            2);
}

TEST_F(DamagedFiles, Recordings) {
  const std::string recording = in("recording");
  ASSERT_EQ(
      run_limited("capture --flat 3 --frames 4 --width 64 --height 48 --out " + recording)
          .exit_code,
      0);
  for (const fs::path& file : named("boxes_json")) {
    try_out("reconstruct " + recording + " --init-only --out " + in("bundle") + " --boxes " +
            file.string());
    fs::remove_all(folder_ / "bundle");
  }
  for (const fs::path& file : named("nerf_json")) {
    const fs::path copy = folder_ / file.stem();
    fs::create_directories(copy);
    std::ofstream(copy / "transforms.json") << core::read_file(file);
    EXPECT_EQ(try_out("reconstruct --check " + copy.string()).exit_code, 2) << file;
  }
}

TEST_F(DamagedFiles, SpecsAndResults) {
  for (const char* part : {"spec_yaml", "accept-duplicate-key"}) {
    expect_all_refused(part, "run", "--work " + in("work#"));
  }
  for (const fs::path& file : named(".sqlite")) {
    const fs::path work = folder_ / file.stem();
    fs::create_directories(work);
    std::ofstream(work / "results.sqlite", std::ios::binary) << core::read_file(file);
    EXPECT_EQ(try_out("table " + work.string()).exit_code, 2) << file;
    EXPECT_EQ(try_out("report " + work.string() + " -o " + in("report")).exit_code, 2) << file;
  }
}

}  // namespace
}  // namespace segsim::tests
