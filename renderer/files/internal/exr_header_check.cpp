#include "renderer/files/internal/exr_header_check.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <map>
#include <string>

#include "core/error.h"
#include "core/input/regular_file.h"

namespace segsim::renderer::internal {
namespace {

constexpr std::uint32_t kMagic = 20000630, kTiledFlag = 0x200, kMultiPartFlag = 0x1000;
/// Lines of a chunk, by the number of the compression.
constexpr std::array kLines{1, 1, 1, 16, 32, 16, 32, 32, 32, 256};
constexpr std::int64_t kChunkOffsetBytes = 8;

/// What values of these types take, whatever size stands before them.
const std::map<std::string, std::int64_t>& fixed_bytes() {
  static const std::map<std::string, std::int64_t> kBytes{
      {"box2f", 16},      {"box2i", 16},    {"chromaticities", 32},
      {"compression", 1}, {"double", 8},    {"deepImageState", 1},
      {"envmap", 1},      {"float", 4},     {"int", 4},
      {"keycode", 28},    {"lineOrder", 1}, {"m33d", 72},
      {"m33f", 36},       {"m44d", 128},    {"m44f", 64},
      {"rational", 8},    {"tiledesc", 9},  {"timecode", 8},
      {"v2d", 16},        {"v2f", 8},       {"v2i", 8},
      {"v3d", 24},        {"v3f", 12},      {"v3i", 12}};
  return kBytes;
}

/// What decides how many chunks a part has.
struct PartShape {
  std::array<std::int32_t, 4> window{};  ///< First column and line, last column and line.
  std::array<std::uint32_t, 2> tile{};
  std::int32_t chunk_count = 0;
  std::uint8_t compression = 0;
  bool tiled = false;
};

/// Of numbers that may be of any size.
double chunks(const PartShape& shape) {
  const double columns = 1.0 + shape.window[2] - shape.window[0];
  const double lines = 1.0 + shape.window[3] - shape.window[1];
  double count = shape.chunk_count;
  if (shape.tiled && shape.tile[0] > 0 && shape.tile[1] > 0) {
    count = std::max(count, columns / shape.tile[0] * (lines / shape.tile[1]));
  } else if (!shape.tiled && shape.compression < kLines.size()) {
    count = std::max(count, lines / kLines[shape.compression]);
  }
  return count;
}

class HeaderScan {
 public:
  explicit HeaderScan(const std::filesystem::path& file)
      : place_(file.string()),
        in_(file, std::ios::binary),
        size_(static_cast<std::int64_t>(std::filesystem::file_size(file))) {}

  void run() {
    if (take<std::uint32_t>() != kMagic) return;
    const auto flags = take<std::uint32_t>();
    const bool tiled = (flags & kTiledFlag) != 0;
    while (header(tiled) && (flags & kMultiPartFlag) != 0) {
    }
  }

 private:
  /// False behind the last one.
  bool header(bool tiled) {
    PartShape shape;
    shape.tiled = tiled;
    std::string name = word();
    const bool any = !name.empty();
    for (; !name.empty(); name = word()) attribute(name, shape);
    const auto most = static_cast<double>(size_ / kChunkOffsetBytes);
    if (in_ && chunks(shape) > most) {
      throw core::InputError::expected(
          place_, "at most " + std::to_string(size_ / kChunkOffsetBytes) + " chunks of pixels",
          "a header of more");
    }
    return any && in_;
  }

  void attribute(const std::string& name, PartShape& shape) {
    const std::string type = word();
    const auto bytes = std::int64_t{take<std::int32_t>()};
    if (!in_) return;
    const std::int64_t begin = in_.tellg();
    if (bytes < 0 || bytes > size_ - begin) {
      throw core::InputError::expected(
          place_, "at most " + std::to_string(size_ - begin) + " bytes of attribute " + name,
          std::to_string(bytes));
    }
    if (!holds(type, bytes, begin + bytes)) {
      throw core::InputError::expected(place_, "a " + type + " as attribute " + name,
                                       "one of " + std::to_string(bytes) + " bytes");
    }
    in_.clear();
    in_.seekg(begin);
    if (name == "dataWindow" && bytes == sizeof shape.window) {
      shape.window = take<decltype(shape.window)>();
    } else if (name == "tiles" && bytes > static_cast<std::int64_t>(sizeof shape.tile)) {
      shape.tile = take<decltype(shape.tile)>();
    } else if (name == "compression" && bytes == sizeof shape.compression) {
      shape.compression = take<std::uint8_t>();
    } else if (name == "chunkCount" && bytes == sizeof shape.chunk_count) {
      shape.chunk_count = take<std::int32_t>();
    } else if (name == "type" && type == "string" && bytes < 64) {
      std::string kind(static_cast<std::size_t>(bytes), '\0');
      in_.read(kind.data(), bytes);
      shape.tiled = kind.find("tile") != std::string::npos;
    }
    in_.seekg(begin + bytes);
  }

  /// Whether a value of the type that begins here ends where its size says: the library goes
  /// by the value, and would take something else for the next attribute.
  bool holds(const std::string& type, std::int64_t bytes, std::int64_t end) {
    if (const auto fixed = fixed_bytes().find(type); fixed != fixed_bytes().end()) {
      return bytes == fixed->second;
    }
    if (type == "chlist") {
      constexpr std::int64_t kChannelBytes = 16;
      while (!word().empty()) in_.seekg(kChannelBytes, std::ios::cur);
      return in_ && in_.tellg() == end;
    }
    if (type == "preview") {
      const auto width = take<std::uint32_t>(), height = take<std::uint32_t>();
      return bytes >= 8 && 4.0 * width * height == static_cast<double>(bytes - 8);
    }
    if (type == "stringvector") {
      while (in_ && in_.tellg() < end) {
        const auto length = std::int64_t{take<std::int32_t>()};
        if (length < 0) return false;
        in_.seekg(length, std::ios::cur);
      }
      return in_ && in_.tellg() == end;
    }
    return true;
  }

  /// Up to the next zero; empty at the end of the file and if it is longer than names are.
  std::string word() {
    std::array<char, 257> text{};
    in_.getline(text.data(), text.size(), '\0');
    return in_ ? text.data() : "";
  }

  template <class Value>
  Value take() {
    Value value{};
    in_.read(reinterpret_cast<char*>(&value), sizeof value);
    return value;
  }

  std::string place_;
  std::ifstream in_;
  std::int64_t size_;
};

}  // namespace

void check_exr_header(const std::filesystem::path& file) {
  if (!core::can_be_read(file)) {
    throw core::InputError::expected(file.string(), "an OpenEXR image", "no file");
  }
  HeaderScan(file).run();
}

}  // namespace segsim::renderer::internal
