#include "renderer/files/frame_writer.h"

#include <chrono>
#include <cstdio>
#include <utility>

#include "core/check.h"

namespace segsim::renderer {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

WriteFrame write_function(FrameWriterOptions& options) {
  if (options.write) return std::move(options.write);
  return
      [exr = options.exr](const std::filesystem::path& file, const core::Frame& frame,
                          const FrameInfo& info) { write_frame_exr(file, frame, info, exr); };
}

}  // namespace

FrameWriter::FrameWriter(FrameWriterOptions options) : write_(write_function(options)) {
  SEGSIM_CHECK(options.queue_frames >= 1, "queue_frames");
  for (int i = 0; i < options.queue_frames; ++i) free_.push_back(std::make_unique<Job>());
  thread_ = std::thread([this] { run(); });
}

FrameWriter::~FrameWriter() {
  stop();
  if (error_ == nullptr || reported_) return;
  try {
    std::rethrow_exception(error_);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "segsim: a frame was not written: %s\n", error.what());
  } catch (...) {
    std::fprintf(stderr, "segsim: a frame was not written\n");
  }
}

void FrameWriter::push(std::filesystem::path file, const core::Frame& frame, FrameInfo info) {
  std::unique_ptr<Job> job = take_free_job();
  try {
    job->frame = frame;
  } catch (...) {  // No memory: the queue keeps its length.
    recycle(std::move(job));
    throw;
  }
  job->file = std::move(file);
  job->info = std::move(info);
  enqueue(std::move(job));
}

void FrameWriter::push(std::filesystem::path file, core::Frame&& frame, FrameInfo info) {
  std::unique_ptr<Job> job = take_free_job();
  std::swap(job->frame, frame);
  job->file = std::move(file);
  job->info = std::move(info);
  enqueue(std::move(job));
}

void FrameWriter::close() {
  stop();
  if (error_ == nullptr) return;
  reported_ = true;
  std::rethrow_exception(error_);
}

FrameWriterStats FrameWriter::stats() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return stats_;
}

std::unique_ptr<FrameWriter::Job> FrameWriter::take_free_job() {
  std::unique_lock<std::mutex> lock(mutex_);
  SEGSIM_CHECK(!closing_, "the frame writer is closed");
  if (free_.empty() && error_ == nullptr) {
    const Clock::time_point start = Clock::now();
    changed_.wait(lock, [&] { return !free_.empty() || error_ != nullptr; });
    stats_.blocked_s += seconds_since(start);
  }
  if (error_ != nullptr) {
    reported_ = true;
    std::rethrow_exception(error_);
  }
  std::unique_ptr<Job> job = std::move(free_.back());
  free_.pop_back();
  return job;
}

void FrameWriter::enqueue(std::unique_ptr<Job> job) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    queue_.push_back(std::move(job));
  }
  changed_.notify_all();
}

void FrameWriter::recycle(std::unique_ptr<Job> job) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    free_.push_back(std::move(job));
  }
  changed_.notify_all();
}

/// The thread: writes until it is told to stop and nothing waits.
void FrameWriter::run() {
  while (true) {
    std::unique_ptr<Job> job;
    {
      std::unique_lock<std::mutex> lock(mutex_);
      changed_.wait(lock, [&] { return !queue_.empty() || closing_; });
      if (queue_.empty()) return;
      job = std::move(queue_.front());
      queue_.pop_front();
      if (error_ != nullptr) {  // Reported by push() or close(); this frame goes with it.
        free_.push_back(std::move(job));
        continue;
      }
    }
    const Clock::time_point start = Clock::now();
    std::exception_ptr error;
    try {
      write_(job->file, job->frame, job->info);
    } catch (...) {
      error = std::current_exception();
    }
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      stats_.write_s += seconds_since(start);
      stats_.frames_written += error == nullptr ? 1 : 0;
      error_ = std::move(error);  // Nothing is written after the first.
      free_.push_back(std::move(job));
    }
    changed_.notify_all();
  }
}

/// Ends the thread. From then on the members are the caller's.
void FrameWriter::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

std::string sequence_file_name(int number) {
  SEGSIM_CHECK(number >= 0, "frame number");
  char name[32];
  std::snprintf(name, sizeof name, "frame-%06d.exr", number);
  return name;
}

}  // namespace segsim::renderer
