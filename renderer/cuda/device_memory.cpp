#include "renderer/cuda/device_memory.h"

#include <string>

#include "renderer/cuda/gpu_error.h"

namespace segsim::renderer::cuda {
namespace {

std::string version_text(int version) {
  return std::to_string(version / 1000) + "." + std::to_string(version % 1000 / 10);
}

std::string driver_text() {
  int driver = 0, runtime = 0;
  cudaDriverGetVersion(&driver);
  cudaRuntimeGetVersion(&runtime);
  return "a driver for CUDA " + version_text(runtime) + " or newer, found " +
         (driver == 0 ? "none" : "one for CUDA " + version_text(driver));
}

std::string memory_text() {
  std::size_t free_bytes = 0, total_bytes = 0;
  if (cudaMemGetInfo(&free_bytes, &total_bytes) != cudaSuccess) return "memory full";
  return std::to_string(free_bytes >> 20U) + " of " + std::to_string(total_bytes >> 20U) +
         " MiB free; smaller images, batches or scenes need less";
}

}  // namespace

void throw_on_error(cudaError_t status, const char* call) {
  if (status == cudaSuccess) return;
  cudaGetLastError();  // So that the next call does not report this one.
  const std::string place = std::string("GPU: ") + call + ": ";
  switch (status) {
    case cudaErrorNoDevice:
      throw GpuError(place + "expected a CUDA device, found none");
    case cudaErrorInsufficientDriver:
    case cudaErrorCompatNotSupportedOnDevice:
    case cudaErrorUnsupportedPtxVersion:
      throw GpuError(place + "expected " + driver_text());
    case cudaErrorMemoryAllocation:
      throw GpuError(place + "expected room for the scene and its images, found " +
                     memory_text());
    case cudaErrorNoKernelImageForDevice:
      throw GpuError(
          place + "expected a device of compute capability 8.0 or above, found an older one");
    case cudaErrorDevicesUnavailable:
    case cudaErrorDeviceUninitialized:
    case cudaErrorSystemNotReady:
    case cudaErrorECCUncorrectable:
    case cudaErrorIllegalAddress:
    case cudaErrorLaunchFailure:
    case cudaErrorHardwareStackError:
    case cudaErrorUnknown:
      throw GpuError(place + "expected a working device, found it lost (" +
                     cudaGetErrorString(status) + "); the process must be started anew");
    default:
      throw GpuError(place + cudaGetErrorString(status));
  }
}

void check_device() {
  int count = 0;
  throw_on_error(cudaGetDeviceCount(&count), "cudaGetDeviceCount");
  if (count == 0) throw GpuError("GPU: expected a CUDA device, found none");
  int device = 0, major = 0;
  throw_on_error(cudaGetDevice(&device), "cudaGetDevice");
  throw_on_error(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, device),
                 "cudaDeviceGetAttribute");
  if (major < 8) {
    throw GpuError("GPU: expected compute capability 8.0 or above, found " +
                   std::to_string(major) + ".x");
  }
}

int resident_blocks(const void* kernel, int threads, std::size_t shared_bytes) {
  int device = 0, processors = 0, blocks = 0;
  throw_on_error(cudaGetDevice(&device), "cudaGetDevice");
  throw_on_error(cudaDeviceGetAttribute(&processors, cudaDevAttrMultiProcessorCount, device),
                 "cudaDeviceGetAttribute");
  throw_on_error(
      cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, kernel, threads, shared_bytes),
      "cudaOccupancyMaxActiveBlocksPerMultiprocessor");
  return processors * blocks;
}

}  // namespace segsim::renderer::cuda
