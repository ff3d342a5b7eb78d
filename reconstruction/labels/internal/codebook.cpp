#include "reconstruction/labels/internal/codebook.h"

#include <algorithm>
#include <numeric>

#include "core/random.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr std::int64_t kRowsAtOnce = 1 << 16;  ///< Of tables of distances.

/// Means of rows by their group; groups without rows keep `otherwise`.
Tensor group_means(const Tensor& rows, const Tensor& group, const Tensor& otherwise) {
  const Tensor sum = torch::zeros_like(otherwise).index_add(0, group, rows);
  const Tensor count = torch::bincount(group, {}, otherwise.size(0)).unsqueeze(1);
  return torch::where(count.gt(0), sum / count.clamp_min(1), otherwise);
}

/// The nearest of all means.
Tensor nearest_mean(const Tensor& rows, const Tensor& means) {
  std::vector<Tensor> parts;
  for (std::int64_t begin = 0; begin < rows.size(0); begin += kRowsAtOnce) {
    const Tensor part = rows.slice(0, begin, begin + kRowsAtOnce);
    // |x - m|^2 but for |x|^2, which is the same for all means.
    parts.push_back(
        (means.pow(2).sum(1).unsqueeze(0) - 2.0 * part.matmul(means.t())).argmin(1));
  }
  return torch::cat(parts);
}

/// The nearest of the `fine` means of a row's own coarse group.
Tensor nearest_of_own(const Tensor& rows, const Tensor& coarse, const Tensor& means,
                      std::int64_t fine) {
  const Tensor by_coarse = means.view({-1, fine, means.size(1)});
  std::vector<Tensor> parts;
  for (std::int64_t begin = 0; begin < rows.size(0); begin += kRowsAtOnce) {
    const Tensor own = by_coarse.index_select(0, coarse.slice(0, begin, begin + kRowsAtOnce));
    const Tensor part = rows.slice(0, begin, begin + kRowsAtOnce).unsqueeze(1);
    parts.push_back((part - own).pow(2).sum(2).argmin(1));
  }
  return torch::cat(parts) + coarse * fine;
}

}  // namespace

Codebook::Codebook(std::int64_t surfels, int coarse, int fine, int rounds, std::uint64_t seed,
                   const at::Device& device)
    : coarse_(coarse), fine_(fine), rounds_(rounds), seed_(seed) {
  group_ = torch::zeros({surfels}, torch::TensorOptions().dtype(torch::kInt64).device(device));
}

std::vector<std::int64_t> Codebook::drawn() const {
  std::vector<std::int64_t> order(static_cast<std::size_t>(group_.size(0)));
  std::iota(order.begin(), order.end(), std::int64_t{0});
  core::RandomStream random(seed_, "codebook");
  for (std::size_t i = 0; i + 1 < order.size(); ++i) {
    std::swap(order[i], order[i + random.index(static_cast<std::uint32_t>(order.size() - i))]);
  }
  return order;
}

void Codebook::assign_coarse(const Tensor& feature, const Tensor& place) {
  const at::NoGradGuard no_grad;
  const Tensor rows = torch::cat({feature, place}, 1);
  Tensor coarse = torch::div(group_, fine_, "floor"), means;
  if (level_ == Level::kNone) {
    std::vector<std::int64_t> first = drawn();
    first.resize(std::min(first.size(), static_cast<std::size_t>(coarse_)));
    means = rows.index_select(0, device_tensor(first, torch::kInt64, group_.device()));
    means = torch::cat(
        {means, torch::full({coarse_ - means.size(0), rows.size(1)}, 1e6, rows.options())});
  } else {
    // A group that is empty now comes back where no surfel is.
    means =
        group_means(rows, coarse, torch::full({coarse_, rows.size(1)}, 1e6, rows.options()));
  }
  for (int round = 0; round < rounds_; ++round) {
    coarse = nearest_mean(rows, means);
    means = group_means(rows, coarse, means);
  }
  level_ = Level::kCoarse;
  group_ = coarse * fine_;
}

void Codebook::assign_fine(const Tensor& feature) {
  const at::NoGradGuard no_grad;
  const Tensor coarse = torch::div(group_, fine_, "floor");
  Tensor means = torch::full({size(), feature.size(1)}, 1e6, feature.options());
  if (level_ == Level::kFine) {
    means = group_means(feature, group_, means);
  } else {
    // The first surfels drawn of every coarse group.
    const Tensor host = coarse.cpu();
    std::vector<std::int64_t> taken(static_cast<std::size_t>(coarse_), 0), from, to;
    for (const std::int64_t surfel : drawn()) {
      const std::int64_t c = host.data_ptr<std::int64_t>()[surfel];
      std::int64_t& count = taken[static_cast<std::size_t>(c)];
      if (count == fine_) continue;
      from.push_back(surfel);
      to.push_back(c * fine_ + count++);
    }
    means.index_copy_(
        0, device_tensor(to, torch::kInt64, group_.device()),
        feature.index_select(0, device_tensor(from, torch::kInt64, group_.device())));
  }
  for (int round = 0; round < rounds_; ++round) {
    group_ = nearest_of_own(feature, coarse, means, fine_);
    means = group_means(feature, group_, means);
  }
  level_ = Level::kFine;
}

Tensor Codebook::means(const Tensor& feature) const {
  const at::NoGradGuard no_grad;
  return group_means(feature, group_,
                     torch::zeros({size(), feature.size(1)}, feature.options()));
}

void Codebook::save(StateWriter& out) const {
  out.put("codebook.group", group_);
  out.put_integers("codebook.level", {static_cast<std::int64_t>(level_)});
}

void Codebook::load(const StateReader& in) {
  in.expect_rows("codebook.group", group_.size(0));
  in.expect_rows("codebook.level", 1);
  group_ = in.take("codebook.group", group_);
  level_ = static_cast<Level>(in.integers("codebook.level").front());
}

}  // namespace segsim::reconstruction::internal
