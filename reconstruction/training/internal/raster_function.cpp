#include "reconstruction/training/internal/raster_function.h"

#include <cmath>
#include <string>
#include <utility>

#include <ATen/core/ivalue.h>

#include "core/check.h"

namespace segsim::reconstruction::internal {

/// What backward() needs beside tensors.
struct RasterCall : torch::CustomClassHolder {
  RasterFunction* function = nullptr;
  std::int64_t view = 0;  ///< views_ when it was drawn.
  int active_sh_degree = 0;
  int width_px = 0, height_px = 0;
  Tensor screen;
  torch::autograd::variable_list images;  ///< Handed to autograd by forward(), then gone.

  [[nodiscard]] DifferentiableRasterizer<float>& rasterizer() const {
    SEGSIM_CHECK(function->views_ == view, "another view was drawn before backward()");
    return function->rasterizer();
  }
};

namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

const float* pointer(const Tensor& tensor) {
  return tensor.defined() ? tensor.data_ptr<float>() : nullptr;
}

/// [height, width] with further dimensions.
Tensor image_like(const Tensor& like, std::vector<std::int64_t> shape) {
  return torch::empty(shape, like.options().requires_grad(false));
}

struct Rasterize : torch::autograd::Function<Rasterize> {
  static variable_list forward(AutogradContext* context, const Tensor& position_m,
                               const Tensor& log_scale, const Tensor& rotation,
                               const Tensor& opacity_logit, const Tensor& sh,
                               const c10::intrusive_ptr<RasterCall>& call) {
    context->save_for_backward({position_m, log_scale, rotation, opacity_logit, sh});
    context->saved_data["call"] = c10::IValue::make_capsule(call);
    return std::exchange(call->images, {});
  }

  static variable_list backward(AutogradContext* context, const variable_list& by_images) {
    const auto capsule = context->saved_data["call"].toCapsule();
    auto* call = dynamic_cast<RasterCall*>(capsule.get());
    SEGSIM_CHECK(call != nullptr, "not a call of the rasterizer");
    const variable_list saved = context->get_saved_variables();
    const SurfelTensors surfels{saved[0], saved[1], saved[2], saved[3], saved[4]};
    const SurfelParameters<float> parameters = parameters_of(surfels, call->active_sh_degree);

    variable_list loss;
    for (const Tensor& gradient : by_images) {
      loss.push_back(gradient.defined() ? gradient.contiguous() : Tensor());
    }
    TrainingImages<const float> by;
    by.width_px = call->width_px;
    by.height_px = call->height_px;
    by.rgb = pointer(loss[0]);
    by.depth_m = pointer(loss[1]);
    by.alpha = pointer(loss[2]);
    by.normal = pointer(loss[3]);
    by.distortion = loss.size() > 4 ? pointer(loss[4]) : nullptr;

    variable_list out;
    for (const Tensor& tensor : saved) out.push_back(torch::empty_like(tensor));
    SurfelGradients<float> gradients;
    gradients.position_m = out[0].data_ptr<float>();
    gradients.log_scale = out[1].data_ptr<float>();
    gradients.rotation = out[2].data_ptr<float>();
    gradients.opacity_logit = out[3].data_ptr<float>();
    gradients.sh = out[4].data_ptr<float>();
    gradients.screen = call->screen.data_ptr<float>();
    call->rasterizer().backward(parameters, by, gradients);
    out.emplace_back();  // None for the call.
    return out;
  }
};

}  // namespace

SurfelParameters<float> parameters_of(const SurfelTensors& s, int active_sh_degree) {
  SurfelParameters<float> p;
  p.count = s.position_m.size(0);
  const std::int64_t coefficients = s.sh.dim() == 3 ? s.sh.size(1) : 0;
  p.sh_degree =
      static_cast<int>(std::lround(std::sqrt(static_cast<double>(coefficients)))) - 1;
  p.active_sh_degree = active_sh_degree;
  const auto has = [&](const Tensor& tensor, std::int64_t values) {
    return tensor.scalar_type() == torch::kFloat32 && tensor.is_contiguous() &&
           tensor.numel() == p.count * values;
  };
  SEGSIM_CHECK(has(s.position_m, 3) && has(s.log_scale, 2) && has(s.rotation, 4) &&
                   has(s.opacity_logit, 1) && has(s.sh, 3 * coefficients) &&
                   (p.sh_degree + 1) * (p.sh_degree + 1) == coefficients,
               "surfel tensors of different counts, types or layouts");
  p.position_m = s.position_m.data_ptr<float>();
  p.log_scale = s.log_scale.data_ptr<float>();
  p.rotation = s.rotation.data_ptr<float>();
  p.opacity_logit = s.opacity_logit.data_ptr<float>();
  p.sh = s.sh.data_ptr<float>();
  return p;
}

RasterFunction::RasterFunction(std::unique_ptr<DifferentiableRasterizer<float>> rasterizer,
                               const at::Device& device)
    : rasterizer_(std::move(rasterizer)), device_(device) {
  SEGSIM_CHECK(rasterizer_ != nullptr, "no rasterizer");
}

ViewTensors RasterFunction::draw(const SurfelTensors& surfels, int active_sh_degree,
                                 const core::CameraIntrinsics& camera,
                                 const core::CameraPose& T_world_camera,
                                 bool with_distortion) {
  const SurfelParameters<float> parameters = parameters_of(surfels, active_sh_degree);
  const std::int64_t w = camera.width_px, h = camera.height_px;
  const Tensor& like = surfels.position_m;
  ViewTensors view;
  view.rgb = image_like(like, {h, w, 3});
  view.depth_m = image_like(like, {h, w});
  view.alpha = image_like(like, {h, w});
  view.normal = image_like(like, {h, w, 3});
  view.median_m = image_like(like, {h, w});
  if (with_distortion) view.distortion = image_like(like, {h, w});
  view.max_weight = image_like(like, {parameters.count});
  view.screen = torch::zeros({parameters.count}, view.max_weight.options());

  TrainingImages<float> images;
  images.width_px = camera.width_px;
  images.height_px = camera.height_px;
  images.rgb = view.rgb.data_ptr<float>();
  images.depth_m = view.depth_m.data_ptr<float>();
  images.alpha = view.alpha.data_ptr<float>();
  images.normal = view.normal.data_ptr<float>();
  images.median_m = view.median_m.data_ptr<float>();
  if (with_distortion) images.distortion = view.distortion.data_ptr<float>();
  rasterizer_->forward(parameters, camera, T_world_camera, images,
                       view.max_weight.data_ptr<float>());

  auto call = c10::make_intrusive<RasterCall>();
  call->function = this;
  call->view = ++views_;
  call->active_sh_degree = active_sh_degree;
  call->width_px = camera.width_px;
  call->height_px = camera.height_px;
  call->screen = view.screen;
  call->images = {view.rgb, view.depth_m, view.alpha, view.normal};
  if (with_distortion) call->images.push_back(view.distortion);
  const variable_list outputs =
      Rasterize::apply(surfels.position_m, surfels.log_scale, surfels.rotation,
                       surfels.opacity_logit, surfels.sh, call);
  view.rgb = outputs[0];
  view.depth_m = outputs[1];
  view.alpha = outputs[2];
  view.normal = outputs[3];
  if (with_distortion) view.distortion = outputs[4];
  return view;
}

}  // namespace segsim::reconstruction::internal
