#include "perception/checkpoint/weights_file.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <span>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/lineage.h"
#include "perception/checkpoint/yolov13_scale.h"
#include "perception/data/json_node.h"

namespace segsim::perception {
namespace {

constexpr char kMagic[] = "SEGSIMW1";
constexpr std::size_t kMagicBytes = 8, kLengthBytes = 4;
constexpr const char* kSchema = "segsim-detector-weights/1";

static_assert(std::endian::native == std::endian::little, "tensors are stored little-endian");

std::int64_t count_of(const std::vector<std::int64_t>& shape) {
  std::int64_t count = 1;
  for (const std::int64_t side : shape) {
    if (side < 0 || (side > 0 && count > (std::int64_t{1} << 32) / side)) return -1;
    count *= side;
  }
  return count;
}

bool is_half_exactly(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float value) {
    return std::isfinite(value) && from_half(to_half(value)) == value;
  });
}

/// Appends the values as float16 or float32.
void append_values(const NamedTensor& tensor, bool half, const std::string& place,
                   std::string& data) {
  for (const float value : tensor.values) {
    const std::uint16_t bits = to_half(value);
    if (!std::isfinite(value) || (half && !std::isfinite(from_half(bits)))) {
      throw core::InputError::expected(place + ": " + tensor.name,
                                       half ? "values within +-65504" : "finite values",
                                       std::to_string(value));
    }
    if (half) {
      data.append(reinterpret_cast<const char*>(&bits), sizeof bits);
    } else {
      data.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
  }
}

/// @param bytes_left  Of the data, for this tensor and those after it.
NamedTensor read_tensor(const Json& entry, const std::string& data, const std::string& place,
                        std::uint64_t& bytes_left) {
  NamedTensor tensor{entry.at("name").get<std::string>(),
                     entry.at("shape").get<std::vector<std::int64_t>>(),
                     {}};
  const std::string type = entry.at("type").get<std::string>();
  if (type != "float16" && type != "float32") {
    throw core::InputError::expected(place + ": type of " + tensor.name, "float16 or float32",
                                     type);
  }
  const std::size_t item_bytes = type == "float16" ? 2 : 4;
  const auto offset = entry.at("offset").get<std::uint64_t>();
  const std::int64_t count = count_of(tensor.shape);
  if (count < 0 || offset > data.size() ||
      static_cast<std::uint64_t>(count) > (data.size() - offset) / item_bytes) {
    throw core::InputError::expected(
        place + ": " + tensor.name, "a tensor inside the data",
        shape_text(tensor.shape) + " at " + std::to_string(offset));
  }
  // Tensors do not share their numbers: a header of a page could ask for terabytes.
  const std::uint64_t bytes = static_cast<std::uint64_t>(count) * item_bytes;
  if (bytes > bytes_left) {
    throw core::InputError::expected(place + ": " + tensor.name,
                                     "tensors that have the data to themselves",
                                     "more numbers than there are");
  }
  bytes_left -= bytes;
  tensor.values.resize(static_cast<std::size_t>(count));
  const char* source = data.data() + offset;
  for (float& value : tensor.values) {
    if (item_bytes == 2) {
      std::uint16_t bits = 0;
      std::memcpy(&bits, source, 2);
      value = from_half(bits);
    } else {
      std::memcpy(&value, source, 4);
    }
    source += item_bytes;
    if (!std::isfinite(value)) {
      throw core::InputError::expected(place + ": " + tensor.name, "finite values",
                                       std::to_string(value));
    }
  }
  return tensor;
}

void check_values(const DetectorWeights& weights, const std::string& place) {
  if (!(weights.width > 0.0 && weights.width <= 4.0)) {
    throw core::InputError::expected(place + ": width", "(0, 4]",
                                     std::to_string(weights.width));
  }
  if (weights.input_px < 32 || weights.input_px > 4096 || weights.input_px % 32 != 0) {
    throw core::InputError::expected(place + ": input_px", "a multiple of 32 in [32, 4096]",
                                     std::to_string(weights.input_px));
  }
  if (weights.class_names.empty()) {
    throw core::InputError::expected(place + ": class_names", "at least one class", "none");
  }
  if (!(weights.score_threshold >= 0.0F && weights.score_threshold <= 1.0F)) {
    throw core::InputError::expected(place + ": score_threshold", "[0, 1]",
                                     std::to_string(weights.score_threshold));
  }
}

DetectorWeights parse(const Json& header, const std::string& data, const std::string& place) {
  const auto require = [&place](const std::string& key, const std::string& wanted,
                                const std::string& found) {
    if (wanted != found) throw core::InputError::expected(place + ": " + key, wanted, found);
  };
  require("schema", kSchema, header.at("schema").get<std::string>());
  require("data_bytes", std::to_string(header.at("data_bytes").get<std::uint64_t>()),
          std::to_string(data.size()));
  require("data_sha256", header.at("data_sha256").get<std::string>(), core::sha256_hex(data));
  DetectorWeights weights;
  weights.architecture = header.at("architecture").get<std::string>();
  if (yolov13::is_architecture(weights.architecture)) {
    (void)yolov13::scale_of_architecture(weights.architecture, place);
  } else if (weights.architecture != DetectorWeights::kCenterNet) {
    require("architecture", DetectorWeights::kArchitecture, weights.architecture);
  }
  weights.width = header.at("width").get<double>();
  weights.input_px = header.at("input_px").get<int>();
  weights.class_names = header.at("class_names").get<std::vector<std::string>>();
  weights.score_threshold = header.at("score_threshold").get<float>();
  weights.training = header.at("training").dump();
  (void)recorded_data(weights.training, place);  // A damaged record is a damaged file.
  check_values(weights, place);
  std::uint64_t bytes_left = data.size();
  for (const Json& entry : header.at("tensors")) {
    weights.tensors.push_back(read_tensor(entry, data, place, bytes_left));
  }
  return weights;
}

}  // namespace

std::uint16_t to_half(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  const auto sign = static_cast<std::uint16_t>((bits >> 16U) & 0x8000U);
  const float magnitude = std::fabs(value);
  if (std::isnan(value)) return static_cast<std::uint16_t>(sign | 0x7E00U);
  if (magnitude >= 65520.0F) return static_cast<std::uint16_t>(sign | 0x7C00U);
  if (magnitude < 0x1p-14F) {  // Subnormal: multiples of 2^-24; nearbyint rounds to even.
    return static_cast<std::uint16_t>(
        sign | static_cast<std::uint16_t>(std::nearbyint(magnitude * 0x1p24F)));
  }
  // Drop 13 bits of the mantissa, rounding to even; a carry moves into the exponent by itself.
  const std::uint32_t absolute = bits & 0x7FFFFFFFU;
  const std::uint32_t rounded = absolute + 0xFFFU + ((absolute >> 13U) & 1U);
  return static_cast<std::uint16_t>(sign | ((rounded - (112U << 23U)) >> 13U));
}

float from_half(std::uint16_t bits) {
  const float sign = (bits & 0x8000U) != 0 ? -1.0F : 1.0F;
  const int exponent = (bits >> 10U) & 0x1F;
  const auto mantissa = static_cast<float>(bits & 0x3FFU);
  if (exponent == 0) return sign * mantissa * 0x1p-24F;
  if (exponent == 31) {
    return mantissa == 0.0F ? sign * std::numeric_limits<float>::infinity()
                            : std::numeric_limits<float>::quiet_NaN();
  }
  return sign * std::ldexp(1.0F + mantissa * 0x1p-10F, exponent - 15);
}

void write_weights(const std::filesystem::path& file, const DetectorWeights& weights) {
  check_values(weights, file.string());
  std::string data;
  Json tensors = Json::array();
  const bool lossless = weights.architecture != DetectorWeights::kArchitecture;
  for (const NamedTensor& tensor : weights.tensors) {
    SEGSIM_CHECK(count_of(tensor.shape) == static_cast<std::int64_t>(tensor.values.size()),
                 tensor.name);
    const bool half =
        tensor.shape.size() >= 2 && (!lossless || is_half_exactly(tensor.values));
    tensors.push_back({{"name", tensor.name},
                       {"shape", tensor.shape},
                       {"type", half ? "float16" : "float32"},
                       {"offset", data.size()}});
    append_values(tensor, half, file.string(), data);
  }
  const Json header = {{"schema", kSchema},
                       {"architecture", weights.architecture},
                       {"width", weights.width},
                       {"input_px", weights.input_px},
                       {"class_names", weights.class_names},
                       {"score_threshold", weights.score_threshold},
                       {"training", Json::parse(weights.training)},
                       {"tensors", tensors},
                       {"data_bytes", data.size()},
                       {"data_sha256", core::sha256_hex(data)}};
  const std::string text = header.dump();
  const auto length = static_cast<std::uint32_t>(text.size());
  core::write_file_atomically(file, [&](std::ostream& out) {
    out.write(kMagic, kMagicBytes);
    out.write(reinterpret_cast<const char*>(&length), kLengthBytes);
    out << text << data;
  });
}

DetectorWeights read_weights(const std::filesystem::path& file) {
  const std::string bytes = core::read_file(file);
  const std::string place = file.string();
  if (bytes.compare(0, kMagicBytes, kMagic) != 0 ||
      bytes.size() < kMagicBytes + kLengthBytes) {
    throw core::InputError::expected(place, "detector weights (" + std::string(kMagic) + ")",
                                     "another kind of file");
  }
  std::uint32_t length = 0;
  std::memcpy(&length, bytes.data() + kMagicBytes, kLengthBytes);
  const std::size_t begin = kMagicBytes + kLengthBytes;
  if (length > bytes.size() - begin) {
    throw core::InputError::expected(place, "a header of " + std::to_string(length) + " bytes",
                                     "a truncated file");
  }
  try {
    return parse(parse_json(bytes.substr(begin, length), place + ": header"),
                 bytes.substr(begin + length), place);
  } catch (const nlohmann::json::exception& error) {
    throw core::InputError(place + ": header: " + error.what());
  }
}

}  // namespace segsim::perception
