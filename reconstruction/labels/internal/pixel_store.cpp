#include "reconstruction/labels/internal/pixel_store.h"

#include <algorithm>

#include "core/random.h"

namespace segsim::reconstruction::internal {

PixelStore::PixelStore(std::int64_t frames, std::int64_t pixels, std::uint64_t seed,
                       const at::Device& device)
    : per_frame_((pixels + std::max<std::int64_t>(frames, 1) - 1) /
                 std::max<std::int64_t>(frames, 1)),
      seed_(seed) {
  const auto options = torch::TensorOptions().device(device);
  surfel_ = torch::zeros({0}, options.dtype(torch::kInt64));
  row_ = surfel_.clone();
  weight_ = torch::zeros({0}, options.dtype(torch::kFloat32));
}

void PixelStore::keep(const PanopticBatch& batch, const BlendMatrix& matrix,
                      const BatchTargets& targets,
                      const std::vector<std::int64_t>& candidates) {
  if (candidates.empty() || has_.contains(batch.frame)) return;
  has_.insert(batch.frame);
  std::vector<std::int64_t> chosen = candidates;
  core::RandomStream random(seed_, "kept_pixels", static_cast<std::uint64_t>(batch.frame));
  const auto count = std::min(chosen.size(), static_cast<std::size_t>(per_frame_));
  for (std::size_t i = 0; i < count; ++i) {
    std::swap(chosen[i],
              chosen[i + random.index(static_cast<std::uint32_t>(chosen.size() - i))]);
  }
  chosen.resize(count);
  std::sort(chosen.begin(), chosen.end());
  std::vector<std::int64_t> place(static_cast<std::size_t>(matrix.pixels), -1);
  for (const std::int64_t pixel : chosen) {
    const auto p = static_cast<std::size_t>(pixel);
    place[p] = size();
    frame_.push_back(batch.frame);
    class_index_.push_back(targets.class_index[p]);
    mask_id_.push_back(targets.mask_index[p] < 0 ? 0 : batch.instance[p]);
  }
  const Tensor row_pixel =
      matrix.row_pixel.defined()
          ? matrix.row_pixel
          : torch::repeat_interleave(matrix.row_start.slice(0, 1) -
                                     matrix.row_start.slice(0, 0, matrix.pixels));
  const Tensor row =
      device_tensor(place, torch::kInt64, surfel_.device()).index_select(0, row_pixel);
  const Tensor entries = row.ge(0).nonzero().squeeze(1);
  row_ = torch::cat({row_, row.index_select(0, entries)});
  surfel_ = torch::cat(
      {surfel_, matrix.surfel.index_select(0, matrix.row_surfel.index_select(0, entries))});
  weight_ = torch::cat({weight_, matrix.row_weight.index_select(0, entries)});
}

Tensor PixelStore::blend(const Tensor& values) const {
  const at::NoGradGuard no_grad;
  return torch::zeros({size(), values.size(1)}, values.options())
      .index_add(0, row_, values.index_select(0, surfel_) * weight_.unsqueeze(1));
}

void PixelStore::save(StateWriter& out) const {
  out.put("kept.surfel", surfel_);
  out.put("kept.row", row_);
  out.put("kept.weight", weight_);
  out.put_integers("kept.frame", frame_);
  out.put_integers("kept.class", class_index_);
  out.put_integers("kept.mask", mask_id_);
}

void PixelStore::load(const StateReader& in) {
  surfel_ = in.take("kept.surfel", surfel_);
  row_ = in.take("kept.row", row_);
  weight_ = in.take("kept.weight", weight_);
  frame_ = in.integers("kept.frame");
  class_index_ = in.integers("kept.class");
  mask_id_ = in.integers("kept.mask");
  has_ = std::set<std::int64_t>(frame_.begin(), frame_.end());
}

}  // namespace segsim::reconstruction::internal
