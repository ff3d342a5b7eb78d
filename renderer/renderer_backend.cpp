#include "renderer/renderer_backend.h"

#include "core/error.h"
#include "renderer/cpu_renderer.h"
#include "renderer/cuda/gpu_error.h"
#ifdef SEGSIM_WITH_CUDA
#include "renderer/cuda/cuda_renderer.h"
#endif

namespace segsim::renderer {
namespace {

std::unique_ptr<core::Renderer> make_gpu(
    [[maybe_unused]] const std::shared_ptr<const SurfelCloud>& surfels,
    [[maybe_unused]] const RenderOptions& options,
    [[maybe_unused]] const std::shared_ptr<const PanopticField>& field) {
#ifdef SEGSIM_WITH_CUDA
  return make_cuda_renderer(surfels, options, field);
#else
  throw GpuError("GPU: expected a build with SEGSIM_CUDA=ON, found one without");
#endif
}

}  // namespace

Backend backend_of(const std::string& name) {
  if (name == "auto") return Backend::kAuto;
  if (name == "cpu") return Backend::kCpu;
  if (name == "cuda") return Backend::kCuda;
  throw core::InputError::expected("--backend", "auto | cpu | cuda", "\"" + name + "\"");
}

const char* backend_name(Backend backend) {
  switch (backend) {
    case Backend::kAuto:
      return "auto";
    case Backend::kCpu:
      return "cpu";
    case Backend::kCuda:
      return "cuda";
  }
  return "?";
}

std::unique_ptr<core::Renderer> make_renderer(
    Backend backend, std::shared_ptr<const SurfelCloud> surfels, RenderOptions options,
    std::shared_ptr<const PanopticField> field,
    const std::function<void(const std::string&)>& warn) {
  if (backend != Backend::kCpu) {
    try {
      return make_gpu(surfels, options, field);
    } catch (const GpuError& error) {
      if (backend == Backend::kCuda) throw;
      if (warn) warn(std::string("rendering on the CPU: ") + error.what());
    }
  }
  return make_cpu_renderer(std::move(surfels), options, std::move(field));
}

CudaRenderer* as_cuda_renderer([[maybe_unused]] core::Renderer& renderer) {
#ifdef SEGSIM_WITH_CUDA
  return dynamic_cast<CudaRenderer*>(&renderer);
#else
  return nullptr;
#endif
}

void draw_in_place(core::Renderer& renderer, const core::CameraPose& T_world_camera,
                   const core::CameraIntrinsics& intrinsics, core::Channels channels,
                   core::Frame& frame) {
#ifdef SEGSIM_WITH_CUDA
  if (CudaRenderer* gpu = as_cuda_renderer(renderer)) {
    gpu->render_batch({&T_world_camera, 1}, intrinsics, channels);
    gpu->wait();
    return;
  }
#endif
  renderer.render(T_world_camera, intrinsics, channels, frame);
}

}  // namespace segsim::renderer
