#include "renderer/raster/tile_resolve.h"

#include <algorithm>

#include <hwy/cache_control.h>

namespace segsim::renderer::internal {
namespace {

/// A row of `T` may begin anywhere in a cache line.
template <class T>
void prefetch_row(const T* row, std::size_t bytes) {
  const auto* at = reinterpret_cast<const char*>(row);
  for (std::size_t i = 0; i < bytes; i += 64) hwy::Prefetch(at + i);
}

void prefetch(const ResolveJob& job, bool features, std::uint32_t surfel) {
  if (features) {
    prefetch_row(&job.cloud->semantic_feature[surfel], sizeof(core::SemanticFeature));
    prefetch_row(&job.cloud->instance_feature[surfel], sizeof(core::InstanceFeature));
  }
  if (job.field != nullptr) {
    hwy::Prefetch(job.field->classes.row(surfel).data());
    hwy::Prefetch(job.field->instances.row(surfel).data());
  }
}

}  // namespace

void SelectedSurfels::clear() {
  slots_.clear();
  first_.assign(1, 0);
}

void SelectedSurfels::append_pixel(std::span<const WeightedSlot> selected) {
  slots_.insert(slots_.end(), selected.begin(), selected.end());
  first_.push_back(slots_.size());
}

void SelectedSurfels::assign(std::span<const Entry> entries, std::size_t pixel_count) {
  // A counting sort: first_[p + 1] counts, then walks from the pixel's first entry to its end.
  first_.assign(pixel_count + 2, 0);
  for (const Entry& entry : entries) ++first_[entry.pixel + 2];
  for (std::size_t p = 2; p < first_.size(); ++p) first_[p] += first_[p - 1];
  slots_.resize(entries.size());
  for (const Entry& entry : entries) {
    slots_[first_[entry.pixel + 1]++] = {entry.weight, entry.slot};
  }
  first_.pop_back();
}

bool BlockResolver::is_new(std::uint32_t surfel) {
  constexpr std::uint32_t kProbes = 8;
  const std::uint32_t hash = surfel * 2654435761U >> 21U;
  for (std::uint32_t probe = 0; probe < kProbes; ++probe) {
    Seen& entry = seen_[(hash + probe) % kTableSize];
    if (entry.block != block_) {
      entry = {surfel, block_};
      return true;
    }
    if (entry.surfel == surfel) return false;
  }
  return true;
}

std::uint64_t BlockResolver::fetch_block(const ResolveJob& job, const SurfelShade* shade,
                                         const SelectedSurfels& selected, std::size_t begin,
                                         std::size_t end) {
  const bool features = job.cloud != nullptr && job.cloud->has_features();
  std::uint64_t rows = 0;
  ++block_;
  for (std::size_t pixel = begin; pixel < end; ++pixel) {
    for (const WeightedSlot& s : selected.pixel(pixel)) {
      const std::uint32_t surfel = shade[s.slot].surfel;
      if (!is_new(surfel)) continue;
      ++rows;
      prefetch(job, features, surfel);
    }
  }
  return rows;
}

void BlockResolver::resolve_pixel(const ResolveJob& job, const SurfelShade* shade,
                                  std::span<const WeightedSlot> selected, std::size_t pixel,
                                  const ResolvedPixels& out) {
  surfels_.clear();
  for (const WeightedSlot& s : selected) {
    surfels_.push_back({s.weight, shade[s.slot].surfel});
  }
  if (out.labels != nullptr) {
    if (job.field != nullptr) {
      out.labels->set(pixel, resolve_panoptic(*job.field, surfels_, scratch_));
    } else {
      labels_.clear();
      for (const WeightedSlot& s : selected) {
        labels_.push_back({s.weight, shade[s.slot].label});
      }
      out.labels->set(pixel, vote(labels_));
    }
  }
  if (out.semantic_feature != nullptr) {
    resolve_features(*job.cloud, surfels_, out.semantic_feature[pixel],
                     out.instance_feature[pixel]);
  }
}

std::uint64_t BlockResolver::resolve(const ResolveJob& job, const SurfelShade* shade,
                                     const SelectedSurfels& selected,
                                     const ResolvedPixels& out) {
  const bool own_labels = out.labels != nullptr && job.field == nullptr;
  const bool rows_wanted =
      (out.labels != nullptr && job.field != nullptr) || out.semantic_feature != nullptr;
  std::uint64_t rows = own_labels ? selected.size() : 0;
  for (std::size_t begin = 0; begin < selected.pixel_count(); begin += kBlockPixels) {
    const std::size_t end = std::min(begin + kBlockPixels, selected.pixel_count());
    if (rows_wanted) rows += fetch_block(job, shade, selected, begin, end);
    for (std::size_t pixel = begin; pixel < end; ++pixel) {
      resolve_pixel(job, shade, selected.pixel(pixel), pixel, out);
    }
  }
  return rows;
}

}  // namespace segsim::renderer::internal
