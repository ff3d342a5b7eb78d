#include "sim/ground/triangle_mesh.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <sstream>
#include <string>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/input/bounds.h"

namespace segsim::sim {
namespace {

static_assert(std::endian::native == std::endian::little, "PLY is written as memory lies");

/// One scalar property, or a list if `count_bytes` > 0.
struct Property {
  std::string name;
  char kind = 'i';  ///< i signed, u unsigned, f real.
  int bytes = 0;
  int count_bytes = 0;
};

/// Every property is looked at once for each vertex.
constexpr std::size_t kMostProperties = 1024;

struct Element {
  std::string name;
  std::size_t count = 0;
  std::vector<Property> properties;
};

Property property_of_type(const std::string& type, const std::string& place) {
  static const std::array<std::pair<const char*, std::pair<char, int>>, 16> kTypes = {{
      {"char", {'i', 1}},
      {"int8", {'i', 1}},
      {"uchar", {'u', 1}},
      {"uint8", {'u', 1}},
      {"short", {'i', 2}},
      {"int16", {'i', 2}},
      {"ushort", {'u', 2}},
      {"uint16", {'u', 2}},
      {"int", {'i', 4}},
      {"int32", {'i', 4}},
      {"uint", {'u', 4}},
      {"uint32", {'u', 4}},
      {"float", {'f', 4}},
      {"float32", {'f', 4}},
      {"double", {'f', 8}},
      {"float64", {'f', 8}},
  }};
  for (const auto& [name, form] : kTypes) {
    if (type == name) {
      return {.name = {}, .kind = form.first, .bytes = form.second, .count_bytes = 0};
    }
  }
  throw core::InputError::expected(place, "a PLY scalar type", "'" + type + "'");
}

std::vector<Element> read_header(std::istream& in, const std::string& place) {
  std::string line;
  std::getline(in, line);
  if (line != "ply" && line != "ply\r") {
    throw core::InputError::expected(place, "a PLY file", "another first line");
  }
  std::vector<Element> elements;
  bool binary = false;
  while (std::getline(in, line)) {
    std::istringstream words(line);
    std::string word;
    words >> word;
    if (word == "format") {
      words >> word;
      binary = word == "binary_little_endian";
    } else if (word == "element") {
      Element element;
      if (!(words >> element.name >> element.count)) {
        throw core::InputError::expected(place, "'element <name> <count>'", "'" + line + "'");
      }
      elements.push_back(element);
    } else if (word == "property" && !elements.empty()) {
      std::string type;
      words >> type;
      int count_bytes = 0;
      if (type == "list") {
        words >> type;
        const Property count = property_of_type(type, place);
        if (count.kind == 'f') {
          throw core::InputError::expected(place, "an integer list length", "'" + type + "'");
        }
        count_bytes = count.bytes;
        words >> type;
      }
      Property property = property_of_type(type, place);
      property.count_bytes = count_bytes;
      words >> property.name;
      if (elements.back().properties.size() >= kMostProperties) {
        throw core::InputError::expected(
            place, "at most " + std::to_string(kMostProperties) + " properties", "more");
      }
      elements.back().properties.push_back(property);
    } else if (word == "end_header") {
      if (!binary) {
        throw core::InputError::expected(place, "format binary_little_endian",
                                         "another format");
      }
      return elements;
    }
  }
  throw core::InputError::expected(place, "'end_header'", "the end of the file");
}

/// Reads scalars from memory and refuses to run past its end.
class ByteReader {
 public:
  ByteReader(const char* data, std::size_t size, std::string place)
      : data_(data), size_(size), place_(std::move(place)) {}

  double scalar(char kind, int bytes) {
    const char* from = take(static_cast<std::size_t>(bytes));
    if (kind == 'f') return bytes == 4 ? as<float>(from) : as<double>(from);
    if (kind == 'u') {
      if (bytes == 1) return as<std::uint8_t>(from);
      return bytes == 2 ? as<std::uint16_t>(from) : as<std::uint32_t>(from);
    }
    if (bytes == 1) return as<std::int8_t>(from);
    return bytes == 2 ? as<std::int16_t>(from) : as<std::int32_t>(from);
  }

  [[nodiscard]] std::size_t left() const { return size_ - at_; }

 private:
  template <class T>
  static T as(const char* from) {
    T value;
    std::memcpy(&value, from, sizeof value);
    return value;
  }

  const char* take(std::size_t bytes) {
    if (size_ - at_ < bytes) {
      throw core::InputError::expected(place_, "more data", "the end of the file");
    }
    const char* from = data_ + at_;
    at_ += bytes;
    return from;
  }

  const char* data_;
  std::size_t size_, at_ = 0;
  std::string place_;
};

void read_vertices(const Element& element, ByteReader& bytes, const std::string& place,
                   TriangleMesh& mesh) {
  std::array<int, 3> column = {-1, -1, -1};
  for (std::size_t k = 0; k < element.properties.size(); ++k) {
    const Property& property = element.properties[k];
    if (property.count_bytes > 0) {
      throw core::InputError::expected(place, "scalar vertex properties", "a list");
    }
    if (property.kind == 'f' && property.name.size() == 1 && property.name[0] >= 'x' &&
        property.name[0] <= 'z') {
      column[static_cast<std::size_t>(property.name[0] - 'x')] = static_cast<int>(k);
    }
  }
  if (column[0] < 0 || column[1] < 0 || column[2] < 0) {
    throw core::InputError::expected(place, "real vertex properties x, y, z", "others");
  }
  std::size_t vertex_bytes = 0;
  for (const Property& property : element.properties) {
    vertex_bytes += static_cast<std::size_t>(property.bytes);
  }
  // Before memory is asked for: the count is only what the header says.
  if (element.count > bytes.left() / vertex_bytes) {
    throw core::InputError::expected(place, "more data", "the end of the file");
  }
  mesh.positions_m.reserve(element.count);
  std::vector<double> values(element.properties.size());
  for (std::size_t v = 0; v < element.count; ++v) {
    for (std::size_t k = 0; k < values.size(); ++k) {
      values[k] = bytes.scalar(element.properties[k].kind, element.properties[k].bytes);
    }
    glm::vec3 p;
    for (int axis = 0; axis < 3; ++axis) {
      p[axis] = static_cast<float>(
          values[static_cast<std::size_t>(column[static_cast<std::size_t>(axis)])]);
      if (!core::within_world(static_cast<double>(p[axis]))) {
        throw core::InputError::expected(
            place + ", vertex " + std::to_string(v),
            core::print("finite coordinates within %g m", core::kFarthest_m),
            core::print("%g", static_cast<double>(p[axis])));
      }
    }
    mesh.positions_m.push_back(p);
  }
}

void read_faces(const Element& element, ByteReader& bytes, const std::string& place,
                TriangleMesh& mesh) {
  if (element.properties.empty() || element.properties[0].count_bytes == 0 ||
      element.properties[0].kind == 'f') {
    throw core::InputError::expected(place, "a list of vertex indices in each face", "none");
  }
  const auto limit = static_cast<double>(mesh.positions_m.size());
  std::vector<std::uint32_t> corners;
  for (std::size_t f = 0; f < element.count; ++f) {
    for (std::size_t k = 0; k < element.properties.size(); ++k) {
      const Property& property = element.properties[k];
      const auto count =
          property.count_bytes > 0
              ? static_cast<std::int64_t>(bytes.scalar('u', property.count_bytes))
              : std::int64_t{1};
      if (k == 0) corners.clear();
      for (std::int64_t i = 0; i < count; ++i) {
        const double value = bytes.scalar(property.kind, property.bytes);
        if (k > 0) continue;
        if (value < 0.0 || value >= limit) {
          throw core::InputError::expected(
              place + ", face " + std::to_string(f),
              "indices below " + std::to_string(mesh.positions_m.size()),
              std::to_string(static_cast<std::int64_t>(value)));
        }
        corners.push_back(static_cast<std::uint32_t>(value));
      }
    }
    for (std::size_t i = 2; i < corners.size(); ++i) {
      mesh.triangles.emplace_back(corners[0], corners[i - 1], corners[i]);
    }
  }
}

}  // namespace

void append_floor(TriangleMesh& mesh, float x0_m, float y0_m, float x1_m, float y1_m,
                  float z_m) {
  const auto base = static_cast<std::uint32_t>(mesh.positions_m.size());
  mesh.positions_m.emplace_back(x0_m, y0_m, z_m);
  mesh.positions_m.emplace_back(x1_m, y0_m, z_m);
  mesh.positions_m.emplace_back(x1_m, y1_m, z_m);
  mesh.positions_m.emplace_back(x0_m, y1_m, z_m);
  mesh.triangles.emplace_back(base, base + 1, base + 2);
  mesh.triangles.emplace_back(base, base + 2, base + 3);
}

void write_mesh_ply(const std::filesystem::path& file, const TriangleMesh& mesh) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << "ply\nformat binary_little_endian 1.0\ncomment collision mesh, metres, z up\n"
        << "element vertex " << mesh.positions_m.size()
        << "\nproperty float x\nproperty float y\nproperty float z\nelement face "
        << mesh.triangles.size() << "\nproperty list uchar int vertex_indices\nend_header\n";
    for (const glm::vec3& p : mesh.positions_m) {
      const std::array<float, 3> xyz = {p.x, p.y, p.z};
      out.write(std::bit_cast<std::array<char, 12>>(xyz).data(), 12);
    }
    for (const glm::uvec3& t : mesh.triangles) {
      const std::array<std::uint32_t, 3> corners = {t.x, t.y, t.z};
      out.put('\3');
      out.write(std::bit_cast<std::array<char, 12>>(corners).data(), 12);
    }
  });
}

TriangleMesh read_mesh_ply(const std::filesystem::path& file) {
  const std::string place = file.string();
  const std::string text = core::read_file(file);
  std::istringstream in(text);
  const std::vector<Element> elements = read_header(in, place);
  if (elements.empty() || elements[0].name != "vertex") {
    throw core::InputError::expected(place, "vertices first", "another element");
  }
  // No line ends behind `end_header` at the end of a file: then the stream has no position.
  const std::size_t begin = in.eof() ? text.size() : static_cast<std::size_t>(in.tellg());
  ByteReader bytes(text.data() + begin, text.size() - begin, place);
  TriangleMesh mesh;
  read_vertices(elements[0], bytes, place, mesh);
  if (elements.size() > 1 && elements[1].name == "face") {
    read_faces(elements[1], bytes, place, mesh);
  }
  return mesh;
}

}  // namespace segsim::sim
