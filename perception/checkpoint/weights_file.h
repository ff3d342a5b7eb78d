#pragma once

/// @file
/// Weights on disk, readable without torch:
///
///     8 bytes   "SEGSIMW1"
///     4 bytes   length of the header, little-endian
///     header    JSON: schema, architecture, width, input_px, class_names, score_threshold,
///               training, tensors [{name, shape, type, offset}], data_bytes, data_sha256
///     data      raw little-endian tensors, row-major, one after the other
///
/// Tensors of two or more dimensions are stored as float16, others (biases, batch-norm
/// statistics: few, but of wide range) as float32. A 0.45 M parameter detector takes 0.9 MB.
/// Networks of others are stored without loss: float16 only where every value is one.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace segsim::perception {

struct NamedTensor {
  std::string name;
  std::vector<std::int64_t> shape;
  std::vector<float> values;  ///< Row-major; as many as the shape says.
};

struct DetectorWeights {
  static constexpr const char* kArchitecture =
      "csp-pan-dfl/1";  ///< internal/network/network.h
  static constexpr const char* kCenterNet =
      "mobilenetv3-centernet/1";  ///< internal/centernet/

  std::string architecture = kArchitecture;  ///< Or kCenterNet, or one of yolov13_scale.h.
  double width = 0.5;                        ///< Channel multiplier.
  int input_px = 256;                        ///< Side of the square input.
  std::vector<std::string> class_names;
  float score_threshold = 0.25F;
  std::string training = "{}";  ///< JSON object: recipe, seed, data (lineage.h).
  std::vector<NamedTensor> tensors;
};

/// @throws core::InputError if a value does not fit float16 where it shall be one, or is not
/// finite, or the place cannot be written.
void write_weights(const std::filesystem::path& file, const DetectorWeights& weights);

/// @throws core::InputError if the file is truncated, altered, or of another schema, also in
/// its record of what it was trained on.
[[nodiscard]] DetectorWeights read_weights(const std::filesystem::path& file);

/// One line that says how the tensors differ from those wanted (names and shapes only): "" if
/// they do not. At most three examples of each kind.
[[nodiscard]] std::string describe_difference(const std::vector<NamedTensor>& found,
                                              const std::vector<NamedTensor>& wanted);

/// "[2, 3]"
[[nodiscard]] std::string shape_text(const std::vector<std::int64_t>& shape);

/// "<what> a, b, c and 4 more; ", "" for none.
[[nodiscard]] std::string list_some(const std::string& what,
                                    const std::vector<std::string>& names);

/// IEEE 754 binary16, round to nearest even; overflow gives infinity.
[[nodiscard]] std::uint16_t to_half(float value);
[[nodiscard]] float from_half(std::uint16_t bits);

}  // namespace segsim::perception
