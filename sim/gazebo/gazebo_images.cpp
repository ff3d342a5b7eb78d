#include "sim/gazebo/gazebo_images.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <map>

#include "core/error.h"

namespace segsim::sim {
namespace {

static_assert(std::endian::native == std::endian::little, "pixels are sent as they lie");
static_assert(sizeof(core::Rgb8) == 3);

constexpr std::size_t kInstanceIds = std::numeric_limits<std::uint16_t>::max() + 1U;

/// A colour that is far from black and from its neighbours'.
std::array<std::uint8_t, 3> color_of(std::uint16_t label, std::uint16_t count) {
  if (label == 0) return {0, 0, 0};
  std::uint32_t bits = (static_cast<std::uint32_t>(label) << 16U | count) * 0x9E3779B1U;
  bits ^= bits >> 15U;
  bits *= 0x85EBCA77U;
  bits ^= bits >> 13U;
  const auto channel = [&](unsigned shift) {
    return static_cast<std::uint8_t>(48U + ((bits >> shift) & 0xFFU) * 207U / 255U);
  };
  return {channel(0), channel(8), channel(16)};
}

/// Three bytes for each pixel, from class and count. Neighbours are mostly equal, so the last
/// result is kept.
template <class Code>
void encode(const core::Frame& frame, const std::vector<std::uint16_t>& counts,
            const Code& code, std::string& bytes) {
  const std::size_t pixels = frame.semantic.size();
  bytes.resize(3 * pixels);
  const std::uint16_t* semantic = frame.semantic.data();
  const std::uint16_t* instance = frame.instance.data();
  std::uint32_t last = 0;
  std::array<std::uint8_t, 3> value = code(0, 0);
  for (std::size_t i = 0; i < pixels; ++i) {
    const std::uint32_t id = core::panoptic_id(semantic[i], instance[i]);
    if (id != last) {
      value = code(semantic[i], counts[instance[i]]);
      last = id;
    }
    std::memcpy(bytes.data() + 3 * i, value.data(), value.size());
  }
}

}  // namespace

void encode_rgb(const core::Image<core::Rgb8>& rgb, std::string& bytes) {
  bytes.resize(3 * rgb.size());
  std::memcpy(bytes.data(), rgb.data(), bytes.size());
}

void encode_depth(const core::Image<float>& depth_m, double near_m, double far_m,
                  std::string& bytes) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const auto near_f = static_cast<float>(near_m), far_f = static_cast<float>(far_m);
  bytes.resize(sizeof(float) * depth_m.size());
  // In blocks without branches, which the compiler turns into vector instructions.
  constexpr std::size_t kBlock = 256;
  std::array<float, kBlock> block{};
  for (std::size_t start = 0; start < depth_m.size(); start += kBlock) {
    const std::size_t count = std::min(kBlock, depth_m.size() - start);
    std::copy_n(depth_m.data() + start, count, block.begin());
    for (float& depth : block) {
      const float far_enough = depth > near_f ? depth : -kInfinity;
      depth = depth < far_f ? far_enough : kInfinity;  // NaN is not less.
    }
    std::memcpy(bytes.data() + sizeof(float) * start, block.data(), sizeof(float) * count);
  }
}

GazeboLabelEncoder::GazeboLabelEncoder(const core::SceneManifest& scene)
    : counts_(kInstanceIds, 1) {
  for (const core::SceneClass& scene_class : scene.classes) {
    if (scene_class.id > 255) {
      throw core::InputError::expected(scene.name + ": class " + scene_class.name,
                                       "an id up to 255, as Gazebo's labels are",
                                       std::to_string(scene_class.id));
    }
  }
  std::map<std::uint16_t, std::uint16_t> class_of_instance;  // By ascending id.
  for (const core::SceneInstance& instance : scene.instances) {
    class_of_instance[instance.id] = instance.class_id;
  }
  std::map<std::uint16_t, std::uint16_t> seen;
  for (const auto& [id, class_id] : class_of_instance) counts_[id] = ++seen[class_id];
}

void GazeboLabelEncoder::encode_labels(const core::Frame& frame, GazeboLabels coding,
                                       std::string& bytes) const {
  encode(
      frame, counts_,
      [coding](std::uint16_t label, std::uint16_t count) -> std::array<std::uint8_t, 3> {
        const auto byte = static_cast<std::uint8_t>(label);
        if (label == 0 || coding == GazeboLabels::kSemantic) return {byte, byte, byte};
        return {static_cast<std::uint8_t>(count & 0xFFU),
                static_cast<std::uint8_t>(count >> 8U), byte};
      },
      bytes);
}

void GazeboLabelEncoder::encode_colors(const core::Frame& frame, GazeboLabels coding,
                                       std::string& bytes) const {
  encode(
      frame, counts_,
      [coding](std::uint16_t label, std::uint16_t count) {
        return color_of(label, coding == GazeboLabels::kSemantic ? std::uint16_t{0} : count);
      },
      bytes);
}

}  // namespace segsim::sim
