#include "renderer/exr_io.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <functional>
#include <type_traits>

#include <ImathMatrix.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfMatrixAttribute.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <glm/gtc/quaternion.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"

namespace segsim::renderer {
namespace {

using core::Image;
using core::InputError;

constexpr const char* kFrames =
    "camera: x right, y down, z forward; world: x east, y north, z up; metres";

float linear_from_srgb(std::uint8_t byte) {
  const float s = static_cast<float>(byte) / 255.0F;
  return s <= 0.04045F ? s / 12.92F : std::pow((s + 0.055F) / 1.055F, 2.4F);
}

std::uint8_t srgb_from_linear(float linear) {
  const float l = std::clamp(linear, 0.0F, 1.0F);
  const float s = l <= 0.0031308F ? 12.92F * l : 1.055F * std::pow(l, 1.0F / 2.4F) - 0.055F;
  return static_cast<std::uint8_t>(std::lround(255.0F * s));
}

template <class Value>
constexpr Imf::PixelType pixel_type() {
  if constexpr (std::is_same_v<Value, half>) {
    return Imf::HALF;
  } else if constexpr (std::is_same_v<Value, float>) {
    return Imf::FLOAT;
  } else {
    static_assert(std::is_same_v<Value, unsigned int>);
    return Imf::UINT;
  }
}

/// A channel in memory, one value every `stride` of them. OpenEXR takes writable pointers
/// for output too, but only reads through them.
template <class Value>
Imf::Slice slice(const Value* first, int width_px, std::size_t stride = 1) {
  const std::size_t step = sizeof(Value) * stride;
  // The library's interface: bytes of a pixel at first + x * step + y * step * width.
  char* base = const_cast<char*>(reinterpret_cast<const char*>(first));
  return {pixel_type<Value>(), base, step, step * static_cast<std::size_t>(width_px)};
}

/// Calls `action` and turns the library's exceptions into ours.
void guarded(const std::filesystem::path& file, const char* expected,
             const std::function<void()>& action) {
  try {
    action();
  } catch (const InputError&) {
    throw;
  } catch (const core::ContractViolation&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError::expected(file.string(), expected, error.what());
  }
}

/// Channels on their way to a file, with the buffers that they point to.
class Writer {
 public:
  Writer(int width_px, int height_px) : header_(width_px, height_px), width_px_(width_px) {
    header_.compression() = Imf::ZIP_COMPRESSION;
  }

  template <class Value>
  void add(const char* name, const Value* first, std::size_t stride = 1) {
    header_.channels().insert(name, Imf::Channel(pixel_type<Value>()));
    buffer_.insert(name, slice(first, width_px_, stride));
  }
  Imf::Header& header() { return header_; }

  void write(const std::filesystem::path& file) {
    core::write_via_temporary(file, [&](const std::filesystem::path& temporary) {
      guarded(file, "a place to write an OpenEXR image", [&] {
        Imf::OutputFile out(temporary.c_str(), header_, 1);
        out.setFrameBuffer(buffer_);
        out.writePixels(header_.dataWindow().max.y - header_.dataWindow().min.y + 1);
      });
    });
  }

 private:
  Imf::Header header_;
  Imf::FrameBuffer buffer_;
  int width_px_;
};

/// An open file whose channels are read one set at a time.
class Reader {
 public:
  explicit Reader(const std::filesystem::path& file)
      : place_(file.string()), file_(file.c_str(), 1) {
    const Imath::Box2i& window = file_.header().dataWindow();
    width_px_ = window.max.x - window.min.x + 1;
    height_px_ = window.max.y - window.min.y + 1;
    first_ = static_cast<std::ptrdiff_t>(window.min.y) * width_px_ + window.min.x;
  }

  [[nodiscard]] int width_px() const { return width_px_; }
  [[nodiscard]] int height_px() const { return height_px_; }
  [[nodiscard]] bool has(const char* channel) const {
    return file_.header().channels().findChannel(channel) != nullptr;
  }
  /// @throws core::InputError if the file has no such channel.
  template <class Value>
  [[nodiscard]] Image<Value> channel(const char* name) {
    if (!has(name)) {
      throw InputError::expected(place_, std::string("channel ") + name, "none");
    }
    Image<Value> image(width_px_, height_px_);
    Imf::FrameBuffer buffer;
    buffer.insert(name, slice(image.data() - first_, width_px_));
    file_.setFrameBuffer(buffer);
    file_.readPixels(file_.header().dataWindow().min.y, file_.header().dataWindow().max.y);
    return image;
  }
  template <class Attribute>
  [[nodiscard]] auto attribute(const char* name) const {
    const auto* found = file_.header().findTypedAttribute<Attribute>(name);
    if (found == nullptr) {
      throw InputError::expected(place_, std::string("attribute ") + name, "none");
    }
    return found->value();
  }

 private:
  std::string place_;
  Imf::InputFile file_;
  int width_px_ = 0, height_px_ = 0;
  std::ptrdiff_t first_ = 0;
};

Imath::M44f matrix_of(const core::CameraPose& T_world_camera) {
  const glm::dmat3 R = glm::mat3_cast(T_world_camera.rotation());
  const glm::dvec3& p = T_world_camera.translation_m();
  Imath::M44f matrix;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      matrix[row][column] = static_cast<float>(R[column][row]);
    }
    matrix[row][3] = static_cast<float>(p[row]);
  }
  return matrix;
}

core::CameraPose pose_of(const Imath::M44f& matrix) {
  glm::dmat3 R(1.0);
  glm::dvec3 p(0.0);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) R[column][row] = matrix[row][column];
    p[row] = matrix[row][3];
  }
  return {glm::normalize(glm::quat_cast(R)), p};
}

void set_camera(const core::Frame& frame, Imf::Header& header) {
  const core::CameraIntrinsics& c = frame.intrinsics;
  header.insert("fx_px", Imf::DoubleAttribute(c.fx_px));
  header.insert("fy_px", Imf::DoubleAttribute(c.fy_px));
  header.insert("cx_px", Imf::DoubleAttribute(c.cx_px));
  header.insert("cy_px", Imf::DoubleAttribute(c.cy_px));
  header.insert("T_world_camera", Imf::M44fAttribute(matrix_of(frame.T_world_camera)));
  header.insert("frames", Imf::StringAttribute(kFrames));
}

std::vector<half> linear_halves(const Image<core::Rgb8>& rgb) {
  std::vector<half> values;
  values.reserve(3 * rgb.size());
  for (const core::Rgb8& pixel : rgb.pixels()) {
    for (const std::uint8_t byte : {pixel.r, pixel.g, pixel.b}) {
      values.emplace_back(linear_from_srgb(byte));
    }
  }
  return values;
}

std::vector<unsigned int> widened(const Image<std::uint16_t>& ids) {
  return {ids.pixels().begin(), ids.pixels().end()};
}

Image<std::uint16_t> narrowed(const Image<unsigned int>& ids) {
  Image<std::uint16_t> image(ids.width_px(), ids.height_px());
  std::transform(ids.pixels().begin(), ids.pixels().end(), image.pixels().begin(),
                 [](unsigned int id) { return static_cast<std::uint16_t>(id); });
  return image;
}

template <class Pixel>
void check_size(const core::Frame& frame, const Image<Pixel>& image, const char* name) {
  if (image.empty()) return;
  SEGSIM_CHECK(image.width_px() == frame.intrinsics.width_px &&
                   image.height_px() == frame.intrinsics.height_px,
               name);
}

void check_sizes(const core::Frame& frame) {
  SEGSIM_CHECK(frame.intrinsics.width_px > 0 && frame.intrinsics.height_px > 0, "empty frame");
  check_size(frame, frame.rgb, "rgb");
  check_size(frame, frame.alpha, "alpha");
  check_size(frame, frame.depth_m, "depth_m");
  check_size(frame, frame.normal, "normal");
  check_size(frame, frame.semantic, "semantic");
  check_size(frame, frame.instance, "instance");
  check_size(frame, frame.confidence, "confidence");
}

Image<core::Rgb8> read_rgb(Reader& reader) {
  const Image<float> r = reader.channel<float>("R");
  const Image<float> g = reader.channel<float>("G");
  const Image<float> b = reader.channel<float>("B");
  Image<core::Rgb8> rgb(r.width_px(), r.height_px());
  for (std::size_t i = 0; i < rgb.size(); ++i) {
    rgb.pixels()[i] = {srgb_from_linear(r.pixels()[i]), srgb_from_linear(g.pixels()[i]),
                       srgb_from_linear(b.pixels()[i])};
  }
  return rgb;
}

Image<glm::vec3> read_normal(Reader& reader) {
  const Image<float> x = reader.channel<float>("N.X");
  const Image<float> y = reader.channel<float>("N.Y");
  const Image<float> z = reader.channel<float>("N.Z");
  Image<glm::vec3> normal(x.width_px(), x.height_px());
  for (std::size_t i = 0; i < normal.size(); ++i) {
    normal.pixels()[i] = {x.pixels()[i], y.pixels()[i], z.pixels()[i]};
  }
  return normal;
}

}  // namespace

void write_frame_exr(const std::filesystem::path& file, const core::Frame& frame) {
  check_sizes(frame);
  Writer writer(frame.intrinsics.width_px, frame.intrinsics.height_px);
  set_camera(frame, writer.header());
  const std::vector<half> rgb = linear_halves(frame.rgb);
  const std::vector<unsigned int> semantic = widened(frame.semantic);
  const std::vector<unsigned int> instance = widened(frame.instance);
  if (!rgb.empty()) {
    writer.add("R", rgb.data(), 3);
    writer.add("G", rgb.data() + 1, 3);
    writer.add("B", rgb.data() + 2, 3);
  }
  if (!frame.alpha.empty()) writer.add("A", frame.alpha.data());
  if (!frame.depth_m.empty()) writer.add("Z", frame.depth_m.data());
  if (!frame.normal.empty()) {
    writer.add("N.X", &frame.normal.data()->x, 3);
    writer.add("N.Y", &frame.normal.data()->y, 3);
    writer.add("N.Z", &frame.normal.data()->z, 3);
  }
  if (!semantic.empty()) writer.add("semantic", semantic.data());
  if (!instance.empty()) writer.add("instance", instance.data());
  if (!frame.confidence.empty()) writer.add("confidence", frame.confidence.data());
  writer.write(file);
}

core::Frame read_frame_exr(const std::filesystem::path& file) {
  core::Frame frame;
  guarded(file, "an OpenEXR image of a rendered view", [&] {
    Reader reader(file);
    frame.intrinsics = {reader.width_px(),
                        reader.height_px(),
                        reader.attribute<Imf::DoubleAttribute>("fx_px"),
                        reader.attribute<Imf::DoubleAttribute>("fy_px"),
                        reader.attribute<Imf::DoubleAttribute>("cx_px"),
                        reader.attribute<Imf::DoubleAttribute>("cy_px")};
    frame.T_world_camera = pose_of(reader.attribute<Imf::M44fAttribute>("T_world_camera"));
    if (reader.has("R")) frame.rgb = read_rgb(reader);
    if (reader.has("A")) frame.alpha = reader.channel<float>("A");
    if (reader.has("Z")) frame.depth_m = reader.channel<float>("Z");
    if (reader.has("N.X")) frame.normal = read_normal(reader);
    if (reader.has("semantic")) {
      frame.semantic = narrowed(reader.channel<unsigned int>("semantic"));
    }
    if (reader.has("instance")) {
      frame.instance = narrowed(reader.channel<unsigned int>("instance"));
    }
    if (reader.has("confidence")) frame.confidence = reader.channel<float>("confidence");
  });
  return frame;
}

void write_depth_exr(const std::filesystem::path& file, const Image<float>& depth_m) {
  SEGSIM_CHECK(!depth_m.empty(), "empty depth image");
  Writer writer(depth_m.width_px(), depth_m.height_px());
  writer.add("Z", depth_m.data());
  writer.write(file);
}

Image<float> read_depth_exr(const std::filesystem::path& file) {
  Image<float> depth_m;
  guarded(file, "an OpenEXR image", [&] {
    Reader reader(file);
    depth_m = reader.channel<float>("Z");
  });
  return depth_m;
}

}  // namespace segsim::renderer
