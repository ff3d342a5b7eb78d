#include "renderer/files/exr_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <set>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfVersion.h>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/file_io.h"
#include "core/version.h"
#include "tests/renderer/files/exr_folder.h"

namespace segsim::renderer {
namespace {

using renderer::testing::flat_info;
using renderer::testing::full_frame;
using segsim::tests::input_error_of;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class ExrIo : public renderer::testing::ExrFolder {};

/// 11 significant bits: half a unit in the last place, and subnormals below 6e-5.
void expect_half_precision(const std::vector<float>& a, const std::vector<float>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_LE(std::abs(a[i] - b[i]), std::abs(a[i]) / 2048.0F + 3e-8F) << i;
  }
}

/// The numbers of an image of vectors.
template <class Pixel>
std::vector<float> numbers(const core::Image<Pixel>& image) {
  std::vector<float> values(image.size() * sizeof(Pixel) / sizeof(float));
  std::memcpy(values.data(), image.data(), values.size() * sizeof(float));
  return values;
}

class ExrRoundTrip : public ExrIo, public ::testing::WithParamInterface<ExrOptions> {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) / "exr_round_trip";
    fs::remove_all(folder_);
    file_ = folder_ / "a" / "b" / "view.exr";
  }
};

TEST_P(ExrRoundTrip, EveryImageAndAttributeComesBack) {
  const core::Frame frame = full_frame();
  write_frame_exr(file_, frame, flat_info(), GetParam());
  const core::Frame back = read_frame_exr(file_);
  EXPECT_EQ(back.rgb.pixels(), frame.rgb.pixels());
  EXPECT_EQ(back.semantic.pixels(), frame.semantic.pixels());
  EXPECT_EQ(back.instance.pixels(), frame.instance.pixels());
  for (std::size_t i = 0; i < frame.depth_m.size(); ++i) {
    const float a = frame.depth_m.pixels()[i], b = back.depth_m.pixels()[i];
    EXPECT_TRUE(a == b || (std::isnan(a) && std::isnan(b))) << i;
    const glm::vec3 n = frame.normal.pixels()[i], m = back.normal.pixels()[i];
    EXPECT_LT(std::atan2(glm::length(glm::cross(n, m)), glm::dot(n, m)), 0.03 * 3.1416 / 180);
  }
  expect_half_precision(frame.alpha.pixels(), back.alpha.pixels());
  expect_half_precision(frame.confidence.pixels(), back.confidence.pixels());
  expect_half_precision(frame.instance_confidence.pixels(), back.instance_confidence.pixels());
  expect_half_precision(numbers(frame.normal), numbers(back.normal));
  expect_half_precision(numbers(frame.depth_normal), numbers(back.depth_normal));
  expect_half_precision(numbers(frame.semantic_feature), numbers(back.semantic_feature));
  expect_half_precision(numbers(frame.instance_feature), numbers(back.instance_feature));

  EXPECT_EQ(back.intrinsics.width_px, 16);
  EXPECT_EQ(back.intrinsics.height_px, 16);
  EXPECT_EQ(back.intrinsics.fx_px, 20.5);
  EXPECT_EQ(back.intrinsics.fy_px, 21.25);
  EXPECT_EQ(back.intrinsics.cx_px, 8.125);
  EXPECT_EQ(back.intrinsics.cy_px, 7.75);
  const core::Point<core::frame::Camera> p{{0.3, -0.2, 2.0}};
  EXPECT_LT(glm::length((back.T_world_camera * p).xyz_m - (frame.T_world_camera * p).xyz_m),
            1e-6);

  const FrameInfo info = read_frame_info_exr(file_);
  EXPECT_EQ(info.time_ns, flat_info().time_ns);
  EXPECT_EQ(info.scene, "flat");
  EXPECT_EQ(info.scene_sha256, "0123abcd");
  EXPECT_EQ(info.software, std::string("segsim ") + core::version());
  ASSERT_NE(info.names, nullptr);
  EXPECT_EQ(info.names->classes.name(2), "couch");
  EXPECT_EQ(info.names->classes.name(77), "class 77");  // In the image, not in the scene.
  EXPECT_EQ(info.names->instances.name(257), "couch_a");
}

INSTANTIATE_TEST_SUITE_P(
    LayoutsAndCompressions, ExrRoundTrip,
    ::testing::Values(ExrOptions{ExrLayout::kMultiPart, ExrCompression::kZip, 1},
                      ExrOptions{ExrLayout::kMultiPart, ExrCompression::kZips, 9},
                      ExrOptions{ExrLayout::kMultiPart, ExrCompression::kPiz, 1},
                      ExrOptions{ExrLayout::kMultiPart, ExrCompression::kRle, 1},
                      ExrOptions{ExrLayout::kMultiPart, ExrCompression::kNone, 1},
                      ExrOptions{ExrLayout::kSinglePart, ExrCompression::kZip, 1}));

std::vector<std::string> channels_of(const Imf::Header& header) {
  std::vector<std::string> names;
  const char* const types[] = {"uint", "half", "float"};
  for (auto at = header.channels().begin(); at != header.channels().end(); ++at) {
    names.push_back(std::string(at.name()) + " " + types[at.channel().type]);
  }
  return names;
}

TEST_F(ExrIo, PartsAndTypesAreAsDocumented) {
  write_frame_exr(file_, full_frame());
  Imf::MultiPartInputFile file(file_.c_str());
  ASSERT_EQ(file.parts(), 4);
  EXPECT_EQ(file.header(0).name(), "beauty");
  EXPECT_THAT(channels_of(file.header(0)),
              ElementsAre("A half", "B half", "G half", "R half"));
  EXPECT_EQ(file.header(1).name(), "geometry");
  EXPECT_THAT(channels_of(file.header(1)),
              ElementsAre("N.x half", "N.y half", "N.z half", "Z float", "depth_normal.x half",
                          "depth_normal.y half", "depth_normal.z half"));
  EXPECT_EQ(file.header(2).name(), "ids");
  EXPECT_THAT(
      channels_of(file.header(2)),
      ElementsAre("CryptoInstance00.A float", "CryptoInstance00.B float",
                  "CryptoInstance00.G float", "CryptoInstance00.R float",
                  "CryptoSemantic00.A float", "CryptoSemantic00.B float",
                  "CryptoSemantic00.G float", "CryptoSemantic00.R float", "confidence half",
                  "instance uint", "instance_confidence half", "semantic uint"));
  EXPECT_EQ(file.header(3).name(), "features");
  EXPECT_EQ(channels_of(file.header(3)).size(), 48U);
  EXPECT_NE(file.header(3).channels().findChannel("instance_feature.31"), nullptr);
}

/// Imf::InputFile is what OpenCV and most small readers use: it sees the first part only.
TEST_F(ExrIo, ASinglePartHasEveryChannelForSimpleReaders) {
  write_frame_exr(file_, full_frame(), {}, {ExrLayout::kSinglePart});
  const Imf::InputFile file(file_.c_str());
  const std::vector<std::string> channels = channels_of(file.header());
  const std::set<std::string> present(channels.begin(), channels.end());
  for (const char* channel : {"R half", "G half", "B half", "A half", "Z float", "N.x half",
                              "N.y half", "N.z half", "semantic uint", "instance uint"}) {
    EXPECT_TRUE(present.contains(channel)) << channel;
  }
  EXPECT_FALSE(Imf::isMultiPart(file.version()));

  // Of a file with parts it sees the picture.
  write_frame_exr(file_, full_frame());
  EXPECT_EQ(channels_of(Imf::InputFile(file_.c_str()).header()).size(), 4U);
}

/// The standard attributes against the camera model itself.
TEST_F(ExrIo, StandardCameraAttributesProjectLikeTheCamera) {
  const core::Frame frame = full_frame();
  write_frame_exr(file_, frame);
  const Imf::InputFile file(file_.c_str());
  const Imf::Header& header = file.header();
  const core::CameraIntrinsics& c = frame.intrinsics;
  for (const glm::dvec3& p_camera :
       {glm::dvec3(0.0, 0.0, 1.0), glm::dvec3(0.4, -0.3, 2.0), glm::dvec3(-1.0, 0.5, 5.0)}) {
    const glm::dvec3 p =
        (frame.T_world_camera * core::Point<core::frame::Camera>{p_camera}).xyz_m;
    const Imath::V3f p_world(static_cast<float>(p.x), static_cast<float>(p.y),
                             static_cast<float>(p.z));
    const Imath::V3f standard = p_world * Imf::worldToCamera(header);
    EXPECT_NEAR(standard.x, p_camera.x, 1e-5);
    EXPECT_NEAR(standard.y, -p_camera.y, 1e-5);
    EXPECT_NEAR(standard.z, p_camera.z, 1e-5);
    const Imath::V3f ndc = p_world * Imf::worldToNDC(header);
    const glm::dvec2 px = c.project(p_camera);
    EXPECT_NEAR(ndc.x, px.x / c.width_px, 1e-5);
    EXPECT_NEAR(ndc.y, px.y / c.height_px, 1e-5);
  }
  // Corners of the image at distance 1, y up.
  const glm::dvec3 upper_left = c.back_project({0.0, 0.0}, 1.0);
  const glm::dvec3 lower_right = c.back_project({16.0, 16.0}, 1.0);
  EXPECT_NEAR(header.screenWindowWidth(), lower_right.x - upper_left.x, 1e-6);
  EXPECT_NEAR(header.screenWindowCenter().x, (lower_right.x + upper_left.x) / 2, 1e-6);
  EXPECT_NEAR(header.screenWindowCenter().y, -(lower_right.y + upper_left.y) / 2, 1e-6);
  EXPECT_NEAR(header.pixelAspectRatio(), 21.25 / 20.5, 1e-6);
  // Nothing was captured on any day.
  EXPECT_FALSE(Imf::hasCapDate(header));
  EXPECT_FALSE(Imf::hasUtcOffset(header));
}

TEST_F(ExrIo, CryptomatteNamesEveryPixelsInstance) {
  const core::Frame frame = full_frame();
  write_frame_exr(file_, frame, flat_info());
  const CryptomatteImage instances = read_cryptomatte_exr(file_, "CryptoInstance");
  const CryptomatteImage classes = read_cryptomatte_exr(file_, "CryptoSemantic");
  for (std::size_t i = 0; i < 256; ++i) {
    if (i == 0) {
      EXPECT_EQ(instances.id.pixels()[i], 0U);
      EXPECT_EQ(instances.coverage.pixels()[i], 0.0F);
      continue;
    }
    const std::string number = std::to_string(257 * i);
    EXPECT_EQ(instances.names.at(instances.id.pixels()[i]),
              i == 1 ? "couch_a" : "instance " + number);
    EXPECT_EQ(instances.id.pixels()[i],
              cryptomatte_id(i == 1 ? "couch_a" : "instance " + number));
    EXPECT_EQ(instances.coverage.pixels()[i], 1.0F);
    EXPECT_EQ(classes.names.at(classes.id.pixels()[i]), i == 1 ? "wall"
                                                        : i == 2
                                                            ? "couch"
                                                            : "class " + std::to_string(i));
  }
  EXPECT_EQ(instances.names.size(), 255U);
  EXPECT_THAT(input_error_of([&] { (void)read_cryptomatte_exr(file_, "CryptoAsset"); }),
              HasSubstr("view.exr: expected channel CryptoAsset00.R"));
}

/// As the specification wants it, in the part with the channels and in the first one.
TEST_F(ExrIo, CryptomatteAttributesAreThoseOfTheSpecification) {
  write_frame_exr(file_, full_frame(), flat_info());
  const Imf::MultiPartInputFile file(file_.c_str());
  for (const int part : {0, 2}) {
    const auto text = [&](const std::string& name) {
      const auto* found = file.header(part).findTypedAttribute<Imf::StringAttribute>(name);
      return found == nullptr ? "none" : found->value();
    };
    for (const char* layer : {"CryptoInstance", "CryptoSemantic"}) {
      char hash[9];
      std::snprintf(hash, sizeof hash, "%08x", murmur3_32(layer));
      const std::string key = "cryptomatte/" + std::string(hash, 7) + "/";
      EXPECT_EQ(text(key + "name"), layer);
      EXPECT_EQ(text(key + "hash"), "MurmurHash3_32");
      EXPECT_EQ(text(key + "conversion"), "uint32_to_float32");
      EXPECT_THAT(text(key + "manifest"), AllOf(HasSubstr("{\""), HasSubstr("\"}")));
    }
  }
  EXPECT_EQ(file.header(1).findTypedAttribute<Imf::StringAttribute>("class_names"), nullptr);
}

TEST_F(ExrIo, AbsentImagesStayAbsent) {
  core::Frame frame = full_frame();
  frame.rgb = {};
  frame.normal = frame.depth_normal = {};
  frame.semantic = {};
  frame.confidence = {};
  frame.semantic_feature = {};
  frame.instance_feature = {};
  for (const ExrLayout layout : {ExrLayout::kMultiPart, ExrLayout::kSinglePart}) {
    write_frame_exr(file_, frame, {}, {layout});
    const core::Frame back = read_frame_exr(file_);
    EXPECT_TRUE(back.rgb.empty());
    EXPECT_TRUE(back.normal.empty());
    EXPECT_TRUE(back.depth_normal.empty());
    EXPECT_TRUE(back.semantic.empty());
    EXPECT_TRUE(back.confidence.empty());
    EXPECT_TRUE(back.semantic_feature.empty());
    EXPECT_FALSE(back.depth_m.empty());
    EXPECT_EQ(back.instance.pixels(), frame.instance.pixels());
    EXPECT_FALSE(read_frame_info_exr(file_).time_ns.has_value());
    EXPECT_EQ(read_frame_info_exr(file_).scene, "");
  }
}

TEST_F(ExrIo, AFrameOfOneImageIsAnOrdinaryFile) {
  core::Frame frame;
  frame.intrinsics = {1, 1, 2.0, 2.0, 0.5, 0.5};
  frame.alpha = core::Image<float>(1, 1, 0.5F);
  write_frame_exr(file_, frame);
  EXPECT_FALSE(Imf::isMultiPart(Imf::InputFile(file_.c_str()).version()));
  EXPECT_EQ(read_frame_exr(file_).alpha(0, 0), 0.5F);
  frame.alpha = {};
  EXPECT_THROW(write_frame_exr(file_, frame), core::ContractViolation);
}

TEST_F(ExrIo, DepthRoundTripAndFromAFrame) {
  const core::Frame frame = full_frame();
  core::Frame depth;
  depth.intrinsics = frame.intrinsics;
  depth.depth_m = frame.depth_m;
  write_frame_exr(folder_ / "depth.exr", depth);
  write_frame_exr(file_, frame);
  for (const char* name : {"depth.exr", "view.exr"}) {
    const core::Image<float> back = read_depth_exr(folder_ / name);
    EXPECT_EQ(back.width_px(), 16);
    EXPECT_EQ(back(3, 2), frame.depth_m(3, 2));
    EXPECT_TRUE(std::isnan(back(1, 1)));
  }
}

TEST_F(ExrIo, EqualFramesGiveEqualBytes) {
  write_frame_exr(file_, full_frame(), flat_info());
  write_frame_exr(folder_ / "again.exr", full_frame(), flat_info());
  EXPECT_EQ(core::read_file(file_), core::read_file(folder_ / "again.exr"));
}

}  // namespace
}  // namespace segsim::renderer
