#include "python/native/rasterizer/view_rasterizer.h"

#include <string>
#include <utility>

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include "core/check.h"
#ifdef SEGSIM_WITH_CUDA_TRAINING
#include "reconstruction/rasterizer/cuda/cuda_rasterizer.h"
#endif

namespace segsim::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;
using reconstruction::DifferentiableRasterizer;
using reconstruction::SurfelGradients;
using reconstruction::SurfelParameters;
using reconstruction::TrainingImages;

/// The elements of an array, which must be so many.
template <class Array>
auto* elements(const Array& array, std::size_t count, const char* name) {
  SEGSIM_CHECK(array.size() == count, std::string(name) + " of " +
                                          std::to_string(array.size()) + " numbers for " +
                                          std::to_string(count));
  return array.data();
}
template <class Array>
auto elements(const std::optional<Array>& array, std::size_t count, const char* name)
    -> decltype(array->data()) {
  return array ? elements(*array, count, name) : nullptr;
}

template <class Surfels>
auto parameters_of(const Surfels& surfels, int active_sh_degree) {
  const auto& [position_m, log_scale, rotation, opacity_logit, sh] = surfels;
  SurfelParameters<std::remove_const_t<typename Surfels::value_type::Scalar>> p;
  const std::size_t count = opacity_logit.size();
  const std::size_t coefficients = sh.ndim() == 3 ? sh.shape(1) : 0;
  int degree = 0;
  while (static_cast<std::size_t>((degree + 1) * (degree + 1)) < coefficients) ++degree;
  SEGSIM_CHECK(static_cast<std::size_t>((degree + 1) * (degree + 1)) == coefficients,
               std::to_string(coefficients) + " coefficients");
  p.count = static_cast<std::int64_t>(count);
  p.sh_degree = degree;
  p.active_sh_degree = active_sh_degree;
  p.position_m = elements(position_m, 3 * count, "position_m");
  p.log_scale = elements(log_scale, 2 * count, "log_scale");
  p.rotation = elements(rotation, 4 * count, "rotation");
  p.opacity_logit = opacity_logit.data();
  p.sh = elements(sh, 3 * coefficients * count, "sh");
  return p;
}

}  // namespace

template <class Real, class Device>
ViewRasterizer<Real, Device>::ViewRasterizer(
    std::unique_ptr<DifferentiableRasterizer<Real>> rasterizer)
    : rasterizer_(std::move(rasterizer)) {}

template <class Real, class Device>
void ViewRasterizer<Real, Device>::forward(const Surfels& surfels, int active_sh_degree,
                                           const Views& cameras, std::size_t view,
                                           const Images& images, const Output& max_weight) {
  SEGSIM_CHECK(view < cameras.T_world_camera.size(), "view " + std::to_string(view));
  const core::CameraIntrinsics& camera = cameras.intrinsics_of(view);
  const SurfelParameters<Real> parameters = parameters_of(surfels, active_sh_degree);
  const std::size_t area =
      static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px);
  TrainingImages<Real> drawn;
  drawn.width_px = camera.width_px, drawn.height_px = camera.height_px;
  drawn.rgb = elements(images[0], 3 * area, "rgb");
  drawn.depth_m = elements(images[1], area, "depth_m");
  drawn.alpha = elements(images[2], area, "alpha");
  drawn.normal = elements(images[3], 3 * area, "normal");
  drawn.median_m = elements(images[4], area, "median_m");
  drawn.distortion = elements(images[5], area, "distortion");
  Real* weights =
      elements(max_weight, static_cast<std::size_t>(parameters.count), "max_weight");

  const nb::gil_scoped_release released;
  const std::lock_guard lock(mutex_);
  width_px_ = 0;
  rasterizer_->forward(parameters, camera, cameras.T_world_camera[view], drawn, weights);
  width_px_ = camera.width_px, height_px_ = camera.height_px;
}

template <class Real, class Device>
void ViewRasterizer<Real, Device>::backward(const Surfels& surfels, int active_sh_degree,
                                            const Loss& loss, const Gradients& gradients,
                                            const std::optional<Output>& screen) {
  const SurfelParameters<Real> parameters = parameters_of(surfels, active_sh_degree);
  const auto count = static_cast<std::size_t>(parameters.count);
  SurfelGradients<Real> by_surfels;
  by_surfels.position_m = elements(gradients[0], 3 * count, "by position_m");
  by_surfels.log_scale = elements(gradients[1], 2 * count, "by log_scale");
  by_surfels.rotation = elements(gradients[2], 4 * count, "by rotation");
  by_surfels.opacity_logit = elements(gradients[3], count, "by opacity_logit");
  by_surfels.sh = elements(gradients[4], surfels[4].size(), "by sh");
  by_surfels.screen = elements(screen, count, "screen");

  const nb::gil_scoped_release released;
  const std::lock_guard lock(mutex_);
  const std::size_t area =
      static_cast<std::size_t>(width_px_) * static_cast<std::size_t>(height_px_);
  TrainingImages<const Real> by_images;
  by_images.width_px = width_px_, by_images.height_px = height_px_;
  by_images.rgb = elements(loss[0], 3 * area, "by rgb");
  by_images.depth_m = elements(loss[1], area, "by depth_m");
  by_images.alpha = elements(loss[2], area, "by alpha");
  by_images.normal = elements(loss[3], 3 * area, "by normal");
  by_images.distortion = elements(loss[4], area, "by distortion");
  rasterizer_->backward(parameters, by_images, by_surfels);
}

namespace {

/// @return  The class, for its constructor.
template <class Rasterizer>
nb::class_<Rasterizer> bind_rasterizer(nb::module_& module, const char* name) {
  nb::class_<Rasterizer> bound(module, name, "Draws and differentiates one view at a time.");
  bound.def("forward", &Rasterizer::forward, "surfels"_a.noconvert(), "active_sh_degree"_a,
            "cameras"_a, "view"_a, "images"_a.noconvert(), "max_weight"_a.noconvert());
  bound.def("backward", &Rasterizer::backward, "surfels"_a.noconvert(), "active_sh_degree"_a,
            "loss"_a.noconvert(), "gradients"_a.noconvert(), "screen"_a.noconvert().none());
  return bound;
}

template <class Real>
void bind_cpu(nb::module_& module, const char* name) {
  using Rasterizer = ViewRasterizer<Real, nb::device::cpu>;
  bind_rasterizer<Rasterizer>(module, name)
      .def(
          "__init__",
          [](Rasterizer* self, int threads) {
            new (self) Rasterizer(reconstruction::make_cpu_rasterizer<Real>({threads}));
          },
          "threads"_a);
}

}  // namespace

void bind_rasterizers(nb::module_& module) {
  nb::class_<Views>(module, "Cameras", "Cameras of one size, checked.")
      .def(
          "__init__",
          [](Views* self, nb::handle T_world_camera, nb::handle K,
             std::pair<int, int> size_px) {
            new (self) Views(views_of(T_world_camera, K, size_px));
          },
          "T_world_camera"_a, "K"_a, "size"_a)
      .def("__len__", [](const Views& views) { return views.T_world_camera.size(); })
      .def_ro("batch", &Views::batch);
  bind_cpu<float>(module, "CpuRasterizer32");
  bind_cpu<double>(module, "CpuRasterizer64");
#ifdef SEGSIM_WITH_CUDA_TRAINING
  using Rasterizer = ViewRasterizer<float, nb::device::cuda>;
  bind_rasterizer<Rasterizer>(module, "CudaRasterizer")
      .def(
          "__init__",
          [](Rasterizer* self, std::uintptr_t stream, bool deterministic) {
            new (self) Rasterizer(reconstruction::make_cuda_rasterizer(
                {reinterpret_cast<CUstream_st*>(stream), deterministic}));
          },
          "stream"_a, "deterministic"_a,
          "stream: a cudaStream_t as a number. The present device draws.");
#endif
}

}  // namespace segsim::python
