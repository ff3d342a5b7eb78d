#include "python/native/scene_renderer.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <variant>
#include <vector>

#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/variant.h>
#include <nanobind/stl/vector.h>

#include "core/check.h"
#include "core/error.h"
#include "python/native/camera_arguments.h"
#include "python/native/frame_arrays.h"
#include "renderer/renderer_backend.h"
#include "renderer/scene/render_options.h"

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

void check_range(const char* name, int value, int least, int most) {
  if (value >= least && value <= most) return;
  throw core::InputError::expected(name, std::to_string(least) + " to " + std::to_string(most),
                                   std::to_string(value));
}

renderer::Backend backend_of(const std::string& name) {
  if (name == "auto") return renderer::Backend::kAuto;
  if (name == "cpu") return renderer::Backend::kCpu;
  if (name == "cuda") return renderer::Backend::kCuda;
  throw core::InputError::expected("backend", "auto | cpu | cuda", "\"" + name + "\"");
}

renderer::Compat compat_of(const std::string& name) {
  if (name == "exact") return renderer::Compat::kExact;
  if (name == "inria") return renderer::Compat::kInria;
  if (name == "gsplat") return renderer::Compat::kGsplat;
  throw core::InputError::expected("compat", "exact | inria | gsplat", "\"" + name + "\"");
}

void check_features(const char* argument, core::Channels drawn,
                    const SceneRenderer& renderer) {
  if (core::has(drawn, core::Channels::kFeatures) && !renderer.has_features()) {
    throw core::InputError::expected(argument, "none of features, which the scene lacks",
                                     "semantic_feature or instance_feature");
  }
}

using Names = std::variant<std::string, std::vector<std::string>>;

ChannelChoice choice_of(const Names& channels, const SceneRenderer& renderer) {
  const auto* one = std::get_if<std::string>(&channels);
  ChannelChoice choice(one != nullptr ? std::vector{*one}
                                      : std::get<std::vector<std::string>>(channels));
  check_features("channels", choice.drawn(), renderer);
  return choice;
}

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

/// Lets Python run its handlers; that of Ctrl-C raises KeyboardInterrupt.
void handle_signals() {
  if (PyErr_CheckSignals() != 0) throw nb::python_error();
}

nb::dict render_one(SceneRenderer& renderer, const Views& views, const ChannelChoice& choice) {
  core::Frame frame;
  {
    const nb::gil_scoped_release released;
    renderer.draw(views.T_world_camera[0], views.intrinsics[0], choice.drawn(), frame);
  }
  return take_images(std::move(frame), choice);
}

nb::dict render_batch(SceneRenderer& renderer, const Views& views, std::pair<int, int> size_px,
                      const ChannelChoice& choice) {
  FrameBatch batch(choice, views.T_world_camera.size(), size_px.first, size_px.second);
  if (renderer.on_gpu() && !core::has(choice.drawn(), core::Channels::kDepthNormal)) {
    handle_signals();
    {
      const nb::gil_scoped_release released;
      renderer.draw_batch(views, choice.drawn(), batch.places());
    }
    return batch.take();
  }
  core::Frame frame;
  for (std::size_t i = 0; i < views.T_world_camera.size(); ++i) {
    handle_signals();
    const nb::gil_scoped_release released;
    renderer.draw(views.T_world_camera[i], views.intrinsics_of(i), choice.drawn(), frame);
    batch.put(i, frame);
  }
  return batch.take();
}

nb::dict render(SceneRenderer& renderer, nb::handle T_world_camera, nb::handle K,
                std::pair<int, int> size_px, const Names& channels) {
  const ChannelChoice choice = choice_of(channels, renderer);
  const Views views = views_of(T_world_camera, K, size_px);
  return views.batch ? render_batch(renderer, views, size_px, choice)
                     : render_one(renderer, views, choice);
}

void render_to(SceneRenderer& renderer, nb::handle T_world_camera, nb::handle K,
               std::pair<int, int> size_px, const nb::dict& images, std::uintptr_t stream) {
  if (!renderer.on_gpu()) {
    throw core::InputError::expected("render_to", "a renderer whose backend is cuda",
                                     "one that is cpu");
  }
  const Views views = views_of(T_world_camera, K, size_px);
  const GpuArrays places(images, views);
  check_features("images", places.drawn(), renderer);
  const nb::gil_scoped_release released;
  renderer.draw_to(views, places, reinterpret_cast<CUstream_st*>(stream));
}

nb::dict stats_of(const SceneRenderer& renderer) {
  const core::RenderStats stats = renderer.stats();
  nb::dict named;
  named["surfels_projected"] = stats.surfels_projected;
  named["pairs_binned"] = stats.pairs_binned;
  named["pairs_touched"] = stats.pairs_touched;
  named["evaluations"] = stats.evaluations;
  named["contributions"] = stats.contributions;
  named["render_ms"] = stats.render_ms;
  return named;
}

constexpr const char* kRenderSignature =
    "def render(self, T_world_camera: numpy.typing.ArrayLike, K: numpy.typing.ArrayLike, "
    "size: tuple[int, int], channels: str | collections.abc.Sequence[str] = ('rgb', 'depth')) "
    "-> dict[str, numpy.typing.NDArray[typing.Any]]";

constexpr const char* kRenderHelp = R"(Draw one view or several.

T_world_camera: pose of the camera, [4, 4] or [N, 4, 4]: p_world = T_world_camera @ p_camera.
    Metres. The camera is an optical one: x right, y down, z forward. (A view matrix, as
    gsplat and OpenCV have it, is its inverse.)
K: [3, 3], rows (fx, 0, cx), (0, fy, cy), (0, 0, 1), in pixels; or [N, 3, 3] with N poses.
    Pixel (i, j) has its centre at (i + 0.5, j + 0.5), so the middle of an image is at
    (width / 2, height / 2). Calibrations whose pixel centres are integers need + 0.5 on cx
    and cy.
size: (width, height) in pixels.
channels: one name or several.

Returns an array for each channel, H = height, W = width; of N poses with N as first axis.

    rgb                  uint8    [H, W, 3]   sRGB over black
    depth                float32  [H, W]      metres along the camera's z; NaN where alpha < 0.5
    normal               float32  [H, W, 3]   world frame, unit, towards the camera; 0 likewise
    alpha                float32  [H, W]      accumulated opacity, 0 to 1
    semantic             uint16   [H, W]      SceneClass.id; 0 is void, also where alpha < 0.5
    instance             uint16   [H, W]      SceneInstance.id; 0 is none
    confidence           float32  [H, W]      share of the Top-K weight that voted for the class
    instance_confidence  float32  [H, W]      the same for the instance
    depth_normal         float32  [H, W, 3]   normal of the depth image; 0 where unknown
    semantic_feature     float32  [H, W, 16]  mean over the Top-K; trained scenes
    instance_feature     float32  [H, W, 32]  the same

Arrays of one view own the memory that the renderer wrote: nothing is copied. Other Python
threads run meanwhile; calls of one renderer wait for one another. Ctrl-C ends a batch after
the image that is being drawn; on a GPU, which draws all at once, after the batch. Raises InputError, naming the argument.)";

constexpr const char* kRenderToSignature =
    "def render_to(self, T_world_camera: numpy.typing.ArrayLike, K: numpy.typing.ArrayLike, "
    "size: tuple[int, int], images: dict[str, typing.Any], stream: int = 0) -> None";

constexpr const char* kRenderToHelp =
    R"(Draw into arrays in the memory of the GPU, where backend is 'cuda'.

images: channel -> array of what DLPack exports (PyTorch, CuPy, JAX), with the type and shape
    that render() gives; contiguous, on the renderer's GPU. There is no depth_normal.
stream: the cudaStream_t as a number in whose order the arrays are written, for PyTorch
    torch.cuda.current_stream().cuda_stream. The call returns when the images are drawn; the
    copies to the arrays are then in the stream.

Several poses with one K are drawn 256 at a time. Raises InputError, naming the argument.)";

}  // namespace

SceneRenderer::SceneRenderer(const Scene& scene, const std::string& backend, int threads,
                             int top_k, const std::string& compat)
    : has_features_(scene.content.surfels->has_features()) {
  constexpr int kMostThreads = 1024;
  check_range("threads", threads, 0, kMostThreads);
  check_range("top_k", top_k, renderer::kAllSurfels, renderer::kMaxTopK);
  renderer::RenderOptions options;
  options.threads = threads;
  options.top_k = top_k;
  options.compat = compat_of(compat);
  const renderer::Backend wanted = backend_of(backend);
  renderer_ =
      renderer::make_renderer(wanted, scene.content.surfels, options, scene.content.labels,
                              [&](const std::string& reason) { fallback_reason_ = reason; });
  on_gpu_ = wanted != renderer::Backend::kCpu && fallback_reason_.empty();
}

void SceneRenderer::draw(const core::CameraPose& T_world_camera,
                         const core::CameraIntrinsics& intrinsics, core::Channels channels,
                         core::Frame& frame) {
  const std::lock_guard lock(mutex_);
  renderer_->render(T_world_camera, intrinsics, channels, frame);
  stats_ = frame.stats;
}

void SceneRenderer::draw_to(const Views& views, const GpuArrays& images, CUstream_st* stream) {
  const std::lock_guard lock(mutex_);
  renderer::CudaRenderer* gpu = renderer::as_cuda_renderer(*renderer_);
  SEGSIM_CHECK(gpu != nullptr, "not on the GPU");
  if (views.T_world_camera.empty()) return;
  const auto start = std::chrono::steady_clock::now();
  images.draw(*gpu, views, stream);
  stats_ = gpu->stats();
  stats_.render_ms = milliseconds_since(start);
}

void SceneRenderer::draw_batch(const Views& views, core::Channels drawn,
                               std::span<const ImagePlace> places) {
  const std::lock_guard lock(mutex_);
  renderer::CudaRenderer* gpu = renderer::as_cuda_renderer(*renderer_);
  SEGSIM_CHECK(gpu != nullptr, "not on the GPU");
  if (views.T_world_camera.empty()) return;
  const auto start = std::chrono::steady_clock::now();
  draw_into(*gpu, views, drawn, places, nullptr);
  stats_ = gpu->stats();
  stats_.render_ms = milliseconds_since(start);
}

core::RenderStats SceneRenderer::stats() const {
  const std::lock_guard lock(mutex_);
  return stats_;
}

void bind_renderer(nb::module_& module) {
  nb::class_<SceneRenderer>(module, "Renderer", "Draws the surfels of one scene.")
      .def(nb::init<const Scene&, const std::string&, int, int, const std::string&>(),
           "scene"_a, "backend"_a = "auto", "threads"_a = 0, "top_k"_a = 4,
           "compat"_a = "exact", nb::call_guard<nb::gil_scoped_release>(),
           "Sort and pack the scene.\n\n"
           "backend: 'cpu'; 'cuda'; or 'auto', the GPU if there is one and the package was "
           "built for it, else the CPU.\n"
           "threads: 0 for all processors, 1 for the calling thread alone. The image is the "
           "same.\n"
           "top_k: surfels that vote for a pixel's label, 1 to 24; 0 for all.\n"
           "compat: 'exact', or whose rules a scene was trained with: 'inria' "
           "(hbb1/diff-surfel-rasterization) or 'gsplat'.\n\n"
           "Raises InputError for another value, and with 'cuda' if there is no GPU.")
      .def("render", &render, "T_world_camera"_a, "K"_a, "size"_a,
           "channels"_a = std::vector<std::string>{"rgb", "depth"}, nb::sig(kRenderSignature),
           kRenderHelp)
      .def("render_to", &render_to, "T_world_camera"_a, "K"_a, "size"_a, "images"_a,
           "stream"_a = 0, nb::sig(kRenderToSignature), kRenderToHelp)
      .def_prop_ro("backend", &SceneRenderer::backend, "'cpu' or 'cuda': what draws.")
      .def_prop_ro("fallback_reason", &SceneRenderer::fallback_reason,
                   "Why 'auto' draws on the CPU; empty if it does not.")
      .def_prop_ro(
          "stats", &stats_of, nb::sig("def stats(self) -> dict[str, float]"),
          "Work done for the image that was drawn last, or on a GPU for those that were "
          "drawn together last, at most 256: surfels_projected, pairs_binned, "
          "pairs_touched, evaluations, contributions; and render_ms (wall time of the "
          "call, milliseconds).");
}

}  // namespace segsim::python
