#include "reconstruction/training/geometry_training.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "core/check.h"
#include "core/error.h"
#include "core/random.h"
#include "reconstruction/training/densify.h"
#include "reconstruction/training/internal/geometry_losses.h"
#include "reconstruction/training/internal/surfel_state.h"
#include "reconstruction/training/internal/training_poses.h"
#include "reconstruction/training/internal/view_loss.h"

namespace segsim::reconstruction {
namespace {

using internal::SurfelTensors;
using internal::Tensor;
using internal::ViewTensors;

constexpr double kHoleVoxel_m = 0.02;
constexpr double kFinalPoseRate = 0.01;  ///< Of the first, exponential between.
constexpr float kNeeded = 1.0F;          ///< Stands for a weight that is not known yet.

std::int64_t at_share(double share, std::int64_t iterations) {
  return static_cast<std::int64_t>(std::llround(share * static_cast<double>(iterations)));
}

std::vector<float> host(const Tensor& tensor) {
  const Tensor values = tensor.cpu().contiguous();
  const auto* first = values.data_ptr<float>();
  return {first, first + values.numel()};
}

std::vector<core::CameraPose> recorded_poses(const TrainingSet& set) {
  std::vector<core::CameraPose> poses;
  for (const TrainingView& view : set.training) poses.push_back(view.T_world_camera);
  return poses;
}

}  // namespace

class GeometryTrainer::Impl {
 public:
  Impl(const TrainingSet& set, const renderer::SurfelCloud& start,
       const GeometryConfig& config, std::uint64_t seed, const GeometryDevice& device)
      : set_(set),
        config_(config),
        seed_(seed),
        extent_m_(set.extent_m()),
        raster_(make_training_rasterizer(device),
                trains_on_gpu(device) ? at::Device(torch::kCUDA, 0) : at::Device(torch::kCPU)),
        state_(start, config.sh_degree, raster_.device()),
        rays_(internal::camera_rays(set.intrinsics, raster_.device())),
        poses_(recorded_poses(set)),
        holes_(kHoleVoxel_m, config.sh_degree) {
    SEGSIM_CHECK(!set.training.empty(), "no training views");
    forget_statistics();
    const auto views = static_cast<std::int64_t>(set.training.size());
    exposure_ = internal::AdamTensor(
        torch::zeros({views, 2, 3}, torch::TensorOptions().device(raster_.device())));
  }

  [[nodiscard]] std::int64_t iteration() const { return iteration_; }
  [[nodiscard]] renderer::SurfelCloud surfels() const {
    return surfel_cloud(state_.tail(state_.count()));
  }
  [[nodiscard]] const std::vector<core::CameraPose>& poses() const { return poses_.now(); }
  [[nodiscard]] std::vector<Exposure> exposures() const;

  GeometryStep step();
  [[nodiscard]] PixelWeights draw(std::size_t view, std::span<const std::int32_t> pixels);
  void step_with(std::span<const std::int32_t> pixels, const PixelWeights& weights,
                 const GeometryGradient& labels, const JointConfig& config);
  [[nodiscard]] std::vector<glm::vec3> positions_m() const {
    const std::vector<float> values = host(state_.leaves().position_m.detach());
    std::vector<glm::vec3> positions_m(values.size() / 3);
    for (std::size_t i = 0; i < positions_m.size(); ++i) {
      positions_m[i] = {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
    }
    return positions_m;
  }
  void save(const std::filesystem::path& file, const std::string& identity) const;
  void load(const std::filesystem::path& file, const std::string& identity);

 private:
  [[nodiscard]] double progress() const {
    if (joint_) return 1.0;
    return static_cast<double>(iteration_) /
           static_cast<double>(std::max<std::int64_t>(config_.iterations, 1));
  }
  [[nodiscard]] int active_sh_degree() const {
    if (config_.sh_grow_every <= 0.0) return config_.sh_degree;
    const double grown = std::floor(progress() / config_.sh_grow_every);
    return static_cast<int>(std::min<double>(config_.sh_degree, grown));
  }
  /// What is drawn waits for its losses.
  struct Drawn {
    std::size_t index = 0;
    SurfelTensors leaves;
    ViewTensors images;
  };
  void draw(std::size_t index);
  /// Losses of what is drawn, and Adam.
  /// @param before, after  Called before and after the derivatives are taken.
  template <class Before, class After>
  GeometryStep learn(const Before& before, const After& after, double rate);
  [[nodiscard]] Tensor rows_in_view() const {
    return drawn_.images.max_weight.gt(0).nonzero().squeeze(1);
  }
  [[nodiscard]] internal::SurfelRates rates(double factor) const;
  [[nodiscard]] bool refines_poses() const {
    return config_.rate.pose_rotation > 0.0 || config_.rate.pose_translation > 0.0;
  }

  void move_pose(std::size_t view, const SurfelTensors& leaves, const Tensor& rows);
  void gather(const ViewTensors& drawn, const Tensor& rows, const TrainingView& view,
              const core::CameraPose& T_world_camera);
  void change_count();
  void forget_statistics();
  [[nodiscard]] SurfelStatistics statistics() const;
  /// Of the surfels; the statistics of the others stay.
  void prune(bool needs_are_known);
  void split(const std::vector<std::int64_t>& rows);
  void fill();

  const TrainingSet& set_;
  GeometryConfig config_;
  std::uint64_t seed_;
  double extent_m_;
  internal::RasterFunction raster_;
  internal::SurfelState state_;
  Tensor rays_;
  internal::TrainingPoses poses_;
  internal::AdamTensor exposure_;  ///< [views, (log gain, offset), rgb].
  HoleFiller holes_;
  std::int64_t iteration_ = 0;
  bool joint_ = false;
  Drawn drawn_;
  /// Since the last change of the count.
  Tensor gradient_sum_, gradient_views_, max_weight_;
  std::int64_t statistics_views_ = 0;
};

internal::SurfelRates GeometryTrainer::Impl::rates(double factor) const {
  const GeometryConfig::Rate& rate = config_.rate;
  internal::SurfelRates rates;
  // From the first to the last along an exponential (Kerbl et al. 2023).
  const double ratio = rate.position > 0.0 ? rate.position_final / rate.position : 0.0;
  rates.position =
      rate.position * std::pow(std::max(ratio, 1e-12), progress()) * extent_m_ * factor;
  rates.log_scale = rate.log_scale * factor;
  rates.rotation = rate.rotation * factor;
  rates.opacity = rate.opacity * factor;
  rates.color = rate.color * factor;
  rates.color_rest = rate.color_rest * factor;
  return rates;
}

void GeometryTrainer::Impl::draw(std::size_t index) {
  drawn_.index = index;
  drawn_.leaves = state_.leaves();
  const bool distorts =
      config_.loss.distortion > 0.0 && progress() >= config_.loss.distortion_from;
  drawn_.images = raster_.draw(drawn_.leaves, active_sh_degree(), set_.intrinsics,
                               poses_.now()[index], distorts);
}

GeometryStep GeometryTrainer::Impl::step() {
  draw(view_of_iteration(iteration_, set_.training.size(), seed_));
  const core::CameraPose T_world_camera = poses_.now()[drawn_.index];  // It may move.
  GeometryStep step = learn([] {}, [] {}, 1.0);
  gather(drawn_.images, rows_in_view(), set_.training[drawn_.index], T_world_camera);
  ++iteration_;
  change_count();
  step.iteration = iteration_;
  step.surfels = state_.count();
  return step;
}

PixelWeights GeometryTrainer::Impl::draw(std::size_t view,
                                         std::span<const std::int32_t> pixels) {
  joint_ = true;
  draw(view);
  return raster_.rasterizer().weights(pixels.data(), static_cast<std::int64_t>(pixels.size()),
                                      0);
}

void GeometryTrainer::Impl::step_with(std::span<const std::int32_t> pixels,
                                      const PixelWeights& weights,
                                      const GeometryGradient& labels,
                                      const JointConfig& config) {
  SEGSIM_CHECK(joint_, "no draw() yet");
  std::vector<float> by_weight = labels.by_weight;
  for (float& by : by_weight) by = static_cast<float>(config.labels * static_cast<double>(by));
  const auto before = [&] {
    if (by_weight.empty()) return;
    raster_.rasterizer().add_weight_loss(pixels, weights, by_weight.data());
  };
  const auto after = [&] {
    if (labels.surfel.empty()) return;
    const at::NoGradGuard no_grad;
    const Tensor by =
        internal::device_tensor(labels.by_position, torch::kFloat32, raster_.device())
            .view({-1, 3});
    drawn_.leaves.position_m.mutable_grad().index_add_(
        0, internal::device_tensor(labels.surfel, torch::kInt64, raster_.device()),
        config.labels * by);
  };
  learn(before, after, config.rate);
  ++iteration_;
}

template <class Before, class After>
GeometryStep GeometryTrainer::Impl::learn(const Before& before, const After& after,
                                          double rate) {
  const TrainingView& view = set_.training[drawn_.index];
  const core::CameraPose T_world_camera = poses_.now()[drawn_.index];
  const internal::ViewTargets targets = internal::view_targets(view, raster_.device());
  Tensor exposure;
  const auto exposure_row = static_cast<std::int64_t>(drawn_.index);
  if (config_.rate.exposure > 0.0) {
    exposure = exposure_.value().select(0, exposure_row).detach().clone().requires_grad_(true);
  }
  GeometryStep step;
  const Tensor rays = progress() >= config_.loss.normal_from ? rays_ : Tensor();
  const Tensor loss = internal::view_loss(drawn_.images, targets, config_.loss, exposure, rays,
                                          T_world_camera, step);
  if (!std::isfinite(step.total())) {
    throw core::InputError::expected(
        "geometry training: loss at iteration " + std::to_string(iteration_ + 1) + ", frame " +
            view.name,
        "a finite number (lower rates may help)", std::to_string(step.total()));
  }
  before();
  loss.backward();
  after();

  const Tensor rows = rows_in_view();
  if (refines_poses() && !joint_) move_pose(drawn_.index, drawn_.leaves, rows);
  state_.step(drawn_.leaves, rows, active_sh_degree(), rates(rate));
  if (exposure.defined()) {
    exposure_.step_rows(torch::full({1}, exposure_row, rows.options()),
                        exposure.grad().unsqueeze(0), config_.rate.exposure);
  }
  return step;
}

std::vector<Exposure> GeometryTrainer::Impl::exposures() const {
  if (config_.rate.exposure <= 0.0) return {};
  const std::vector<float> values = host(exposure_.value().detach());
  std::vector<Exposure> exposures(set_.training.size());
  for (std::size_t view = 0; view < exposures.size(); ++view) {
    for (int c = 0; c < 3; ++c) {
      const auto at = 6 * view + static_cast<std::size_t>(c);
      exposures[view].gain[c] = std::exp(values[at]);
      exposures[view].offset[c] = values[at + 3];
    }
  }
  return exposures;
}

void GeometryTrainer::Impl::move_pose(std::size_t view, const SurfelTensors& leaves,
                                      const Tensor& rows) {
  const SurfelTensors all = internal::gradients_of(leaves);
  const auto in_view = [&](const SurfelTensors& s) {
    const at::NoGradGuard no_grad;
    const auto of = [&](const Tensor& t) { return t.index_select(0, rows); };
    return SurfelTensors{of(s.position_m), {}, of(s.rotation), {}, of(s.sh)};
  };
  const double factor = std::pow(kFinalPoseRate, progress());
  poses_.step(view,
              internal::camera_gradient(in_view(leaves), in_view(all), poses_.now()[view]),
              factor * config_.rate.pose_translation, factor * config_.rate.pose_rotation);
  poses_.keep_mean();
}

void GeometryTrainer::Impl::gather(const ViewTensors& drawn, const Tensor& rows,
                                   const TrainingView& view,
                                   const core::CameraPose& T_world_camera) {
  const at::NoGradGuard no_grad;
  gradient_sum_.add_(drawn.screen);
  gradient_views_.index_add_(0, rows, torch::ones_like(rows).to(torch::kFloat32));
  max_weight_ = at::maximum(max_weight_, drawn.max_weight);
  ++statistics_views_;
  const GeometryConfig::Densify& densify = config_.densify;
  // Asked where the image is: most views show no hole.
  if (densify.fill_holes && progress() <= densify.until &&
      drawn.alpha.detach().lt(HoleFiller::kHoleAlpha).any().item<bool>()) {
    const std::vector<float> alpha = host(drawn.alpha.detach());
    holes_.add_view(view, T_world_camera, set_.intrinsics, alpha, config_.loss.min_depth_m,
                    config_.loss.max_depth_m);
  }
}

void GeometryTrainer::Impl::change_count() {
  const at::NoGradGuard no_grad;
  const GeometryConfig::Densify& densify = config_.densify;
  const auto views = static_cast<std::int64_t>(set_.training.size());
  const bool in_time = progress() >= densify.from && progress() <= densify.until;
  // Not before every view had its say: splits in haste cost more than they give.
  const std::int64_t wait = std::max(at_share(densify.every, config_.iterations), views);
  // Whether no view needs a surfel is known when all views were drawn since the last change;
  // two epochs of different order contain every view at least once.
  const bool needs_are_known = statistics_views_ >= 2 * views;
  if (in_time) {
    if (statistics_views_ < wait) return;
    prune(needs_are_known);
    split(surfels_to_split(statistics(), densify));
    fill();
    forget_statistics();
  } else if (needs_are_known && progress() <= densify.prune_until) {
    prune(needs_are_known);
    forget_statistics();
  }
}

void GeometryTrainer::Impl::prune(bool needs_are_known) {
  SurfelStatistics now = statistics();
  if (!needs_are_known) std::fill(now.max_weight.begin(), now.max_weight.end(), kNeeded);
  const auto rows = surfels_to_keep(now, config_.densify, extent_m_);
  if (static_cast<std::int64_t>(rows.size()) == state_.count() || rows.empty()) return;
  const Tensor kept = internal::device_tensor(rows, torch::kInt64, raster_.device());
  state_.select(kept);
  for (Tensor* sum : {&gradient_sum_, &gradient_views_, &max_weight_}) {
    *sum = sum->index_select(0, kept);
  }
}

void GeometryTrainer::Impl::forget_statistics() {
  const auto options = torch::TensorOptions().device(raster_.device());
  gradient_sum_ = torch::zeros({state_.count()}, options);
  gradient_views_ = torch::zeros({state_.count()}, options);
  max_weight_ = torch::zeros({state_.count()}, options);
  statistics_views_ = 0;
}

SurfelStatistics GeometryTrainer::Impl::statistics() const {
  SurfelStatistics s;
  s.gradient = host(gradient_sum_ / gradient_views_.clamp_min(1));
  s.max_weight = host(max_weight_);
  const SurfelTensors now = state_.leaves();
  s.opacity = host(now.opacity_logit.detach().sigmoid());
  const Tensor scale_m = now.log_scale.detach().exp();
  s.long_scale_m = host(scale_m.amax(1));
  s.short_scale_m = host(scale_m.amin(1));
  return s;
}

void GeometryTrainer::Impl::split(const std::vector<std::int64_t>& rows) {
  if (rows.empty()) return;
  // Those that stay, then the first halves, then the second halves.
  std::vector<std::int64_t> order;
  auto next = rows.begin();
  for (std::int64_t i = 0; i < state_.count(); ++i) {
    if (next != rows.end() && *next == i) {
      ++next;
    } else {
      order.push_back(i);
    }
  }
  order.insert(order.end(), rows.begin(), rows.end());
  order.insert(order.end(), rows.begin(), rows.end());
  state_.select(internal::device_tensor(order, torch::kInt64, raster_.device()));
  RawSurfels first = state_.tail(static_cast<std::int64_t>(rows.size()));
  const RawSurfels second = split_surfels(first);
  std::vector<float> position_m = std::move(first.position_m);
  std::vector<float> log_scale = std::move(first.log_scale);
  position_m.insert(position_m.end(), second.position_m.begin(), second.position_m.end());
  log_scale.insert(log_scale.end(), second.log_scale.begin(), second.log_scale.end());
  state_.set_tail_shape(position_m, log_scale);
}

void GeometryTrainer::Impl::fill() {
  const RawSurfels added = holes_.take(config_.densify.max_surfels - state_.count());
  if (added.count() > 0) state_.append(added);
}

void GeometryTrainer::Impl::save(const std::filesystem::path& file,
                                 const std::string& identity) const {
  internal::StateWriter out("geometry/2 " + identity);
  state_.save(out);
  exposure_.save(out, "exposure");
  poses_.save(out);
  out.put("gradient_sum", gradient_sum_);
  out.put("gradient_views", gradient_views_);
  out.put("max_weight", max_weight_);
  const RawSurfels& pending = holes_.pending();
  const auto put = [&](const char* name, const std::vector<float>& values) {
    out.put(name, internal::device_tensor(values, torch::kFloat32, torch::kCPU));
  };
  put("holes.position", pending.position_m);
  put("holes.log_scale", pending.log_scale);
  put("holes.rotation", pending.rotation);
  put("holes.opacity", pending.opacity_logit);
  put("holes.sh", pending.sh);
  out.put_integers("counts", {iteration_, statistics_views_});
  out.write(file);
}

void GeometryTrainer::Impl::load(const std::filesystem::path& file,
                                 const std::string& identity) {
  const internal::StateReader in(file, "geometry/2 " + identity);
  state_.load(in);
  exposure_.load(in, "exposure");
  poses_.load(in);
  in.expect_rows("exposure", static_cast<std::int64_t>(set_.training.size()));
  const std::vector<std::int64_t> counts = in.integers("counts");
  in.expect_rows("counts", 2);
  iteration_ = counts[0];
  statistics_views_ = counts[1];
  for (const char* name : {"gradient_sum", "gradient_views", "max_weight"}) {
    in.expect_rows(name, state_.count());
  }
  gradient_sum_ = in.take("gradient_sum", gradient_sum_);
  gradient_views_ = in.take("gradient_views", gradient_views_);
  max_weight_ = in.take("max_weight", max_weight_);
  const Tensor like = torch::zeros({0}, torch::kFloat32);
  RawSurfels pending;
  pending.sh_degree = config_.sh_degree;
  pending.position_m = host(in.take("holes.position", like));
  pending.log_scale = host(in.take("holes.log_scale", like));
  pending.rotation = host(in.take("holes.rotation", like));
  pending.opacity_logit = host(in.take("holes.opacity", like));
  pending.sh = host(in.take("holes.sh", like));
  holes_.restore(std::move(pending));
}

std::size_t view_of_iteration(std::int64_t iteration, std::size_t views, std::uint64_t seed) {
  SEGSIM_CHECK(iteration >= 0 && views > 0, "no views");
  const auto i = static_cast<std::uint64_t>(iteration);
  core::RandomStream random(seed, "view_order", i / views);
  std::vector<std::size_t> order(views);
  std::iota(order.begin(), order.end(), std::size_t{0});
  for (std::size_t k = views; k > 1; --k) {
    std::swap(order[k - 1], order[random.index(static_cast<std::uint32_t>(k))]);
  }
  return order[i % views];
}

GeometryTrainer::GeometryTrainer(const TrainingSet& set, const renderer::SurfelCloud& start,
                                 const GeometryConfig& config, std::uint64_t seed,
                                 const GeometryDevice& device)
    : impl_(std::make_unique<Impl>(set, start, config, seed, device)) {}
GeometryTrainer::~GeometryTrainer() = default;
std::int64_t GeometryTrainer::iteration() const { return impl_->iteration(); }
GeometryStep GeometryTrainer::step() { return impl_->step(); }
PixelWeights GeometryTrainer::draw(std::size_t view, std::span<const std::int32_t> pixels) {
  return impl_->draw(view, pixels);
}
void GeometryTrainer::step_with(std::span<const std::int32_t> pixels,
                                const PixelWeights& weights, const GeometryGradient& labels,
                                const JointConfig& config) {
  impl_->step_with(pixels, weights, labels, config);
}
std::vector<glm::vec3> GeometryTrainer::positions_m() const { return impl_->positions_m(); }
renderer::SurfelCloud GeometryTrainer::surfels() const { return impl_->surfels(); }
const std::vector<core::CameraPose>& GeometryTrainer::poses() const { return impl_->poses(); }
std::vector<Exposure> GeometryTrainer::exposures() const { return impl_->exposures(); }
void GeometryTrainer::save(const std::filesystem::path& file,
                           const std::string& identity) const {
  impl_->save(file, identity);
}
void GeometryTrainer::load(const std::filesystem::path& file, const std::string& identity) {
  impl_->load(file, identity);
}

}  // namespace segsim::reconstruction
