// A run done by several processes: killed, stopped, out of disk, and put together again.
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include "scale_out.h"
#include "segsim_process.h"
#include "tests/system/gazebo_processes.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using Clock = std::chrono::steady_clock;

/// Seconds for which workers are killed; SEGSIM_KILL_S=120 is the long version.
double kill_s() {
  const char* text = std::getenv("SEGSIM_KILL_S");
  return text == nullptr ? 4.0 : std::atof(text);
}

/// One process per shard, begun again whenever it was killed.
class Workers {
 public:
  Workers(const ScaleOutFolder& folder, const std::string& work, int count)
      : folder_(folder), work_(work), processes_(static_cast<std::size_t>(count)) {
    for (std::size_t k = 0; k < processes_.size(); ++k) begin(k);
  }
  /// @return  Whether there was one to kill.
  bool kill_one(std::mt19937& random) {
    std::vector<std::size_t> alive;
    for (std::size_t k = 0; k < processes_.size(); ++k) {
      if (processes_[k]->running()) alive.push_back(k);
    }
    if (alive.empty()) return false;
    const std::size_t victim = alive[random() % alive.size()];
    processes_[victim]->send(SIGKILL);
    // It may have ended by itself just before.
    if (processes_[victim]->wait(60.0) == 128 + SIGKILL) begin(victim);
    return true;
  }
  /// The exit codes of all, in the end.
  std::vector<int> wait() {
    std::vector<int> codes;
    for (const auto& process : processes_) codes.push_back(process->wait(600.0));
    return codes;
  }

 private:
  void begin(std::size_t k) {
    const std::string shard = std::to_string(k) + "/" + std::to_string(processes_.size());
    processes_[k] = std::make_unique<Process>(folder_.command(work_, "--shard " + shard), "",
                                              folder_.path() / ("log" + std::to_string(k)));
  }

  const ScaleOutFolder& folder_;
  std::string work_;
  std::vector<std::unique_ptr<Process>> processes_;
};

/// The chains over all ticks of all trials are the same as in the undisturbed run.
TEST(ScaleOut, KilledWorkersLoseAndDoubleNothing) {
  const double patience_s = kill_s();
  const int trials = static_cast<int>(32 + 10 * patience_s);
  const ScaleOutFolder folder(trials);
  const ProcessOutput whole = folder.segsim("whole", "--workers 2");
  ASSERT_EQ(whole.exit_code, 0) << whole.text;

  Workers workers(folder, "parts", 3);
  std::mt19937 random(20260101);
  int kills = 0;
  const auto end = Clock::now() + std::chrono::duration<double>(patience_s);
  while (Clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::seconds(1));
    if (!workers.kill_one(random)) break;
    ++kills;
  }
  EXPECT_EQ(workers.wait(), (std::vector<int>{0, 0, 0}));
  std::printf("%d kills, %d trials\n", kills, folder.trials());
  EXPECT_GE(kills, 2);

  const ProcessOutput merged = run_segsim("merge " + folder.quoted("parts"));
  ASSERT_EQ(merged.exit_code, 0) << merged.text;
  EXPECT_THAT(merged.text, HasSubstr(std::to_string(folder.trials()) + " of " +
                                     std::to_string(folder.trials()) + " trials are done"));
  EXPECT_EQ(sha256_in(merged.text), sha256_in(whole.text));
  EXPECT_EQ(folder.table("parts"), folder.table("whole"));
  for (const char* store :
       {"parts", "parts/shards/0-of-3", "parts/shards/1-of-3", "parts/shards/2-of-3"}) {
    EXPECT_EQ(integrity_of(folder.path() / store / "results.sqlite"), "ok") << store;
  }
  // Again: nothing to do.
  EXPECT_THAT(run_segsim("merge " + folder.quoted("parts")).text,
              HasSubstr(" 0 trials added"));
}

/// Workers with nothing prepared: one prepares, the others wait for it.
TEST(ScaleOut, WorkersStartTogetherOnAnEmptyFolder) {
  const ScaleOutFolder folder(8);
  ASSERT_EQ(folder.segsim("whole").exit_code, 0);
  Workers workers(folder, "together", 3);
  EXPECT_EQ(workers.wait(), (std::vector<int>{0, 0, 0}));
  const ProcessOutput merged = run_segsim("merge " + folder.quoted("together"));
  EXPECT_EQ(sha256_in(merged.text), sha256_in(folder.segsim("whole").text)) << merged.text;
}

TEST(ScaleOut, AStoppedWorkerSaysSoAndGoesOn) {
  const ScaleOutFolder folder(200);
  ASSERT_EQ(folder.segsim("work", "--prepare-only").exit_code, 0);
  Process worker(folder.command("work", "--shard 1/2"), "", folder.path() / "log");
  const fs::path store = folder.path() / "work/shards/1-of-2/results.sqlite";
  const auto end = Clock::now() + std::chrono::seconds(120);
  while (trials_in(store) < 2 && worker.running() && Clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  EXPECT_EQ(worker.stop(SIGTERM), 4) << worker.output();
  EXPECT_THAT(worker.output(), HasSubstr("trials left"));
  EXPECT_THAT(worker.output(), HasSubstr("Shard 1/2"));
  // It keeps what was done, and a part of few more trials ends well.
  const ProcessOutput more = folder.segsim("work", "--shard 1/2 --max-trials 2");
  EXPECT_EQ(more.exit_code, 0) << more.text;
  EXPECT_THAT(more.text, HasSubstr("Shard 1/2: 2 trials run"));
}

/// What is in stays in, the message says what is missing, and the same command goes on.
TEST(ScaleOut, AFullDiskEndsTheWorkerAndLosesNothing) {
  const ScaleOutFolder folder(60);
  const ProcessOutput whole = folder.segsim("whole", "--workers 2");
  ASSERT_EQ(folder.segsim("full", "--shard 0/1 --max-trials 2").exit_code, 0);
  const fs::path store = folder.path() / "full/shards/0-of-1/results.sqlite";
  // No file may be larger than so many blocks: the database's log soon is.
  for (const char* limit : {"ulimit -f 400; ", "ulimit -f 16; "}) {
    const ProcessOutput full = folder.segsim("full", "--shard 0/1", limit);
    EXPECT_EQ(full.exit_code, 2) << full.text;
    EXPECT_THAT(full.text, HasSubstr(store.string() + ": expected "));
    EXPECT_EQ(integrity_of(store), "ok");
  }
  const ProcessOutput rest = folder.segsim("full", "--shard 0/1");
  EXPECT_EQ(rest.exit_code, 0) << rest.text;
  EXPECT_THAT(rest.text, HasSubstr(" trials run, 0 left"));
  const double run = number_before(rest.text, "trials run");
  EXPECT_GT(run, 0.0);
  EXPECT_LT(run, folder.trials() - 2.0)
      << "nothing was kept of what ran before the disk was full";
  EXPECT_EQ(sha256_in(rest.text), sha256_in(whole.text));
}

TEST(ScaleOut, BadShardsAreRefused) {
  const ScaleOutFolder folder(2);
  expect_input_error(folder.segsim("bad", "--shard 2/2"), "--shard 2/2");
  expect_input_error(folder.segsim("bad", "--shard x"), "--shard");
  EXPECT_EQ(folder.segsim("bad", "--shard 0/2 --new").exit_code, 2);
  expect_input_error(run_segsim("merge " + folder.quoted("bad")), "shards");
  ASSERT_EQ(folder.segsim("bad", "--shard 0/2").exit_code, 0);
  // Inputs that were made for another spec.
  folder.change_spec();
  const ProcessOutput changed = folder.segsim("bad", "--shard 1/2");
  expect_input_error(changed, "prepared.step");
  EXPECT_THAT(changed.text, HasSubstr("--prepare-only"));
}

}  // namespace
}  // namespace segsim::tests
