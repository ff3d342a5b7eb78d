// The reading half of exr_io.h.
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include <OpenEXR/ImfStringAttribute.h>

#include "renderer/files/exr_io.h"
#include "renderer/files/internal/exr_camera.h"
#include "renderer/files/internal/exr_channels.h"
#include "renderer/files/internal/exr_file.h"

namespace segsim::renderer {
namespace {

using core::Image;
using internal::ExrInput;

constexpr const char* kView = "an OpenEXR image of a rendered view";

std::uint8_t srgb_from_linear(float linear) {
  const float l = linear > 0.0F ? std::min(linear, 1.0F) : 0.0F;  // NaN becomes 0.
  const float s = l <= 0.0031308F ? 12.92F * l : 1.055F * std::pow(l, 1.0F / 2.4F) - 0.055F;
  return static_cast<std::uint8_t>(std::lround(255.0F * s));
}

/// For every half, by its bits.
const std::vector<std::uint8_t>& srgb_of_half() {
  static const std::vector<std::uint8_t> kTable = [] {
    std::vector<std::uint8_t> table(65536);
    for (unsigned bits = 0; bits < 65536; ++bits) {
      half value;
      value.setBits(static_cast<std::uint16_t>(bits));
      table[bits] = srgb_from_linear(value);
    }
    return table;
  }();
  return kTable;
}

template <class Pixel>
void resize(const ExrInput& input, Image<Pixel>& image) {
  image.resize(input.width_px(), input.height_px());
}

void want_floats(ExrInput& input, const std::string& channel, Image<float>& image) {
  if (!input.has(channel)) return;
  resize(input, image);
  input.want(channel, image.data());
}

/// All channels of an image, or none if the file has none of them.
template <class Channels, class Pixel>
void want_vectors(ExrInput& input, const Channels& channels, Image<Pixel>& image) {
  if (std::none_of(channels.begin(), channels.end(),
                   [&](const std::string& channel) { return input.has(channel); })) {
    return;
  }
  resize(input, image);
  float* first = reinterpret_cast<float*>(image.data());
  for (const std::string& channel : channels) input.want(channel, first++, channels.size());
}

template <std::size_t kSize>
std::array<std::string, kSize> feature_channels(const std::string& image) {
  std::array<std::string, kSize> channels;
  for (std::size_t k = 0; k < kSize; ++k) {
    channels[k] = internal::feature_channel(image, static_cast<int>(k));
  }
  return channels;
}

/// Channels whose type in the file is not that in the frame.
struct Raw {
  std::vector<half> rgb;
  std::vector<unsigned int> semantic, instance;
};

void want_raw(ExrInput& input, Raw& raw) {
  const std::size_t pixels =
      static_cast<std::size_t>(input.width_px()) * static_cast<std::size_t>(input.height_px());
  if (input.has("R") || input.has("G") || input.has("B")) {
    raw.rgb.resize(3 * pixels);
    input.want("R", raw.rgb.data(), 3);
    input.want("G", raw.rgb.data() + 1, 3);
    input.want("B", raw.rgb.data() + 2, 3);
  }
  const auto want_ids = [&](const char* channel, std::vector<unsigned int>& ids) {
    if (!input.has(channel)) return;
    ids.resize(pixels);
    input.want(channel, ids.data());
  };
  want_ids("semantic", raw.semantic);
  want_ids("instance", raw.instance);
}

Image<core::Rgb8> rgb_of(const ExrInput& input, const std::vector<half>& values) {
  Image<core::Rgb8> rgb;
  if (values.empty()) return rgb;
  resize(input, rgb);
  const std::vector<std::uint8_t>& srgb = srgb_of_half();
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    rgb.pixels()[i] = {srgb[values[3 * i].bits()], srgb[values[3 * i + 1].bits()],
                       srgb[values[3 * i + 2].bits()]};
  }
  return rgb;
}

Image<std::uint16_t> ids_of(const ExrInput& input, const std::string& channel,
                            const std::vector<unsigned int>& values) {
  Image<std::uint16_t> ids;
  if (values.empty()) return ids;
  resize(input, ids);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (values[i] > 65535) {
      input.fail("channel " + channel + " with ids from 0 to 65535",
                 std::to_string(values[i]));
    }
    ids.pixels()[i] = static_cast<std::uint16_t>(values[i]);
  }
  return ids;
}

std::string text_of(const ExrInput& input, const std::string& name) {
  const auto* found = input.find<Imf::StringAttribute>(name);
  return found == nullptr ? std::string() : found->value();
}

std::optional<core::TimeNs> time_of(const ExrInput& input) {
  const std::string text = text_of(input, "time_ns");
  if (text.empty()) return std::nullopt;
  core::TimeNs time_ns = 0;
  const char* end = text.data() + text.size();
  const auto [parsed, error] = std::from_chars(text.data(), end, time_ns);
  if (error != std::errc() || parsed != end) input.fail("time_ns, an integer", text);
  return time_ns;
}

std::shared_ptr<const SceneNames> names_of(const ExrInput& input) {
  const std::string classes = text_of(input, internal::kClassNames);
  const std::string instances = text_of(input, internal::kInstanceNames);
  if (classes.empty() && instances.empty()) return nullptr;
  auto names = std::make_shared<SceneNames>();
  if (!classes.empty()) {
    names->classes = IdNames::from_legend("class", classes, input.place());
  }
  if (!instances.empty()) {
    names->instances = IdNames::from_legend("instance", instances, input.place());
  }
  return names;
}

/// The manifest of a layer. Its key is any text: programs need not derive it as we do.
std::string manifest_of(const ExrInput& input, const std::string& layer) {
  constexpr std::string_view kPrefix = "cryptomatte/", kSuffix = "/name";
  for (const std::string& attribute : input.attributes_with_prefix(std::string(kPrefix))) {
    if (!attribute.ends_with(kSuffix) || text_of(input, attribute) != layer) continue;
    const std::string stem = attribute.substr(0, attribute.size() - kSuffix.size());
    return input.attribute<Imf::StringAttribute>(stem + "/manifest");
  }
  input.fail("Cryptomatte attributes of layer " + layer, "none");
}

}  // namespace

core::Frame read_frame_exr(const std::filesystem::path& file) {
  core::Frame frame;
  internal::guard_exr(file, kView, [&] {
    ExrInput input(file);
    frame.intrinsics = internal::exr_intrinsics(input);
    frame.T_world_camera = internal::exr_pose(input);
    Raw raw;
    want_raw(input, raw);
    want_floats(input, "A", frame.alpha);
    want_floats(input, "Z", frame.depth_m);
    want_floats(input, "confidence", frame.confidence);
    want_floats(input, "instance_confidence", frame.instance_confidence);
    want_vectors(input, internal::vector_channels("N"), frame.normal);
    want_vectors(input, internal::vector_channels("depth_normal"), frame.depth_normal);
    want_vectors(input, feature_channels<core::kSemanticFeatureSize>("semantic_feature"),
                 frame.semantic_feature);
    want_vectors(input, feature_channels<core::kInstanceFeatureSize>("instance_feature"),
                 frame.instance_feature);
    if (!input.wants_any()) input.fail("channels of a rendered view", "none of them");
    input.read();
    frame.rgb = rgb_of(input, raw.rgb);
    frame.semantic = ids_of(input, "semantic", raw.semantic);
    frame.instance = ids_of(input, "instance", raw.instance);
  });
  return frame;
}

FrameInfo read_frame_info_exr(const std::filesystem::path& file) {
  FrameInfo info;
  internal::guard_exr(file, kView, [&] {
    const ExrInput input(file);
    (void)internal::exr_intrinsics(input);  // Refuses other programs' files.
    info.time_ns = time_of(input);
    info.scene = text_of(input, "scene");
    info.scene_sha256 = text_of(input, "scene_sha256");
    info.names = names_of(input);
    info.software = text_of(input, "software");
  });
  return info;
}

CryptomatteImage read_cryptomatte_exr(const std::filesystem::path& file,
                                      const std::string& layer) {
  CryptomatteImage image;
  internal::guard_exr(file, "an OpenEXR image with Cryptomatte layers", [&] {
    ExrInput input(file, layer + "00.R");
    image.names = parse_cryptomatte_manifest(manifest_of(input, layer), input.place());
    std::vector<float> ids;
    resize(input, image.id);
    resize(input, image.coverage);
    ids.resize(image.id.size());
    input.want(layer + "00.R", ids.data());
    input.want(layer + "00.G", image.coverage.data());
    input.read();
    std::memcpy(image.id.data(), ids.data(), ids.size() * sizeof(float));
  });
  return image;
}

Image<float> read_depth_exr(const std::filesystem::path& file) {
  Image<float> depth_m;
  internal::guard_exr(file, "an OpenEXR image", [&] {
    ExrInput input(file, "Z");
    resize(input, depth_m);
    input.want("Z", depth_m.data());
    input.read();
  });
  return depth_m;
}

}  // namespace segsim::renderer
