#include "renderer/files/ply_io.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <ostream>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/bounds.h"
#include "renderer/files/internal/ply_reader.h"

namespace segsim::renderer {
namespace {

using core::InputError;
using internal::PlyTable;

/// Degree whose coefficients beyond the first number `rest_count` over three channels.
int sh_degree_of(const PlyTable& table, std::size_t rest_count) {
  for (int degree = 0; degree <= 3; ++degree) {
    const auto n = static_cast<std::size_t>((degree + 1) * (degree + 1));
    if (rest_count == 3 * (n - 1)) return degree;
  }
  throw InputError::expected(table.place(), "0, 9, 24 or 45 properties f_rest_*",
                             std::to_string(rest_count));
}

constexpr const char* kSemanticFeature = "sem_f_";
constexpr const char* kInstanceFeature = "ins_f_";

/// Columns prefix0 ... prefix(count - 1).
std::vector<std::size_t> feature_columns(const PlyTable& table, const std::string& prefix,
                                         int count) {
  std::vector<std::size_t> columns;
  for (int i = 0; i < count; ++i) {
    const std::string name = prefix + std::to_string(i);
    if (table.has(name)) columns.push_back(table.column(name));
  }
  const std::size_t there = table.count_with_prefix(prefix);
  if (columns.size() != static_cast<std::size_t>(count) || there != columns.size()) {
    throw InputError::expected(
        table.place(),
        "no features or all of " + prefix + "0 ... " + std::to_string(count - 1),
        std::to_string(columns.size()) + " of them and " +
            std::to_string(there - columns.size()) + " others");
  }
  return columns;
}

/// Where each value of a surfel lies in a row.
struct Columns {
  std::array<std::size_t, 3> position{}, dc{};
  std::array<std::size_t, 2> scale{};
  std::array<std::size_t, 4> rotation{};
  std::size_t opacity = 0, semantic = 0, instance = 0;
  std::vector<std::size_t> rest;
  std::vector<std::size_t> semantic_feature, instance_feature;  ///< Empty: the file has none.

  explicit Columns(const PlyTable& table)
      : position{table.column("x"), table.column("y"), table.column("z")},
        opacity(table.column("opacity")) {
    for (std::size_t i = 0; i < 3; ++i) dc[i] = table.column("f_dc_" + std::to_string(i));
    for (std::size_t i = 0; i < 2; ++i) scale[i] = table.column("scale_" + std::to_string(i));
    for (std::size_t i = 0; i < 4; ++i) rotation[i] = table.column("rot_" + std::to_string(i));
    rest.resize(table.count_with_prefix("f_rest_"));
    for (std::size_t i = 0; i < rest.size(); ++i) {
      rest[i] = table.column("f_rest_" + std::to_string(i));
    }
    if (table.count_with_prefix(kSemanticFeature) + table.count_with_prefix(kInstanceFeature) >
        0) {
      semantic_feature = feature_columns(table, kSemanticFeature, core::kSemanticFeatureSize);
      instance_feature = feature_columns(table, kInstanceFeature, core::kInstanceFeatureSize);
    }
  }
};

class RowReader {
 public:
  RowReader(const PlyTable& table, std::size_t row) : table_(table), row_(row) {}

  /// The value as stored. @throws core::InputError unless it is finite.
  [[nodiscard]] float operator()(std::size_t column, const char* name) const {
    const auto value = static_cast<float>(table_.value(row_, column));
    if (!std::isfinite(value)) refuse(std::string("a finite ") + name, std::to_string(value));
    return value;
  }
  [[nodiscard]] std::uint16_t id(std::size_t column, const char* name) const {
    const double value = table_.value(row_, column);
    if (!(value >= 0.0 && value <= 65535.0 && value == std::floor(value))) {
      refuse(std::string(name) + " in 0 ... 65535", std::to_string(value));
    }
    return static_cast<std::uint16_t>(value);
  }
  [[noreturn]] void refuse(const std::string& expected, const std::string& found) const {
    throw InputError::expected(table_.place() + " vertex " + std::to_string(row_), expected,
                               found);
  }

 private:
  const PlyTable& table_;
  std::size_t row_;
};

template <std::size_t kSize>
void read_feature(const RowReader& row, const std::vector<std::size_t>& columns,
                  std::array<float, kSize>& feature) {
  for (std::size_t k = 0; k < kSize; ++k) feature[k] = row(columns[k], "feature");
}

float activated_scale_m(const RowReader& row, std::size_t column) {
  const float stored = row(column, "scale");
  const float scale_m = std::exp(stored);
  if (!std::isfinite(scale_m)) row.refuse("log-scale below 88", std::to_string(stored));
  return std::max(scale_m, 1e-12F);
}

glm::quat rotation_of(const RowReader& row, const std::array<std::size_t, 4>& columns) {
  std::array<double, 4> q{};
  double norm2 = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    q[i] = row(columns[i], "rotation");
    norm2 += q[i] * q[i];
  }
  if (norm2 < 1e-20) row.refuse("a rotation quaternion", "zero");
  const double s = 1.0 / std::sqrt(norm2);
  return {static_cast<float>(q[0] * s), static_cast<float>(q[1] * s),
          static_cast<float>(q[2] * s), static_cast<float>(q[3] * s)};
}

float sigmoid(float x) {
  return std::max(1.0F / (1.0F + std::exp(-x)), std::numeric_limits<float>::min());
}

void read_surfel(const RowReader& row, const Columns& columns, std::size_t i,
                 SurfelCloud& surfels) {
  for (int axis = 0; axis < 3; ++axis) {
    const float position_m = row(columns.position[axis], "position");
    if (!core::within_world(static_cast<double>(position_m))) {
      row.refuse("a position within 1e7 m", std::to_string(position_m));
    }
    surfels.position_m[i][axis] = position_m;
  }
  surfels.R_world_surfel[i] = rotation_of(row, columns.rotation);
  surfels.scale_m[i] = {activated_scale_m(row, columns.scale[0]),
                        activated_scale_m(row, columns.scale[1])};
  surfels.opacity[i] = sigmoid(row(columns.opacity, "opacity"));
  const std::size_t n = surfels.sh_count();
  glm::vec3* sh = surfels.sh.data() + i * n;
  for (std::size_t channel = 0; channel < 3; ++channel) {
    const auto c = static_cast<int>(channel);
    sh[0][c] = row(columns.dc[channel], "colour");
    for (std::size_t k = 1; k < n; ++k) {
      sh[k][c] = row(columns.rest[channel * (n - 1) + k - 1], "colour");
    }
  }
  if (surfels.has_features()) {
    read_feature(row, columns.semantic_feature, surfels.semantic_feature[i]);
    read_feature(row, columns.instance_feature, surfels.instance_feature[i]);
  }
}

/// Inverse of the sigmoid; 1 would be infinite.
float logit(float opacity) {
  const double o = std::min(static_cast<double>(opacity), 1.0 - 6e-8);
  return static_cast<float>(std::log(o / (1.0 - o)));
}

void write_header(std::ostream& out, const SurfelCloud& surfels) {
  out << "ply\nformat binary_little_endian 1.0\nelement vertex " << surfels.size() << '\n';
  const auto property = [&out](const std::string& name) {
    out << "property float " << name << '\n';
  };
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"}) {
    property(name);
  }
  for (std::size_t i = 0; i < 3 * (surfels.sh_count() - 1); ++i) {
    property("f_rest_" + std::to_string(i));
  }
  for (const char* name :
       {"opacity", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3"}) {
    property(name);
  }
  if (surfels.has_features()) {
    for (int i = 0; i < core::kSemanticFeatureSize; ++i) {
      property(kSemanticFeature + std::to_string(i));
    }
    for (int i = 0; i < core::kInstanceFeatureSize; ++i) {
      property(kInstanceFeature + std::to_string(i));
    }
  }
  if (surfels.has_labels()) {
    out << "property ushort semantic_id\nproperty ushort instance_id\n";
  }
  out << "end_header\n";
}

/// The floats of surfel i in file order.
void fill_row(const SurfelCloud& surfels, std::size_t i, std::vector<float>& row) {
  const std::size_t n = surfels.sh_count();
  const glm::vec3& p = surfels.position_m[i];
  const glm::vec3* sh = surfels.sh.data() + i * n;
  const glm::quat& q = surfels.R_world_surfel[i];
  row.assign({p.x, p.y, p.z, 0.0F, 0.0F, 0.0F, sh[0].r, sh[0].g, sh[0].b});
  for (int channel = 0; channel < 3; ++channel) {
    for (std::size_t k = 1; k < n; ++k) row.push_back(sh[k][channel]);
  }
  row.insert(row.end(), {logit(surfels.opacity[i]), std::log(surfels.scale_m[i].x),
                         std::log(surfels.scale_m[i].y), q.w, q.x, q.y, q.z});
  if (surfels.has_features()) {
    const core::SemanticFeature& semantic = surfels.semantic_feature[i];
    const core::InstanceFeature& instance = surfels.instance_feature[i];
    row.insert(row.end(), semantic.begin(), semantic.end());
    row.insert(row.end(), instance.begin(), instance.end());
  }
}

}  // namespace

SurfelCloud read_surfels_ply(const std::filesystem::path& file) {
  const PlyTable table(file);
  Columns columns(table);
  SurfelCloud surfels;
  surfels.sh_degree = sh_degree_of(table, columns.rest.size());
  const bool labelled = table.has("semantic_id") || table.has("instance_id");
  if (labelled) {
    columns.semantic = table.column("semantic_id");
    columns.instance = table.column("instance_id");
  }
  const std::size_t n = table.row_count();
  surfels.position_m.resize(n);
  surfels.R_world_surfel.resize(n);
  surfels.scale_m.resize(n);
  surfels.opacity.resize(n);
  surfels.sh.resize(n * surfels.sh_count());
  if (labelled) {
    surfels.semantic_id.resize(n);
    surfels.instance_id.resize(n);
  }
  if (!columns.semantic_feature.empty()) {
    surfels.semantic_feature.resize(n);
    surfels.instance_feature.resize(n);
  }
  for (std::size_t i = 0; i < n; ++i) {
    const RowReader row(table, i);
    read_surfel(row, columns, i, surfels);
    if (!labelled) continue;
    surfels.semantic_id[i] = row.id(columns.semantic, "semantic_id");
    surfels.instance_id[i] = row.id(columns.instance, "instance_id");
  }
  return surfels;
}

void write_surfels_ply(const std::filesystem::path& file, const SurfelCloud& surfels) {
  check_surfels(surfels);
  core::write_file_atomically(file, [&surfels](std::ostream& out) {
    write_header(out, surfels);
    std::vector<float> row;
    std::string bytes;
    for (std::size_t i = 0; i < surfels.size(); ++i) {
      fill_row(surfels, i, row);
      bytes.resize(row.size() * sizeof(float));
      std::memcpy(bytes.data(), row.data(), bytes.size());
      if (surfels.has_labels()) {
        const std::array<std::uint16_t, 2> ids = {surfels.semantic_id[i],
                                                  surfels.instance_id[i]};
        bytes.resize(bytes.size() + sizeof ids);
        std::memcpy(bytes.data() + bytes.size() - sizeof ids, ids.data(), sizeof ids);
      }
      out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    }
  });
}

}  // namespace segsim::renderer
