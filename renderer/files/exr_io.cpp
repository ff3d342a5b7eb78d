#include "renderer/files/exr_io.h"

#include <array>
#include <bitset>
#include <cmath>
#include <cstring>
#include <vector>

#include <OpenEXR/ImfStringAttribute.h>

#include "core/check.h"
#include "core/version.h"
#include "renderer/files/internal/exr_camera.h"
#include "renderer/files/internal/exr_channels.h"
#include "renderer/files/internal/exr_file.h"

namespace segsim::renderer {
namespace {

using core::Image;
using internal::ExrOutput;
using internal::kCryptoInstance;
using internal::kCryptoSemantic;

float linear_from_srgb(int byte) {
  const float s = static_cast<float>(byte) / 255.0F;
  return s <= 0.04045F ? s / 12.92F : std::pow((s + 0.055F) / 1.055F, 2.4F);
}

std::vector<half> linear_halves(const Image<core::Rgb8>& rgb) {
  static const std::array<half, 256> kLinear = [] {
    std::array<half, 256> table;
    for (int byte = 0; byte < 256; ++byte) table[byte] = half(linear_from_srgb(byte));
    return table;
  }();
  std::vector<half> values;
  values.reserve(3 * rgb.size());
  for (const core::Rgb8& pixel : rgb.pixels()) {
    for (const std::uint8_t byte : {pixel.r, pixel.g, pixel.b})
      values.push_back(kLinear[byte]);
  }
  return values;
}

/// The floats that images of floats, vectors and features consist of.
template <class Pixel>
std::vector<half> halves(const Image<Pixel>& image) {
  static_assert(sizeof(Pixel) % sizeof(float) == 0);
  std::vector<half> values;
  if (image.empty()) return values;
  // NOLINTNEXTLINE(bugprone-sizeof-expression): a pixel may be a float.
  constexpr std::size_t kPerPixel = sizeof(Pixel) / sizeof(float);
  values.reserve(kPerPixel * image.size());
  for (const Pixel& pixel : image.pixels()) {
    std::array<float, kPerPixel> numbers;
    std::memcpy(numbers.data(), &pixel, sizeof pixel);
    for (const float number : numbers) values.emplace_back(number);
  }
  return values;
}

std::vector<unsigned int> widened(const Image<std::uint16_t>& ids) {
  return {ids.pixels().begin(), ids.pixels().end()};
}

/// One rank per pixel: the label, wholly.
struct CryptomatteLayer {
  std::string name;
  IdNames names;
  std::vector<float> id, coverage;

  CryptomatteLayer(std::string layer, IdNames all_names, const Image<std::uint16_t>& ids)
      : name(std::move(layer)), names(std::move(all_names)) {
    std::bitset<65536> present;
    for (const std::uint16_t label : ids.pixels()) present.set(label);
    std::vector<float> float_of(present.size(), 0.0F);
    for (std::size_t label = 1; label < present.size(); ++label) {
      if (!present[label]) continue;
      names.add_if_missing(static_cast<std::uint16_t>(label));
      const std::uint32_t bits = names.cryptomatte(static_cast<std::uint16_t>(label));
      std::memcpy(&float_of[label], &bits, sizeof bits);
    }
    id.reserve(ids.size());
    coverage.reserve(ids.size());
    for (const std::uint16_t label : ids.pixels()) {
      id.push_back(float_of[label]);
      coverage.push_back(label == 0 ? 0.0F : 1.0F);
    }
  }
};

/// What goes to a file, in the channels' types.
struct Converted {
  std::vector<half> rgb, alpha, normal, depth_normal, confidence, instance_confidence,
      semantic_feature, instance_feature;
  std::vector<unsigned int> semantic, instance;
  std::vector<CryptomatteLayer> layers;

  Converted(const core::Frame& frame, const FrameInfo& info)
      : rgb(linear_halves(frame.rgb)),
        alpha(halves(frame.alpha)),
        normal(halves(frame.normal)),
        depth_normal(halves(frame.depth_normal)),
        confidence(halves(frame.confidence)),
        instance_confidence(halves(frame.instance_confidence)),
        semantic_feature(halves(frame.semantic_feature)),
        instance_feature(halves(frame.instance_feature)),
        semantic(widened(frame.semantic)),
        instance(widened(frame.instance)) {
    const SceneNames names = info.names == nullptr ? SceneNames() : *info.names;
    if (!semantic.empty()) layers.emplace_back(kCryptoSemantic, names.classes, frame.semantic);
    if (!instance.empty())
      layers.emplace_back(kCryptoInstance, names.instances, frame.instance);
  }
};

void add_vectors(ExrOutput::Part& part, const std::string& image,
                 const std::vector<half>& values) {
  if (values.empty()) return;
  const std::array<std::string, 3> channels = internal::vector_channels(image);
  for (std::size_t k = 0; k < 3; ++k) part.add(channels[k], values.data() + k, 3);
}

void add_features(ExrOutput::Part& part, const char* image, int size,
                  const std::vector<half>& values) {
  if (values.empty()) return;
  for (int k = 0; k < size; ++k) {
    part.add(internal::feature_channel(image, k), values.data() + k,
             static_cast<std::size_t>(size));
  }
}

void add_ids(ExrOutput::Part& part, const Converted& from) {
  if (!from.semantic.empty()) part.add("semantic", from.semantic.data());
  if (!from.instance.empty()) part.add("instance", from.instance.data());
  if (!from.confidence.empty()) part.add("confidence", from.confidence.data());
  if (!from.instance_confidence.empty()) {
    part.add("instance_confidence", from.instance_confidence.data());
  }
  for (const CryptomatteLayer& layer : from.layers) {
    part.add(layer.name + "00.R", layer.id.data());
    part.add(layer.name + "00.G", layer.coverage.data());
    part.declare(layer.name + "00.B", Imf::FLOAT);
    part.declare(layer.name + "00.A", Imf::FLOAT);
  }
}

void add_channels(ExrOutput& out, const core::Frame& frame, const Converted& from) {
  ExrOutput::Part& beauty = out.part("beauty");
  if (!from.rgb.empty()) {
    beauty.add("R", from.rgb.data(), 3);
    beauty.add("G", from.rgb.data() + 1, 3);
    beauty.add("B", from.rgb.data() + 2, 3);
  }
  if (!from.alpha.empty()) beauty.add("A", from.alpha.data());

  ExrOutput::Part& geometry = out.part("geometry");
  if (!frame.depth_m.empty()) geometry.add("Z", frame.depth_m.data());
  add_vectors(geometry, "N", from.normal);
  add_vectors(geometry, "depth_normal", from.depth_normal);

  add_ids(out.part("ids"), from);

  ExrOutput::Part& features = out.part("features");
  add_features(features, "semantic_feature", core::kSemanticFeatureSize,
               from.semantic_feature);
  add_features(features, "instance_feature", core::kInstanceFeatureSize,
               from.instance_feature);
}

void set_text(Imf::Header& header, const std::string& name, const std::string& text) {
  if (!text.empty()) header.insert(name, Imf::StringAttribute(text));
}

void describe(const core::Frame& frame, const FrameInfo& info, Imf::Header& header) {
  internal::set_exr_camera(frame.intrinsics, frame.T_world_camera, header);
  // OpenEXR has no 64-bit integers.
  if (info.time_ns) set_text(header, "time_ns", std::to_string(*info.time_ns));
  set_text(header, "scene", info.scene);
  set_text(header, "scene_sha256", info.scene_sha256);
  set_text(header, "software", std::string("segsim ") + core::version());
}

void describe_ids(const Converted& from, Imf::Header& header) {
  for (const CryptomatteLayer& layer : from.layers) {
    const std::string key = "cryptomatte/" + cryptomatte_key(layer.name) + "/";
    set_text(header, key + "name", layer.name);
    set_text(header, key + "hash", "MurmurHash3_32");
    set_text(header, key + "conversion", "uint32_to_float32");
    set_text(header, key + "manifest", layer.names.manifest_json());
    set_text(header,
             layer.name == kCryptoSemantic ? internal::kClassNames : internal::kInstanceNames,
             layer.names.legend_json());
  }
}

template <class Pixel>
void check_size(const core::Frame& frame, const Image<Pixel>& image, const char* name) {
  if (image.empty()) return;
  SEGSIM_CHECK(image.width_px() == frame.intrinsics.width_px &&
                   image.height_px() == frame.intrinsics.height_px,
               name);
}

void check_frame(const core::Frame& frame) {
  SEGSIM_CHECK(frame.intrinsics.width_px > 0 && frame.intrinsics.height_px > 0, "empty frame");
  SEGSIM_CHECK(frame.intrinsics.fx_px > 0.0 && frame.intrinsics.fy_px > 0.0, "focal length");
  check_size(frame, frame.rgb, "rgb");
  check_size(frame, frame.alpha, "alpha");
  check_size(frame, frame.depth_m, "depth_m");
  check_size(frame, frame.normal, "normal");
  check_size(frame, frame.depth_normal, "depth_normal");
  check_size(frame, frame.semantic, "semantic");
  check_size(frame, frame.instance, "instance");
  check_size(frame, frame.confidence, "confidence");
  check_size(frame, frame.instance_confidence, "instance_confidence");
  check_size(frame, frame.semantic_feature, "semantic_feature");
  check_size(frame, frame.instance_feature, "instance_feature");
}

}  // namespace

void write_frame_exr(const std::filesystem::path& file, const core::Frame& frame,
                     const FrameInfo& info, const ExrOptions& options) {
  check_frame(frame);
  const Converted converted(frame, info);
  ExrOutput out(frame.intrinsics.width_px, frame.intrinsics.height_px,
                internal::exr_pixel_aspect_ratio(frame.intrinsics), options);
  add_channels(out, frame, converted);
  const std::vector<ExrOutput::Part*> parts = out.parts();
  for (ExrOutput::Part* part : parts) {
    describe(frame, info, part->header());
    // Also in the first part: Cryptomatte plugins of compositors look only there
    // (Psyop/Cryptomatte, issues 137 and 145).
    if (part == parts.front() || part->header().name() == "ids") {
      describe_ids(converted, part->header());
    }
  }
  out.write(file);
}

}  // namespace segsim::renderer
