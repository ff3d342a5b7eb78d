// Every call that can fail fails once under the executable: writing, syncing, renaming,
// opening, mapping, large blocks of memory. README.md beside this file.
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/file_io.h"
#include "scale_out.h"
#include "segsim_process.h"
#include "tests/experiments/start_weights.h"
#include "tests/faults/preloaded.h"
#include "tests/temporary_folder.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;

/// SEGSIM_FAULTS_EVERY=1: every call; 5: every fifth one. Without it so many for each way to
/// fail.
std::uint64_t every() {
  const char* text = std::getenv("SEGSIM_FAULTS_EVERY");
  return text == nullptr ? 0 : std::strtoull(text, nullptr, 10);
}
constexpr std::uint64_t kSample = 1;

constexpr Fault kFaults[] = {
    kFullDisk,
    {"one failure", kDiskCalls, "EIO", false},
    {"no memory", "memory", "ENOMEM", false},
};

/// A command of `segsim` in a folder of its own.
struct Command {
  const char* name;
  /// The arguments; results lie below the folder.
  std::function<std::string(const fs::path& work)> arguments;
  /// What was made, once the command has succeeded.
  std::function<std::string(const fs::path& work, const std::string& said)> digest;
  /// What the folder has before the command is run.
  std::function<void(const fs::path& work)> prepare = [](const fs::path&) {};
  /// What it says if it ends with 1, because a part of its work has failed.
  std::string incomplete = {};
};

class EveryCall {
 public:
  EveryCall(const fs::path& folder, Command command)
      : folder_(folder / command.name), command_(std::move(command)) {
    fs::create_directories(folder_);
    (void)calls_of(kFullDisk);
  }

  void run() {
    for (const Fault& fault : kFaults) run(fault);
  }

 private:
  [[nodiscard]] fs::path empty_work() const {
    const fs::path work = folder_ / "work";
    fs::remove_all(work);
    fs::create_directories(work);
    command_.prepare(work);
    return work;
  }

  [[nodiscard]] ProcessOutput under(const Fault& fault, std::uint64_t at,
                                    const fs::path& work) const {
    return run_shell(with_fault(fault, at, work, folder_ / "report") + "timeout 120 " +
                     SEGSIM_BINARY + " " + command_.arguments(work));
  }

  void run(const Fault& fault) {
    std::map<int, int> codes;
    const std::uint64_t calls = calls_of(fault);
    if (calls == 0) {
      EXPECT_STREQ(fault.calls, "memory") << "nothing was counted: is the library loaded?";
      return;
    }
    if (every() > 0) {
      // Not up to that number: threads may change it.
      for (std::uint64_t at = 1; once(fault, at, codes); at += every()) {
      }
    } else {
      // Others for each way.
      const std::uint64_t way = static_cast<std::uint64_t>(&fault - kFaults);
      const std::uint64_t points = kSample * std::size(kFaults);
      for (std::uint64_t i = 0; i < kSample; ++i) {
        once(fault, 1 + (calls - 1) * (2 * (i * std::size(kFaults) + way) + 1) / (2 * points),
             codes);
      }
    }
    EXPECT_FALSE(codes.empty()) << command_.name << ", " << fault.name << ": no call failed";
    std::printf("%s, %s: %llu calls, exit codes", command_.name, fault.name,
                static_cast<unsigned long long>(calls));
    for (const auto& [code, count] : codes) std::printf(" %d: %d", code, count);
    for (const auto& [what, count] : harmless_) std::printf(", %s: %d", what.c_str(), count);
    std::printf("\n");
    harmless_.clear();
    std::fflush(stdout);
  }

  /// Of the undisturbed command, whose results are kept.
  std::uint64_t calls_of(const Fault& fault) {
    const auto known = calls_.find(fault.calls);
    if (known != calls_.end()) return known->second;
    const Report report(folder_ / "report");
    const fs::path work = empty_work();
    const ProcessOutput run = under(fault, 0, work);
    EXPECT_EQ(run.exit_code, 0) << run.text;
    if (run.exit_code == 0) digest_ = command_.digest(work, run.text);
    return calls_[fault.calls] = report.calls();
  }

  /// @return  Whether a call failed: else there are not so many.
  bool once(const Fault& fault, std::uint64_t at, std::map<int, int>& codes) {
    const fs::path work = empty_work();
    const Report report(folder_ / "report");
    const ProcessOutput run = under(fault, at, work);
    if (report.failures() == 0) return false;
    ++codes[run.exit_code];
    if (run.exit_code == 0) ++harmless_["done without " + report.what()];
    SCOPED_TRACE(std::string(command_.name) + ", " + fault.name + ", call " +
                 std::to_string(at) + ": " + report.what());
    expect_clear_end(run);
    if (run.exit_code == 0) {
      EXPECT_EQ(command_.digest(work, run.text), digest_) << run.text;
    }
    const ProcessOutput again = run_segsim(command_.arguments(work));
    EXPECT_EQ(again.exit_code, 0) << again.text << "\nafter:\n" << run.text;
    if (again.exit_code == 0) {
      EXPECT_EQ(command_.digest(work, again.text), digest_) << run.text;
    }
    return true;
  }

  /// A failure that does no harm may pass; what was made is compared in any case.
  void expect_clear_end(const ProcessOutput& run) const {
    const std::string last =
        run.text.substr(run.text.size() - std::min<std::size_t>(run.text.size(), 600));
    for (const char* word : {"internal error", "terminate called", "Sanitizer"}) {
      EXPECT_THAT(last, ::testing::Not(::testing::HasSubstr(word)));
    }
    if (run.exit_code == 0) return;
    if (run.exit_code == 1 && !command_.incomplete.empty()) {
      EXPECT_THAT(run.text, ::testing::HasSubstr(command_.incomplete));
      return;
    }
    EXPECT_EQ(run.exit_code, 2) << last;
    EXPECT_THAT(last, ::testing::HasSubstr("expected "));
  }

  fs::path folder_;
  Command command_;
  std::string digest_;
  std::map<std::string, std::uint64_t> calls_;
  std::map<std::string, int> harmless_;
};

std::string quoted(const fs::path& path) { return "'" + path.string() + "'"; }

class Faults : public testing::Test {
 protected:
  TemporaryFolder folder_{"faults"};
};

TEST_F(Faults, ARunGoesOn) {
  const ScaleOutFolder trials(2);
  EveryCall(
      folder_.path(),
      {.name = "run",
       .arguments =
           [&](const fs::path& work) {
             return trials.arguments((work / "out").string(), "--workers 1");
           },
       .digest = [](const fs::path&, const std::string& said) { return sha256_in(said); },
       .incomplete = "failed in the harness; run again to repeat them"})
      .run();
}

TEST_F(Faults, AMergeIsWholeOrNothing) {
  const ScaleOutFolder trials(2);
  for (const char* shard : {"0/2", "1/2"}) {
    ASSERT_EQ(trials.segsim("parts", std::string("--shard ") + shard).exit_code, 0);
  }
  EveryCall(
      folder_.path(),
      {.name = "merge",
       .arguments = [](const fs::path& work) { return "merge " + quoted(work / "parts"); },
       .digest = [](const fs::path&, const std::string& said) { return sha256_in(said); },
       .prepare =
           [&](const fs::path& work) {
             fs::copy(trials.path() / "parts", work / "parts", fs::copy_options::recursive);
           }})
      .run();
}

TEST_F(Faults, AReconstructionGoesOn) {
  const fs::path recording = folder_ / "recording";
  const ProcessOutput captured = run_segsim("capture --flat 3 --out " + quoted(recording) +
                                            " --frames 4 --width 48 --height 36");
  ASSERT_EQ(captured.exit_code, 0) << captured.text;
  EveryCall(folder_.path(),
            {.name = "reconstruct",
             .arguments =
                 [&](const fs::path& work) {
                   return "reconstruct " + quoted(recording) +
                          " --floor-height 0 --voxel 0.2 --iterations 3 --label-iterations 3"
                          " --threads 1 --resume --out " +
                          quoted(work / "bundle");
                 },
             .digest =
                 [](const fs::path& work, const std::string&) {
                   return core::sha256_of_file(work / "bundle" / "surfels.ply") +
                          core::sha256_of_file(work / "bundle" / "panoptic.bin");
                 }})
      .run();
}

TEST_F(Faults, AFineTuningGoesOn) {
  experiments::write_start_weights(folder_.path());
  EveryCall(folder_.path(),
            {.name = "finetune",
             .arguments =
                 [&](const fs::path& work) {
                   return "detector finetune --from " + quoted(folder_ / "start.weights") +
                          " --train " + quoted(folder_ / "far.json") + " --out " +
                          quoted(work / "after.weights") + " --steps 3 --batch 2 --threads 1";
                 },
             .digest =
                 [](const fs::path& work, const std::string&) {
                   return core::sha256_of_file(work / "after.weights");
                 }})
      .run();
}

}  // namespace
}  // namespace segsim::tests
