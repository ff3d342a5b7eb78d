#include "renderer/cuda/device_scene.h"

#include <algorithm>
#include <array>

#include "renderer/scene/packed_surfels.h"

namespace segsim::renderer::cuda {
namespace {

static_assert(kClusterSurfels == internal::kClusterSize);

template <std::size_t kSize>
std::vector<float> flat(const std::vector<std::array<float, kSize>>& rows) {
  std::vector<float> values;
  values.reserve(rows.size() * kSize);
  for (const auto& row : rows) values.insert(values.end(), row.begin(), row.end());
  return values;
}

/// One channel of all surfels of a scene of degree 0.
std::vector<float> colours_of(const internal::PackedSurfels& packed, std::size_t channel) {
  std::vector<float> values(packed.surfel.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = packed.colour[internal::PackedSurfels::plane_index(i, 1, 0, channel)];
  }
  return values;
}

/// Coefficients of one surfel after the other, channels of a coefficient together.
std::vector<float> harmonics_of(const internal::PackedSurfels& packed,
                                std::size_t coefficients) {
  std::vector<float> values;
  values.reserve(packed.sh.size());
  for (std::size_t i = 0; i < packed.surfel.size(); ++i) {
    for (std::size_t k = 0; k < coefficients; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        values.push_back(
            packed.sh[internal::PackedSurfels::plane_index(i, coefficients, k, c)]);
      }
    }
  }
  return values;
}

/// Score of entry `i` of a row; 0 if there is none.
float score_at(std::span<const SparseScores::Entry> row, std::size_t i) {
  return i < row.size() ? row[i].excess : 0.0F;
}

}  // namespace

DeviceScene::DeviceScene(const SurfelCloud& cloud, const PanopticField* field) {
  const internal::PackedSurfels packed(cloud);
  view_.x_m = keep(packed.x_m), view_.y_m = keep(packed.y_m), view_.z_m = keep(packed.z_m);
  view_.ux_m = keep(packed.ux_m), view_.uy_m = keep(packed.uy_m);
  view_.uz_m = keep(packed.uz_m);
  view_.vx_m = keep(packed.vx_m), view_.vy_m = keep(packed.vy_m);
  view_.vz_m = keep(packed.vz_m);
  view_.k2 = keep(packed.k2);
  view_.nx = keep(packed.nx), view_.ny = keep(packed.ny), view_.nz = keep(packed.nz);
  view_.sh_degree = cloud.sh_degree;
  if (cloud.sh_degree == 0) {
    view_.red = keep(colours_of(packed, 0));
    view_.green = keep(colours_of(packed, 1));
    view_.blue = keep(colours_of(packed, 2));
  } else {
    view_.sh = keep(harmonics_of(packed, cloud.sh_count()));
  }
  std::vector<float> clusters;
  for (const internal::Cluster& c : packed.clusters) {
    clusters.insert(clusters.end(), {c.centre_m.x, c.centre_m.y, c.centre_m.z, c.radius_m});
  }
  view_.cluster = keep(clusters);
  view_.clusters = static_cast<int>(packed.cluster_count());

  std::vector<std::uint32_t> place(cloud.size()), label(cloud.size());
  for (std::size_t m = 0; m < cloud.size(); ++m) {
    place[packed.surfel[m]] = static_cast<std::uint32_t>(m);
    label[packed.surfel[m]] = packed.label[m];
  }
  id_ = DeviceArray<std::uint32_t>(std::span<const std::uint32_t>(packed.surfel));
  place_ = DeviceArray<std::uint32_t>(std::span<const std::uint32_t>(place));
  view_.id = id_.data(), view_.place = place_.data();
  if (cloud.has_labels()) {
    label_ = DeviceArray<std::uint32_t>(std::span<const std::uint32_t>(label));
    view_.label = label_.data();
  }
  if (field != nullptr) upload_field(*field);
  if (cloud.has_features()) upload_features(cloud);
}

const float* DeviceScene::keep(const std::vector<float>& values) {
  floats_.emplace_back(std::span<const float>(values));
  return floats_.back().data();
}

void DeviceScene::upload_features(const SurfelCloud& cloud) {
  features_.semantic = keep(flat(cloud.semantic_feature));
  features_.instance = keep(flat(cloud.instance_feature));
}

PanopticRows DeviceScene::upload_rows(const SparseScores& scores) {
  constexpr std::size_t kEntries = 8;
  const std::size_t capacity = (scores.row_capacity() + kEntries - 1) / kEntries * kEntries;
  std::vector<std::uint16_t> index(scores.size() * capacity, kNoIndex);
  std::vector<float> score(scores.size() * capacity, 0.0F);
  for (std::size_t i = 0; i < scores.size(); ++i) {
    std::size_t at = i * capacity;
    for (const SparseScores::Entry& e : scores.row(i)) {
      index[at] = e.index;
      score[at++] = e.excess;
    }
  }
  indices_.emplace_back(std::span<const std::uint16_t>(index));
  return {indices_.back().data(), keep(score), static_cast<int>(capacity)};
}

void DeviceScene::upload_field(const PanopticField& field) {
  std::vector<PanopticHead> heads(field.size());
  for (std::size_t i = 0; i < heads.size(); ++i) {
    const auto classes = field.classes.row(i), queries = field.instances.row(i);
    heads[i] = {.class_index = classes.empty() ? kNoIndex : classes[0].index,
                .query_index = queries.empty() ? kNoIndex : queries[0].index,
                .class_score = score_at(classes, 0),
                .next_class_score = score_at(classes, 1),
                .query_excess = score_at(queries, 0),
                .next_query_excess = score_at(queries, 1),
                .query_base = field.instances.base(i),
                .unused = {}};
  }
  head_ = DeviceArray<PanopticHead>(std::span<const PanopticHead>(heads));
  const auto keep_ids = [this](const std::vector<std::uint16_t>& ids) {
    indices_.emplace_back(std::span<const std::uint16_t>(ids));
    return indices_.back().data();
  };
  class_is_thing_ =
      DeviceArray<std::uint8_t>(std::span<const std::uint8_t>(field.class_is_thing));
  field_.head = head_.data();
  field_.classes = upload_rows(field.classes);
  field_.queries = upload_rows(field.instances);
  field_.class_id = keep_ids(field.class_id);
  field_.class_is_thing = class_is_thing_.data();
  field_.query_id = keep_ids(field.instance_id);
  if (!field.instance_class.empty()) field_.query_class = keep_ids(field.instance_class);
}

}  // namespace segsim::renderer::cuda
