#include "reconstruction/datasets/point_cloud_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <exception>
#include <fstream>
#include <optional>
#include <string>

#include <pcl/PCLPointCloud2.h>
#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/regular_file.h"
#include "core/pictures/ply_check.h"
#include "reconstruction/datasets/internal/pcd_check.h"

namespace segsim::reconstruction {
namespace {

using core::InputError;

enum class Kind { kPcd, kPly };

/// By the first line that says something: names of files may lie.
Kind kind_of(const std::filesystem::path& file) {
  std::ifstream in;
  if (core::can_be_read(file)) in.open(file, std::ios::binary);
  if (!in.is_open()) {
    throw InputError::expected(file.string(), "a point cloud (PCD or PLY)", "no such file");
  }
  std::string line;
  while (std::getline(in, line) && line.size() < 256) {
    if (line.starts_with("ply")) return Kind::kPly;
    if (line.starts_with("VERSION") || line.starts_with("FIELDS")) return Kind::kPcd;
    if (!line.starts_with('#') && !line.empty() && line != "\r") break;
  }
  throw InputError::expected(file.string(), "the header of a PCD or PLY file",
                             "something else");
}

pcl::PCLPointCloud2 read_with_pcl(const std::filesystem::path& file) {
  const char* word = "an intact PCD file";
  internal::check_pcd(core::read_file(file), file.string());
  pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);  // Faults are reported here.
  pcl::PCLPointCloud2 cloud;
  Eigen::Vector4f origin;
  Eigen::Quaternionf orientation;
  int version = 0;
  int result = -1;
  try {
    result = pcl::PCDReader().read(file.string(), cloud, origin, orientation, version);
  } catch (const std::exception& error) {
    throw InputError::expected(file.string(), word, error.what());
  }
  const std::size_t points = static_cast<std::size_t>(cloud.width) * cloud.height;
  if (result < 0) throw InputError::expected(file.string(), word, "one that PCL cannot read");
  if (points * cloud.point_step > cloud.data.size()) {
    throw InputError::expected(file.string(), std::to_string(points) + " points",
                               std::to_string(cloud.data.size()) + " bytes");
  }
  return cloud;
}

/// A field of scalars, if the cloud has one of this name.
class Field {
 public:
  static std::optional<Field> find(const pcl::PCLPointCloud2& cloud, const std::string& name) {
    for (const pcl::PCLPointField& field : cloud.fields) {
      if (field.name == name && field.count <= 1) return Field(cloud, field);
    }
    return std::nullopt;
  }

  [[nodiscard]] bool is_float() const {
    return type_ == pcl::PCLPointField::FLOAT32 || type_ == pcl::PCLPointField::FLOAT64;
  }
  [[nodiscard]] bool has_four_bytes() const {
    return type_ == pcl::PCLPointField::FLOAT32 || type_ == pcl::PCLPointField::UINT32 ||
           type_ == pcl::PCLPointField::INT32;
  }

  /// Of a field that is_float().
  [[nodiscard]] float number(std::size_t point) const {
    if (type_ == pcl::PCLPointField::FLOAT64) {
      return static_cast<float>(load<double>(point));
    }
    return load<float>(point);
  }
  /// 0xAARRGGBB as PCL packs colours, into a float or an integer.
  [[nodiscard]] core::Rgb8 color(std::size_t point) const {
    const auto bits = load<std::uint32_t>(point);
    const auto byte = [&](unsigned shift) {
      return static_cast<std::uint8_t>((bits >> shift) & 0xFFU);
    };
    return {byte(16), byte(8), byte(0)};
  }

 private:
  Field(const pcl::PCLPointCloud2& cloud, const pcl::PCLPointField& field)
      : cloud_(&cloud), offset_(field.offset), type_(field.datatype) {}

  template <class Value>
  [[nodiscard]] Value load(std::size_t point) const {
    Value value;
    std::memcpy(&value, cloud_->data.data() + point * cloud_->point_step + offset_,
                sizeof value);
    return value;
  }

  const pcl::PCLPointCloud2* cloud_;
  std::size_t offset_;
  int type_;
};

Field coordinate(const pcl::PCLPointCloud2& cloud, const std::string& name,
                 const std::filesystem::path& file) {
  const std::optional<Field> field = Field::find(cloud, name);
  if (field && field->is_float()) return *field;
  std::string names;
  for (const auto& known : cloud.fields) names += (names.empty() ? "" : " ") + known.name;
  throw InputError::expected(file.string(), "a field " + name + " of floats",
                             names.empty() ? "no fields" : names);
}

PointCloud read_pcd(const std::filesystem::path& file) {
  const pcl::PCLPointCloud2 read = read_with_pcl(file);
  const Field x = coordinate(read, "x", file), y = coordinate(read, "y", file),
              z = coordinate(read, "z", file);
  std::optional<Field> color = Field::find(read, "rgb");
  if (!color) color = Field::find(read, "rgba");
  if (color && !color->has_four_bytes()) color.reset();

  PointCloud cloud;
  const std::size_t points = static_cast<std::size_t>(read.width) * read.height;
  for (std::size_t i = 0; i < points; ++i) {
    cloud.position_m.emplace_back(x.number(i), y.number(i), z.number(i));
    if (color) cloud.rgb.push_back(color->color(i));
  }
  return cloud;
}

/// PCL ends the process at colours that are not all there, so that it does not read these.
PointCloud read_ply(const std::filesystem::path& file) {
  using Names = std::array<std::string_view, 3>;
  constexpr Names kAxes{"x", "y", "z"}, kColors{"red", "green", "blue"};
  const std::string bytes = core::read_file(file);
  const auto axes = core::read_ply_properties(bytes, file.string(), "vertex", kAxes);
  const auto colors = core::read_ply_properties(bytes, file.string(), "vertex", kColors);
  for (const std::string_view name : kAxes) {
    const auto axis = axes.find(std::string(name));
    if (axis == axes.end() ||
        (axis->second.type != "float" && axis->second.type != "double")) {
      throw InputError::expected(file.string(),
                                 "a property " + std::string(name) + " of floats", "none");
    }
  }
  const bool colored = colors.size() == kColors.size() &&
                       std::all_of(colors.begin(), colors.end(), [](const auto& named) {
                         return named.second.type == "uchar";
                       });
  PointCloud cloud;
  const auto number = [&](const char* name, std::size_t i) {
    return static_cast<float>(axes.at(name).values[i]);
  };
  const auto byte = [&](const char* name, std::size_t i) {
    const double value = colors.at(name).values[i];  // In a text it may be "nan".
    return static_cast<std::uint8_t>(value > 0.0 ? std::min(value, 255.0) : 0.0);
  };
  for (std::size_t i = 0; i < axes.at("x").values.size(); ++i) {
    cloud.position_m.emplace_back(number("x", i), number("y", i), number("z", i));
    if (colored) cloud.rgb.push_back({byte("red", i), byte("green", i), byte("blue", i)});
  }
  return cloud;
}

bool is_finite(const glm::vec3& p_m) {
  return std::isfinite(p_m.x) && std::isfinite(p_m.y) && std::isfinite(p_m.z);
}

}  // namespace

PointCloud read_point_cloud(const std::filesystem::path& file) {
  PointCloud cloud = kind_of(file) == Kind::kPcd ? read_pcd(file) : read_ply(file);
  const std::size_t points = cloud.position_m.size();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points; ++i) {
    if (!is_finite(cloud.position_m[i])) continue;
    cloud.position_m[kept] = cloud.position_m[i];
    if (!cloud.rgb.empty()) cloud.rgb[kept] = cloud.rgb[i];
    ++kept;
  }
  cloud.position_m.resize(kept);
  if (!cloud.rgb.empty()) cloud.rgb.resize(kept);
  if (cloud.position_m.empty()) {
    throw InputError::expected(file.string(), "points with finite coordinates",
                               "none among " + std::to_string(points));
  }
  return cloud;
}

}  // namespace segsim::reconstruction
