#pragma once

/// @file
/// Owners of GPU memory and of the CUDA objects that a renderer holds, and the one place where
/// the runtime's error codes become exceptions.

#include <cstddef>
#include <span>
#include <utility>

#include <cuda_runtime_api.h>

namespace segsim::renderer::cuda {

/// @throws core::InputError that names the call, and for the common causes (no memory, no
///     device, old driver, lost device) what to do about it.
void throw_on_error(cudaError_t status, const char* call);

/// @throws GpuError if there is no device that our kernels run on.
void check_device();

/// Blocks of a kernel that the present device holds at once.
/// @param shared_bytes  Asked for at launch.
[[nodiscard]] int resident_blocks(const void* kernel, int threads,
                                  std::size_t shared_bytes = 0);

/// Uninitialised elements in device memory; it only grows.
template <class T>
class DeviceArray {
 public:
  DeviceArray() = default;
  explicit DeviceArray(std::size_t count) { reserve(count); }
  explicit DeviceArray(std::span<const T> values) {
    reserve(values.size());
    if (values.empty()) return;
    throw_on_error(
        cudaMemcpy(data_, values.data(), values.size_bytes(), cudaMemcpyHostToDevice),
        "cudaMemcpy");
  }
  ~DeviceArray() { cudaFree(data_); }
  DeviceArray(DeviceArray&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), count_(std::exchange(other.count_, 0)) {}
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(count_, other.count_);
    return *this;
  }

  /// Contents are lost if it grows. @return  Whether the address changed.
  bool reserve(std::size_t count) {
    if (count <= count_) return false;
    cudaFree(std::exchange(data_, nullptr));
    count_ = 0;
    throw_on_error(cudaMalloc(reinterpret_cast<void**>(&data_), count * sizeof(T)),
                   "cudaMalloc");
    count_ = count;
    return true;
  }

  [[nodiscard]] T* data() const { return data_; }
  [[nodiscard]] std::size_t size() const { return count_; }
  [[nodiscard]] std::size_t bytes() const { return count_ * sizeof(T); }

 private:
  T* data_ = nullptr;
  std::size_t count_ = 0;
};

/// Page-locked host memory, which the device reads and writes while the host works on.
template <class T>
class PinnedArray {
 public:
  PinnedArray() = default;
  ~PinnedArray() { cudaFreeHost(data_); }
  PinnedArray(const PinnedArray&) = delete;
  PinnedArray& operator=(const PinnedArray&) = delete;

  bool reserve(std::size_t count) {
    if (count <= count_) return false;
    cudaFreeHost(std::exchange(data_, nullptr));
    count_ = 0;
    throw_on_error(cudaMallocHost(reinterpret_cast<void**>(&data_), count * sizeof(T)),
                   "cudaMallocHost");
    count_ = count;
    return true;
  }

  [[nodiscard]] T* data() const { return data_; }
  [[nodiscard]] std::size_t size() const { return count_; }

 private:
  T* data_ = nullptr;
  std::size_t count_ = 0;
};

class Stream {
 public:
  Stream() {
    throw_on_error(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking),
                   "cudaStreamCreate");
  }
  ~Stream() { cudaStreamDestroy(stream_); }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;
  [[nodiscard]] cudaStream_t get() const { return stream_; }

 private:
  cudaStream_t stream_ = nullptr;
};

class Event {
 public:
  Event() { throw_on_error(cudaEventCreate(&event_), "cudaEventCreate"); }
  ~Event() { cudaEventDestroy(event_); }
  Event(const Event&) = delete;
  Event& operator=(const Event&) = delete;
  [[nodiscard]] cudaEvent_t get() const { return event_; }

 private:
  cudaEvent_t event_ = nullptr;
};

/// A recorded sequence of launches.
class Graph {
 public:
  Graph() = default;
  ~Graph() { reset(); }
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;

  [[nodiscard]] bool empty() const { return exec_ == nullptr; }
  void reset() {
    if (exec_ != nullptr) cudaGraphExecDestroy(std::exchange(exec_, nullptr));
  }
  /// Records what `enqueue` puts into the stream.
  template <class Enqueue>
  void record(cudaStream_t stream, const Enqueue& enqueue) {
    reset();
    throw_on_error(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal),
                   "cudaStreamBeginCapture");
    enqueue();
    cudaGraph_t graph = nullptr;
    throw_on_error(cudaStreamEndCapture(stream, &graph), "cudaStreamEndCapture");
    const cudaError_t status = cudaGraphInstantiate(&exec_, graph, 0);
    cudaGraphDestroy(graph);
    throw_on_error(status, "cudaGraphInstantiate");
  }
  void launch(cudaStream_t stream) const {
    throw_on_error(cudaGraphLaunch(exec_, stream), "cudaGraphLaunch");
  }

 private:
  cudaGraphExec_t exec_ = nullptr;
};

}  // namespace segsim::renderer::cuda
