// Runs that are disturbed for as long as one likes: workers are killed, stopped and find the
// disk full, shards are merged meanwhile, and a server shows them all the time.
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scale_out.h"
#include "segsim_process.h"
#include "tests/experiments/raw_http.h"
#include "tests/faults/preloaded.h"
#include "tests/system/gazebo_processes.h"

namespace segsim::tests {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr int kTrials = 60, kWorkers = 2, kDisturbances = 6;
/// A disk that is full from one of so many calls on: most workers make more.
constexpr std::uint32_t kCalls = 400;

/// Hours; without SEGSIM_SOAK_H one round.
double soak_h() {
  const char* text = std::getenv("SEGSIM_SOAK_H");
  return text == nullptr ? 0.0 : std::atof(text);
}

/// `segsim serve` on a folder of runs.
class Server {
 public:
  explicit Server(const fs::path& runs)
      : process_(
            {"/bin/sh", "-c",
             "exec " + std::string(SEGSIM_BINARY) + " serve '" + runs.string() + "' --port 0"},
            "", runs.string() + ".log") {
    EXPECT_TRUE(process_.says("http://127.0.0.1:", 60.0)) << process_.output();
    const std::string said = process_.output(), address = "http://127.0.0.1:";
    port_ = std::atoi(said.c_str() + said.find(address) + address.size());
  }
  /// What a page with a list of runs asks for. A run may be removed meanwhile.
  void look() {
    const experiments::Answer all = get("/api/runs");
    ASSERT_EQ(all.status, 200) << process_.output();
    for (const auto& run : all.json()["runs"]) {
      const std::string place = "/api/runs/" + run["key"].get<std::string>();
      for (const std::string& page : {place, place + "/trials"}) {
        const int status = get(page).status;
        EXPECT_TRUE(status == 200 || status == 404) << page << ": " << status;
      }
    }
  }
  double resident_mb() { return process_.resident_mb(); }
  int stop() { return process_.stop(SIGINT); }

 private:
  [[nodiscard]] experiments::Answer get(const std::string& path) const {
    return experiments::send_raw(port_, experiments::request_head("GET", path, ""));
  }

  Process process_;
  int port_ = 0;
};

/// One run in parts, until it is done in spite of all.
class DisturbedRun {
 public:
  DisturbedRun(const ScaleOutFolder& folder, std::string work, std::mt19937& random,
               std::map<std::string, int>& tally)
      : folder_(folder),
        work_(std::move(work)),
        random_(random),
        tally_(tally),
        workers_(kWorkers) {}

  void run(Server& server) {
    for (std::size_t k = 0; k < workers_.size(); ++k) begin(k);
    int left = kDisturbances;
    while (alive() > 0) {
      std::this_thread::sleep_for(std::chrono::milliseconds(500 + random_() % 1500));
      if (left-- > 0) disturb();
      server.look();
      for (std::size_t k = 0; k < workers_.size(); ++k) go_on(k, left > 0);
    }
  }

 private:
  struct Worker {
    std::unique_ptr<Process> process;
    bool full_disk = false, done = false;
  };

  void begin(std::size_t k, bool full_disk = false) {
    const std::string name = std::to_string(k);
    std::vector<std::string> command =
        folder_.command(work_, "--shard " + name + "/" + std::to_string(kWorkers));
    if (full_disk) {
      reports_.push_back(std::make_unique<Report>(folder_.path() / ("report" + name)));
      command[2].insert(std::string("exec ").size(),
                        with_fault(kFullDisk, 1 + random_() % kCalls, folder_.path() / work_,
                                   folder_.path() / ("report" + name)));
      ++tally_["full disks"];
    }
    workers_[k].full_disk = full_disk;
    workers_[k].process =
        std::make_unique<Process>(command, "", folder_.path() / ("log" + name));
  }

  int alive() {
    int count = 0;
    for (const Worker& worker : workers_) count += worker.done ? 0 : 1;
    return count;
  }

  void disturb() {
    Worker& worker = workers_[random_() % workers_.size()];
    switch (random_() % 3) {
      case 0:
        if (!worker.process->running()) break;  // Its number may be somebody else's.
        ++tally_["kills"];
        worker.process->send(SIGKILL);
        break;
      case 1:
        if (!worker.process->running()) break;
        ++tally_["stops"];
        worker.process->send(SIGTERM);
        break;
      default: {
        // Before there is anything to merge it says so.
        const ProcessOutput merged = run_segsim("merge " + folder_.quoted(work_));
        EXPECT_TRUE(merged.exit_code == 0 || merged.exit_code == 2) << merged.text;
        ++tally_["merges"];
      }
    }
  }

  /// A worker that has ended begins anew until its part is done.
  void go_on(std::size_t k, bool may_be_full) {
    Worker& worker = workers_[k];
    if (worker.done || worker.process->running()) return;
    const int code = worker.process->wait(0.0);
    worker.done = code == 0;
    if (worker.done) return;
    const bool known = code == 128 + SIGKILL || code == 4 || code == 128 + SIGTERM ||
                       (worker.full_disk && (code == 2 || code == 1));
    EXPECT_TRUE(known) << "exit code " << code << ": " << worker.process->output();
    begin(k, may_be_full && random_() % 2 == 0);
  }

  const ScaleOutFolder& folder_;
  std::string work_;
  std::mt19937& random_;
  std::map<std::string, int>& tally_;
  std::vector<Worker> workers_;
  std::vector<std::unique_ptr<Report>> reports_;
};

TEST(Soak, DisturbedRunsMakeTheSameAndTheServerDoesNotGrow) {
  const ScaleOutFolder folder(kTrials);
  const ProcessOutput whole = folder.segsim("whole", "--workers 2");
  ASSERT_EQ(whole.exit_code, 0) << whole.text;
  fs::create_directories(folder.path() / "rounds");
  Server server(folder.path() / "rounds");
  std::mt19937 random(20260101);
  std::map<std::string, int> tally;
  std::vector<double> resident_mb;
  const auto end = Clock::now() + std::chrono::duration<double>(3600.0 * soak_h());
  do {
    const std::string work = "rounds/" + std::to_string(++tally["rounds"]);
    DisturbedRun(folder, work, random, tally).run(server);
    const ProcessOutput merged = run_segsim("merge " + folder.quoted(work));
    ASSERT_EQ(merged.exit_code, 0) << merged.text;
    EXPECT_EQ(sha256_in(merged.text), sha256_in(whole.text)) << merged.text;
    EXPECT_EQ(folder.table(work), folder.table("whole"));
    EXPECT_EQ(integrity_of(folder.path() / work / "results.sqlite"), "ok");
    server.look();
    resident_mb.push_back(server.resident_mb());
    fs::remove_all(folder.path() / work);
  } while (Clock::now() < end && !HasFailure());
  for (const auto& [what, count] : tally) std::printf("%d %s, ", count, what.c_str());
  std::printf("server %.0f MB after the first round, %.0f MB in the end\n",
              resident_mb.front(), resident_mb.back());
  EXPECT_LT(resident_mb.back(), 1.1 * resident_mb.front() + 16.0);
  EXPECT_EQ(server.stop(), 0);
}

}  // namespace
}  // namespace segsim::tests
