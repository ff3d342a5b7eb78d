// Files that are damaged, incomplete or of another program, and places that cannot be written.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfMatrixAttribute.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfStringAttribute.h>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "tests/renderer/files/exr_folder.h"

namespace segsim::renderer {
namespace {

using renderer::testing::flat_info;
using renderer::testing::full_frame;
using renderer::testing::read_error;
using segsim::tests::input_error_of;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

class ExrBadFiles : public renderer::testing::ExrFolder {};

/// A copy of a frame's file with other channels, attributes kept.
void write_foreign(const fs::path& file, const Imf::Header& attributes,
                   const std::vector<std::string>& channels, unsigned int value,
                   int size = 16) {
  Imf::Header header = attributes;
  header.channels() = Imf::ChannelList();
  header.dataWindow() = header.displayWindow() = {{0, 0}, {size - 1, size - 1}};
  std::vector<unsigned int> pixels(static_cast<std::size_t>(size) * size, value);
  Imf::FrameBuffer buffer;
  for (const std::string& channel : channels) {
    header.channels().insert(channel, Imf::Channel(Imf::UINT));
    buffer.insert(channel, Imf::Slice::Make(Imf::UINT, pixels.data(), header.dataWindow()));
  }
  Imf::OutputFile out(file.c_str(), header);
  out.setFrameBuffer(buffer);
  out.writePixels(size);
}

/// Their memory would be taken before anybody sees that the file is short.
TEST_F(ExrBadFiles, HeadersOfMorePixelsThanTheFileCanHoldAreRefused) {
  core::Frame frame;
  frame.intrinsics = core::CameraIntrinsics::from_fov(16, 16, 1.2);
  frame.depth_m = core::Image<float>(16, 16, 1.0F);
  write_frame_exr(file_, frame, {}, {ExrLayout::kSinglePart, ExrCompression::kNone});
  std::string bytes = core::read_file(file_);
  const std::string name("dataWindow\0box2i\0", 17);
  const std::size_t corner = bytes.find(name) + name.size() + 4 + 8;
  bytes.replace(corner, 4, std::string("\xff\xff\xff\0", 4));  // 2^24 columns, 16 lines.
  std::ofstream(file_, std::ios::binary) << bytes;
  EXPECT_THAT(input_error_of([&] { (void)read_depth_exr(file_); }),
              HasSubstr("expected a file that can hold the 268435456 numbers of its pixels"));
}

/// The library takes that memory before it reads.
TEST_F(ExrBadFiles, HeadersThatAskForMoreThanTheFileIsAreRefused) {
  core::Frame frame;
  frame.intrinsics = core::CameraIntrinsics::from_fov(16, 16, 1.2);
  frame.depth_m = core::Image<float>(16, 16, 1.0F);
  write_frame_exr(file_, frame, {}, {ExrLayout::kSinglePart, ExrCompression::kNone});
  const std::string whole = core::read_file(file_);
  const auto error_with = [&](const std::string& name, std::size_t behind,
                              const std::string& bytes) {
    std::string changed = whole;
    changed.replace(changed.find(name) + name.size() + behind, bytes.size(), bytes);
    std::ofstream(file_, std::ios::binary) << changed;
    return input_error_of([&] { (void)read_depth_exr(file_); });
  };
  EXPECT_THAT(error_with(std::string("software\0string\0", 16), 0, "\xff\xff\xff\x7f"),
              HasSubstr(" bytes of attribute software, found 2147483647"));
  EXPECT_THAT(error_with(std::string("dataWindow\0box2i\0", 17), 4 + 12, "\xff\xff\xff\x7f"),
              HasSubstr("chunks of pixels, found a header of more"));
}

TEST_F(ExrBadFiles, BadFilesAreRefusedByName) {
  EXPECT_THAT(input_error_of([&] { (void)read_depth_exr(file_); }),
              HasSubstr("view.exr: expected"));
  std::ofstream(file_) << "this is no image";
  EXPECT_THAT(read_error(file_), HasSubstr("view.exr: expected"));
  EXPECT_THAT(input_error_of([&] { (void)read_frame_info_exr(file_); }),
              HasSubstr("view.exr"));

  core::Frame frame = full_frame();
  frame.depth_m = {};
  write_frame_exr(file_, frame);
  EXPECT_THAT(input_error_of([&] { (void)read_depth_exr(file_); }),
              HasSubstr("expected channel Z"));
  write_foreign(file_, Imf::Header(16, 16), {"Z"}, 0);
  EXPECT_THAT(read_error(file_), HasSubstr("expected attribute fx_px"));
  EXPECT_THAT(input_error_of([&] { (void)read_frame_info_exr(file_); }), HasSubstr("fx_px"));
}

TEST_F(ExrBadFiles, IncompleteImagesAndWrongIdsAreRefused) {
  write_frame_exr(file_, full_frame());
  const Imf::Header header = Imf::InputFile(file_.c_str()).header();
  write_foreign(file_, header, {"R", "B"}, 1);
  EXPECT_THAT(read_error(file_), HasSubstr("expected channel G, found none"));
  write_foreign(file_, header, {"N.x", "N.z"}, 1);
  EXPECT_THAT(read_error(file_), HasSubstr("expected channel N.y, found none"));
  write_foreign(file_, header, {"semantic_feature.00"}, 1);
  EXPECT_THAT(read_error(file_), HasSubstr("expected channel semantic_feature.01"));
  write_foreign(file_, header, {"instance"}, 65536);
  EXPECT_THAT(read_error(file_), HasSubstr("ids from 0 to 65535, found 65536"));
  write_foreign(file_, header, {"instance"}, 65535);
  EXPECT_EQ(read_frame_exr(file_).instance(0, 0), 65535);
  write_foreign(file_, header, {"velocity"}, 1);
  EXPECT_THAT(read_error(file_), HasSubstr("expected channels of a rendered view"));

  Imf::Header bent = header;
  bent.insert("T_world_camera", Imf::M44fAttribute(Imath::M44f(2.0F)));
  write_foreign(file_, bent, {"A"}, 1);
  EXPECT_THAT(read_error(file_), HasSubstr("expected a rigid T_world_camera"));
  bent = header;
  bent.insert("fx_px", Imf::DoubleAttribute(std::nan("")));
  write_foreign(file_, bent, {"A"}, 1);
  EXPECT_THAT(read_error(file_), HasSubstr("fx_px, fy_px > 0"));
  bent = header;
  bent.insert("time_ns", Imf::StringAttribute("1.5"));
  write_foreign(file_, bent, {"A"}, 1);
  EXPECT_THAT(input_error_of([&] { (void)read_frame_info_exr(file_); }), HasSubstr("time_ns"));
}

TEST_F(ExrBadFiles, PartsOfAnotherSizeAreRefusedAndDepthIsFoundInAnyPart) {
  Imf::Header headers[2] = {Imf::Header(4, 4), Imf::Header(4, 4)};
  write_frame_exr(file_, full_frame());
  const Imf::Header attributes = Imf::InputFile(file_.c_str()).header();
  std::vector<float> pixels(64, 2.5F);
  for (int i = 0; i < 2; ++i) {
    headers[i] = attributes;
    headers[i].setName(i == 0 ? "small" : "large");
    headers[i].channels() = Imf::ChannelList();
    headers[i].channels().insert(i == 0 ? "A" : "Z", Imf::Channel(Imf::FLOAT));
    headers[i].dataWindow() = {{0, 0}, {3, i == 0 ? 3 : 7}};
  }
  {
    Imf::MultiPartOutputFile out(file_.c_str(), headers, 2);
    for (int i = 0; i < 2; ++i) {
      Imf::OutputPart part(out, i);
      Imf::FrameBuffer buffer;
      buffer.insert(i == 0 ? "A" : "Z",
                    Imf::Slice::Make(Imf::FLOAT, pixels.data(), headers[i].dataWindow()));
      part.setFrameBuffer(buffer);
      part.writePixels(i == 0 ? 4 : 8);
    }
  }
  EXPECT_THAT(read_error(file_), HasSubstr("channel Z of 4 x 4 pixels, found 4 x 8 pixels"));
  EXPECT_EQ(read_depth_exr(file_).height_px(), 8);
}

TEST_F(ExrBadFiles, AnyTruncationIsRefusedInOneLine) {
  for (const ExrLayout layout : {ExrLayout::kMultiPart, ExrLayout::kSinglePart}) {
    write_frame_exr(file_, full_frame(), flat_info(), {layout});
    const std::string whole = core::read_file(file_);
    for (std::size_t size = 0; size < whole.size(); size += 1 + whole.size() / 97) {
      std::ofstream(file_, std::ios::binary) << whole.substr(0, size);
      EXPECT_THAT(read_error(file_),
                  AllOf(HasSubstr("view.exr: expected"), Not(HasSubstr("\n"))))
          << size;
    }
  }
}

/// Whatever the damage: an InputError, or a frame if the damage does not show.
TEST_F(ExrBadFiles, DamagedBytesNeverDoMoreThanFail) {
  write_frame_exr(file_, full_frame(), flat_info());
  const std::string whole = core::read_file(file_);
  core::RandomStream random(5, "damage");
  int refused = 0;
  for (int trial = 0; trial < 400; ++trial) {
    std::string bytes = whole;
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t at = random.index(static_cast<std::uint32_t>(bytes.size()));
      bytes[at] = static_cast<char>(random.index(256));
    }
    std::ofstream(file_, std::ios::binary) << bytes;
    try {
      (void)read_frame_exr(file_);
      (void)read_frame_info_exr(file_);
    } catch (const core::InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 200);  // Compressed pixels carry a checksum.
}

TEST_F(ExrBadFiles, AFailedWriteLeavesTheOldFileAndNothingElse) {
  write_frame_exr(file_, full_frame());
  const std::string before = core::read_file(file_);
  core::Frame frame = full_frame();
  frame.alpha = core::Image<float>(8, 16);
  EXPECT_THROW(write_frame_exr(file_, frame), core::ContractViolation);
  EXPECT_EQ(core::read_file(file_), before);
  fs::create_directories(folder_ / "taken.exr" / "inside");
  EXPECT_THAT(input_error_of([&] { write_frame_exr(folder_ / "taken.exr", full_frame()); }),
              HasSubstr("taken.exr"));
  EXPECT_THAT(input_error_of([&] { write_frame_exr(file_ / "below.exr", full_frame()); }),
              HasSubstr("view.exr"));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 2);
}

}  // namespace
}  // namespace segsim::renderer
