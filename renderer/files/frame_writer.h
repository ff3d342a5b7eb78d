#pragma once

/// @file
/// Writes frames to files on a thread of its own, so that a control loop pays for a copy only.
///
///     push() -> [queue of at most queue_frames] -> one thread -> write_frame_exr()
///
/// No frame is ever dropped in silence: push() waits while the queue is full. The first error
/// ends the writing; every later push() and close() reports it. Files appear in the order of
/// the pushes, each in one step.

#include <condition_variable>
#include <deque>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/render.h"
#include "renderer/files/exr_io.h"

namespace segsim::renderer {

/// Called by the writing thread, one frame at a time.
using WriteFrame =
    std::function<void(const std::filesystem::path&, const core::Frame&, const FrameInfo&)>;

struct FrameWriterOptions {
  /// Frames that wait or are being written, >= 1; each keeps its memory for the next.
  int queue_frames = 4;
  ExrOptions exr;
  WriteFrame write;  ///< Empty: write_frame_exr().
};

struct FrameWriterStats {
  int frames_written = 0;
  double write_s = 0.0;    ///< Wall time that the thread spent writing.
  double blocked_s = 0.0;  ///< Wall time that callers waited for room.
};

/// Any number of threads may push; one of them closes when the others have finished.
class FrameWriter {
 public:
  explicit FrameWriter(FrameWriterOptions options = {});
  /// Writes what was pushed. Throws nothing: an error that no call has reported goes to
  /// standard error.
  ~FrameWriter();
  FrameWriter(const FrameWriter&) = delete;
  FrameWriter& operator=(const FrameWriter&) = delete;

  /// Copies the frame into recycled memory; waits while the queue is full.
  /// @throws what an earlier frame's writing threw. This frame is then not written.
  /// @throws core::ContractViolation after close().
  void push(std::filesystem::path file, const core::Frame& frame, FrameInfo info = {});
  /// Swaps instead: afterwards `frame` holds an old frame's memory to render into.
  void push(std::filesystem::path file, core::Frame&& frame, FrameInfo info = {});

  /// Waits until all frames are on disk. May be called again.
  /// @throws what the first failed frame's writing threw; frames behind it are not written.
  void close();

  [[nodiscard]] FrameWriterStats stats() const;

 private:
  struct Job {
    std::filesystem::path file;
    core::Frame frame;
    FrameInfo info;
  };

  [[nodiscard]] std::unique_ptr<Job> take_free_job();
  void enqueue(std::unique_ptr<Job> job);
  void recycle(std::unique_ptr<Job> job);
  void run();
  void stop();

  const WriteFrame write_;
  mutable std::mutex mutex_;  // Guards what follows.
  std::condition_variable changed_;
  std::vector<std::unique_ptr<Job>> free_;
  std::deque<std::unique_ptr<Job>> queue_;
  FrameWriterStats stats_;
  std::exception_ptr error_;
  bool reported_ = false;  // The error has reached a caller.
  bool closing_ = false;
  std::thread thread_;  // Last: starts when the rest is there.
};

/// "frame-000123.exr", for one folder per sequence. @param number  >= 0.
[[nodiscard]] std::string sequence_file_name(int number);

}  // namespace segsim::renderer
