#include "experiments/support/stop_signal.h"

#include <csignal>
#include <functional>
#include <string>
#include <thread>

#include <gtest/gtest.h>

#include "core/interrupted.h"
#include "experiments/support/folder_lock.h"
#include "experiments/support/task_graph.h"
#include "tests/temporary_folder.h"

namespace segsim::experiments::support {
namespace {

/// What work was stopped with; "" if it ended.
std::string stopped(const std::function<void()>& work) {
  try {
    work();
  } catch (const core::Interrupted& error) {
    return error.what();
  }
  return {};
}

TEST(StopSignal, BothSignalsAskForTheSameEnd) {
  for (const int signal : {SIGINT, SIGTERM}) {
    const StopOnSignal signals;
    EXPECT_EQ(stopped([] { StopOnSignal::check(); }), "");
    std::raise(signal);
    EXPECT_TRUE(StopOnSignal::requested());
    EXPECT_EQ(stopped([] { StopOnSignal::check("a file is kept"); }),
              "stopped by a signal; a file is kept");
  }
  EXPECT_FALSE(StopOnSignal::requested()) << "nobody listens any more";
}

TEST(StopSignal, NoTaskBeginsAfterwards) {
  for (const int at_once : {1, 2}) {
    const StopOnSignal signals;
    TaskGraph graph;
    bool first = false, second = false;
    const TaskGraph::Id id = graph.add([&] {
      first = true;
      StopOnSignal::request();
    });
    graph.add([&] { second = true; }, {id});
    EXPECT_NE(stopped([&] { graph.run(at_once); }), "");
    EXPECT_TRUE(first);
    EXPECT_FALSE(second);
  }
}

TEST(StopSignal, WorkThatHasEndedIsNotStopped) {
  const StopOnSignal signals;
  TaskGraph graph;
  graph.add([] { StopOnSignal::request(); });
  EXPECT_EQ(stopped([&] { graph.run(2); }), "");
}

TEST(StopSignal, WaitingForAFolderEnds) {
  const tests::TemporaryFolder folder("stop_signal");
  const FolderLock holder(folder.path(), FolderLock::Kind::kExclusive,
                          FolderLock::IfTaken::kRefuse);
  const StopOnSignal signals;
  std::jthread later([] {
    std::this_thread::sleep_for(std::chrono::milliseconds(150));
    std::raise(SIGTERM);
  });
  EXPECT_NE(stopped([&] {
              const FolderLock waiter(folder.path(), FolderLock::Kind::kShared,
                                      FolderLock::IfTaken::kWait);
            }),
            "");
}

}  // namespace
}  // namespace segsim::experiments::support
