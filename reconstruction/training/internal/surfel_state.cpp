#include "reconstruction/training/internal/surfel_state.h"

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

Tensor tensor_of(const std::vector<float>& values, std::vector<std::int64_t> shape,
                 const at::Device& device) {
  return device_tensor(values, torch::kFloat32, device).view(shape);
}

Tensor leaf(const Tensor& value) { return value.detach().requires_grad_(true); }

std::vector<float> host_rows(const Tensor& values, std::int64_t count) {
  const Tensor rows = values.narrow(0, values.size(0) - count, count).cpu().contiguous();
  const auto* first = rows.data_ptr<float>();
  return {first, first + rows.numel()};
}

}  // namespace

SurfelState::SurfelState(const renderer::SurfelCloud& surfels, int sh_degree,
                         const at::Device& device)
    : sh_degree_(sh_degree) {
  const RawSurfels raw = raw_surfels(surfels, sh_degree);
  const std::int64_t coefficients = (sh_degree + 1) * (sh_degree + 1);
  position_ = AdamTensor(tensor_of(raw.position_m, {-1, 3}, device));
  log_scale_ = AdamTensor(tensor_of(raw.log_scale, {-1, 2}, device));
  rotation_ = AdamTensor(tensor_of(raw.rotation, {-1, 4}, device));
  opacity_ = AdamTensor(tensor_of(raw.opacity_logit, {-1}, device));
  const Tensor sh = tensor_of(raw.sh, {raw.count(), coefficients, 3}, device);
  color_ = AdamTensor(sh.narrow(1, 0, 1).clone());
  rest_ = AdamTensor(sh.narrow(1, 1, coefficients - 1).clone());
  assemble_sh();
}

void SurfelState::assemble_sh() { sh_ = at::cat({color_.value(), rest_.value()}, 1); }

SurfelTensors SurfelState::leaves() const {
  return {leaf(position_.value()), leaf(log_scale_.value()), leaf(rotation_.value()),
          leaf(opacity_.value()), leaf(sh_)};
}

void SurfelState::step(const SurfelTensors& leaves, const Tensor& rows, int active_sh_degree,
                       const SurfelRates& rates) {
  const at::NoGradGuard no_grad;
  const auto of = [&](const Tensor& tensor) { return tensor.grad().index_select(0, rows); };
  position_.step_rows(rows, of(leaves.position_m), rates.position);
  log_scale_.step_rows(rows, of(leaves.log_scale), rates.log_scale);
  rotation_.step_rows(rows, of(leaves.rotation), rates.rotation);
  opacity_.step_rows(rows, of(leaves.opacity_logit), rates.opacity);
  const Tensor by_sh = of(leaves.sh);
  color_.step_rows(rows, by_sh.narrow(1, 0, 1), rates.color);
  sh_.narrow(1, 0, 1).index_copy_(0, rows, color_.value().index_select(0, rows));
  if (active_sh_degree == 0) return;
  const std::int64_t rest = sh_.size(1) - 1;
  rest_.step_rows(rows, by_sh.narrow(1, 1, rest), rates.color_rest);
  sh_.narrow(1, 1, rest).index_copy_(0, rows, rest_.value().index_select(0, rows));
}

void SurfelState::select(const Tensor& rows) {
  for (AdamTensor* tensor :
       {&position_, &log_scale_, &rotation_, &opacity_, &color_, &rest_}) {
    tensor->select(rows);
  }
  sh_ = sh_.index_select(0, rows);
}

void SurfelState::append(const RawSurfels& added) {
  SEGSIM_CHECK(added.sh_degree == sh_degree_, "surfels of another SH degree");
  const at::Device device = sh_.device();
  position_.append(tensor_of(added.position_m, {-1, 3}, device));
  log_scale_.append(tensor_of(added.log_scale, {-1, 2}, device));
  rotation_.append(tensor_of(added.rotation, {-1, 4}, device));
  opacity_.append(tensor_of(added.opacity_logit, {-1}, device));
  const Tensor sh = tensor_of(added.sh, {added.count(), sh_.size(1), 3}, device);
  color_.append(sh.narrow(1, 0, 1).contiguous());
  rest_.append(sh.narrow(1, 1, sh_.size(1) - 1).contiguous());
  assemble_sh();
}

void SurfelState::set_tail_shape(const std::vector<float>& position_m,
                                 const std::vector<float>& log_scale) {
  const auto put = [](const Tensor& value, const Tensor& tail) {
    Tensor target = value.narrow(0, value.size(0) - tail.size(0), tail.size(0));
    target.copy_(tail);
  };
  put(position_.value(), tensor_of(position_m, {-1, 3}, torch::kCPU));
  put(log_scale_.value(), tensor_of(log_scale, {-1, 2}, torch::kCPU));
}

RawSurfels SurfelState::tail(std::int64_t count) const {
  RawSurfels raw;
  raw.sh_degree = sh_degree_;
  raw.position_m = host_rows(position_.value(), count);
  raw.log_scale = host_rows(log_scale_.value(), count);
  raw.rotation = host_rows(rotation_.value(), count);
  raw.opacity_logit = host_rows(opacity_.value(), count);
  raw.sh = host_rows(sh_, count);
  return raw;
}

void SurfelState::save(StateWriter& out) const {
  position_.save(out, "position");
  log_scale_.save(out, "log_scale");
  rotation_.save(out, "rotation");
  opacity_.save(out, "opacity");
  color_.save(out, "color");
  rest_.save(out, "rest");
}

void SurfelState::load(const StateReader& in) {
  position_.load(in, "position");
  const std::int64_t rows = count();
  for (const char* name : {"log_scale", "rotation", "opacity", "color", "rest"}) {
    in.expect_rows(name, rows);
  }
  log_scale_.load(in, "log_scale");
  rotation_.load(in, "rotation");
  opacity_.load(in, "opacity");
  color_.load(in, "color");
  rest_.load(in, "rest");
  assemble_sh();
}

}  // namespace segsim::reconstruction::internal
