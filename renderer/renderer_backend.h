#pragma once

/// @file
/// Chooses between the CPU and the GPU renderer.

#include <functional>
#include <memory>
#include <string>

#include "core/render.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

class CudaRenderer;

enum class Backend : unsigned char {
  kAuto,  ///< The GPU if it can do what is asked, else the CPU.
  kCpu,
  kCuda,
};

/// @param name  "auto", "cpu" or "cuda".
/// @throws core::InputError for another word.
[[nodiscard]] Backend backend_of(const std::string& name);

[[nodiscard]] const char* backend_name(Backend backend);

/// @param field  As for make_cpu_renderer().
/// @param warn  Called once if kAuto falls back to the CPU, with the reason; may be empty.
/// @throws core::InputError if kCuda was asked for and there is no GPU, its driver is too old,
///     its memory is full, or an option is one that it lacks; core::ContractViolation for a
///     scene or option out of range.
[[nodiscard]] std::unique_ptr<core::Renderer> make_renderer(
    Backend backend, std::shared_ptr<const SurfelCloud> surfels, RenderOptions options = {},
    std::shared_ptr<const PanopticField> field = nullptr,
    const std::function<void(const std::string&)>& warn = {});

/// The GPU's renderer that this is; null where it is another one.
[[nodiscard]] CudaRenderer* as_cuda_renderer(core::Renderer& renderer);

/// Draws a view and waits for it. A GPU's images stay on the device, and `frame` as it is: to
/// measure drawing alone.
void draw_in_place(core::Renderer& renderer, const core::CameraPose& T_world_camera,
                   const core::CameraIntrinsics& intrinsics, core::Channels channels,
                   core::Frame& frame);

}  // namespace segsim::renderer
