#include "renderer/files/frame_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <latch>
#include <set>
#include <thread>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "tests/renderer/files/recorded_frames.h"

namespace segsim::renderer {
namespace {

using renderer::testing::full_frame;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

core::Frame small_frame(float alpha) {
  core::Frame frame;
  frame.intrinsics = {4, 3, 5.0, 5.0, 2.0, 1.5};
  frame.alpha = core::Image<float>(4, 3, alpha);
  return frame;
}

/// Stands for write_frame_exr(): keeps what it is given, and can be held up or made to fail.
class Recorder {
 public:
  FrameWriterOptions options(int queue_frames) {
    FrameWriterOptions options;
    options.queue_frames = queue_frames;
    options.write = [this](const fs::path& file, const core::Frame& frame, const FrameInfo&) {
      started.count_down();
      gate.wait();
      if (file == failing)
        throw core::InputError(file.string() + ": expected room, found none");
      files.push_back(file.string());
      alphas.push_back(frame.alpha(0, 0));
    };
    return options;
  }

  std::latch started{1};  ///< Opens when the first frame is being written.
  std::latch gate{1};     ///< Holds every write until it opens.
  fs::path failing;
  // The writing thread's until close().
  std::vector<std::string> files;
  std::vector<float> alphas;
};

TEST(FrameWriter, FilesAreTheSameAsWithoutAThread) {
  const fs::path folder = fs::path(::testing::TempDir()) / "frame_writer";
  fs::remove_all(folder);
  FrameInfo info;
  info.scene = "flat";
  FrameWriter writer;
  for (int i = 0; i < 12; ++i) {
    core::Frame frame = full_frame();
    frame.alpha(0, 0) = 0.01F * static_cast<float>(i);
    info.time_ns = i;
    writer.push(folder / sequence_file_name(i), frame, info);
    write_frame_exr(folder / "expected" / sequence_file_name(i), frame, info);
  }
  writer.close();
  EXPECT_EQ(writer.stats().frames_written, 12);
  for (int i = 0; i < 12; ++i) {
    EXPECT_EQ(core::read_file(folder / sequence_file_name(i)),
              core::read_file(folder / "expected" / sequence_file_name(i)))
        << i;
  }
  // 12 files and the folder: no temporary file is left.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 13);
  fs::remove_all(folder);
}

TEST(FrameWriter, PushWaitsWhileTheQueueIsFullAndNothingIsLost) {
  Recorder recorder;
  FrameWriter writer(recorder.options(3));
  for (int i = 0; i < 3; ++i) {
    writer.push(std::to_string(i), small_frame(static_cast<float>(i)));
  }
  recorder.started.wait();  // One is being written, two wait: full.
  std::future<void> fourth =
      std::async(std::launch::async, [&] { writer.push("3", small_frame(3.0F)); });
  EXPECT_EQ(fourth.wait_for(std::chrono::milliseconds(60)), std::future_status::timeout);
  recorder.gate.count_down();
  fourth.get();
  writer.close();
  EXPECT_THAT(recorder.files, ElementsAre("0", "1", "2", "3"));
  EXPECT_THAT(recorder.alphas, ElementsAre(0.0F, 1.0F, 2.0F, 3.0F));
  EXPECT_GT(writer.stats().blocked_s, 0.03);
}

TEST(FrameWriter, TheCallersFrameIsItsOwnAgainAfterPush) {
  Recorder recorder;
  FrameWriter writer(recorder.options(2));
  core::Frame frame = small_frame(0.25F);
  writer.push("copied", frame);
  frame.alpha(0, 0) = 0.5F;
  writer.push("swapped", std::move(frame));
  frame.alpha = core::Image<float>(4, 3, 0.75F);
  recorder.gate.count_down();
  writer.close();
  EXPECT_THAT(recorder.alphas, ElementsAre(0.25F, 0.5F));
}

TEST(FrameWriter, MemoryIsRecycled) {
  Recorder recorder;
  recorder.gate.count_down();
  std::set<const float*> addresses;
  FrameWriterOptions options;
  options.queue_frames = 2;
  options.write = [&](const fs::path&, const core::Frame& frame, const FrameInfo&) {
    addresses.insert(frame.alpha.data());
  };
  FrameWriter writer(options);
  const core::Frame frame = small_frame(1.0F);
  for (int i = 0; i < 50; ++i) writer.push("x", frame);
  writer.close();
  EXPECT_LE(addresses.size(), 2U);
}

TEST(FrameWriter, AnErrorSurfacesAtTheNextPushAndAtClose) {
  Recorder recorder;
  recorder.failing = "1";
  FrameWriter writer(recorder.options(4));
  for (int i = 0; i < 4; ++i) writer.push(std::to_string(i), small_frame(0.0F));
  recorder.gate.count_down();
  // The queue was full, so this push comes after the failure or is queued behind it.
  const auto push = [&] { writer.push("4", small_frame(0.0F)); };
  bool thrown = false;
  for (int i = 0; i < 1000 && !thrown; ++i) {
    try {
      push();
    } catch (const core::InputError& error) {
      thrown = true;
      EXPECT_THAT(error.what(), HasSubstr("1: expected room"));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(thrown);
  EXPECT_THROW(push(), core::InputError);
  EXPECT_THROW(writer.close(), core::InputError);
  EXPECT_THROW(writer.close(), core::InputError);
  EXPECT_THAT(recorder.files, ElementsAre("0"));  // Nothing after the failure.
  EXPECT_EQ(writer.stats().frames_written, 1);
}

TEST(FrameWriter, AWaitingPushIsFreedByAnError) {
  Recorder recorder;
  recorder.failing = "0";
  FrameWriter writer(recorder.options(1));
  writer.push("0", small_frame(0.0F));
  recorder.started.wait();
  std::future<void> second =
      std::async(std::launch::async, [&] { writer.push("1", small_frame(0.0F)); });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  recorder.gate.count_down();
  EXPECT_THROW(second.get(), core::InputError);
  EXPECT_THROW(writer.close(), core::InputError);
}

TEST(FrameWriter, TheDestructorWritesTheRestAndOnlyPrintsErrors) {
  Recorder recorder;
  recorder.failing = "2";
  ::testing::internal::CaptureStderr();
  {
    FrameWriter writer(recorder.options(3));
    for (int i = 0; i < 3; ++i) writer.push(std::to_string(i), small_frame(0.0F));
    recorder.gate.count_down();
  }
  EXPECT_THAT(::testing::internal::GetCapturedStderr(), HasSubstr("2: expected room"));
  EXPECT_THAT(recorder.files, ElementsAre("0", "1"));

  ::testing::internal::CaptureStderr();
  { const FrameWriter idle; }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

TEST(FrameWriter, AReportedErrorIsNotPrintedAgain) {
  Recorder recorder;
  recorder.failing = "0";
  recorder.gate.count_down();
  ::testing::internal::CaptureStderr();
  {
    FrameWriter writer(recorder.options(1));
    writer.push("0", small_frame(0.0F));
    EXPECT_THROW(writer.close(), core::InputError);
  }
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

TEST(FrameWriter, ClosedIsClosed) {
  FrameWriter writer;
  writer.close();
  writer.close();
  EXPECT_THROW(writer.push("x", small_frame(0.0F)), core::ContractViolation);
  FrameWriterOptions no_queue;
  no_queue.queue_frames = 0;
  EXPECT_THROW(FrameWriter{no_queue}, core::ContractViolation);
}

TEST(FrameWriter, ManyThreadsMayPush) {
  std::atomic<int> written{0};
  FrameWriterOptions options;
  options.queue_frames = 3;
  options.write = [&](const fs::path&, const core::Frame& frame, const FrameInfo& info) {
    // A frame that is torn between two pushes would not fit its own time.
    EXPECT_EQ(static_cast<float>(*info.time_ns), frame.alpha(3, 2));
    ++written;
  };
  FrameWriter writer(options);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&writer, t] {
      for (int i = 0; i < 200; ++i) {
        FrameInfo info;
        info.time_ns = 1000 * t + i;
        writer.push("x", small_frame(static_cast<float>(*info.time_ns)), info);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  writer.close();
  EXPECT_EQ(written, 800);
}

TEST(FrameWriter, SequenceNamesSortLikeNumbers) {
  EXPECT_EQ(sequence_file_name(0), "frame-000000.exr");
  EXPECT_EQ(sequence_file_name(123), "frame-000123.exr");
  EXPECT_LT(sequence_file_name(999), sequence_file_name(1000));
  EXPECT_THROW((void)sequence_file_name(-1), core::ContractViolation);
}

}  // namespace
}  // namespace segsim::renderer
