// The extension module fastsegsim._rasterizer, what of fastsegsim.differentiable is C++.
#include <nanobind/nanobind.h>

#include "python/native/rasterizer/view_rasterizer.h"
#include "renderer/scene/render_options.h"

NB_MODULE(_rasterizer, module) {
  using namespace segsim;
  module.doc() = "What of fastsegsim.differentiable is C++.";
  // InputError comes to Python by what _native registers, which the package always loads
  // first.
  module.attr("near_m") = static_cast<double>(renderer::RenderOptions{}.near_m);
#ifdef SEGSIM_WITH_CUDA_TRAINING
  module.attr("has_cuda") = true;
#else
  module.attr("has_cuda") = false;
#endif
  python::bind_rasterizers(module);
}
