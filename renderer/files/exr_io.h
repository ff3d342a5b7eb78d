#pragma once

/// @file
/// Rendered views as OpenEXR files. docs/exr.md has the whole table; in short:
///
///     beauty     R, G, B                        half   linear light, over black
///     beauty     A                              half   accumulated opacity
///     geometry   Z                              float  depth along +z [m], NaN = none
///     geometry   N.x, N.y, N.z                  half   normal, world frame, 0 = none
///     geometry   depth_normal.x, .y, .z         half   the same, of the depth image
///     ids        semantic, instance             uint   ids, 0 = void, none
///     ids        confidence                     half   share of the votes for semantic
///     ids        instance_confidence            half   the same for instance
///     ids        CryptoSemantic00.R, .G         float  Cryptomatte id, coverage
///     ids        CryptoInstance00.R, .G         float  Cryptomatte id, coverage
///     features   semantic_feature.00 ... .15    half   blended features
///     features   instance_feature.00 ... .31    half   blended features
///
/// Columns: part, channels, type, content. Channels of images that the frame lacks are left
/// out, and so are parts without channels. Half has 11 significant bits: it keeps every sRGB
/// byte exactly, a share or an opacity within 0.00025 and a normal within 0.03 degrees; a
/// depth of 5 m it would miss by 2 mm.
///
/// Attributes give camera, pose, time, scene and program; standard ones where OpenEXR has
/// them. A frame holds one label per pixel, so Cryptomatte coverage is 1 (0 where the id is 0)
/// and the second rank is empty.

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "core/image.h"
#include "core/render.h"
#include "core/stages.h"
#include "renderer/files/cryptomatte.h"

namespace segsim::renderer {

enum class ExrLayout : unsigned char {
  /// Four parts: a reader decodes only what it asks for, and each part is a usual image.
  kMultiPart,
  /// All channels in one part, for readers that see the first part only (OpenCV,
  /// Imf::InputFile).
  kSinglePart,
};

/// All are lossless. docs/exr.md has the measurement behind the default.
enum class ExrCompression : unsigned char { kNone, kRle, kZips, kZip, kPiz };

struct ExrOptions {
  ExrLayout layout = ExrLayout::kMultiPart;
  ExrCompression compression = ExrCompression::kZip;
  int zip_level = 1;  ///< Of kZips and kZip: 1 (fast) ... 9 (small).
};

/// What a file says about a frame beyond its camera and pixels.
struct FrameInfo {
  std::optional<core::TimeNs> time_ns;      ///< Simulated time. No date: nothing was captured.
  std::string scene;                        ///< Name; empty = unknown.
  std::string scene_sha256;                 ///< Empty = unknown.
  std::shared_ptr<const SceneNames> names;  ///< Null: ids are named by their numbers.
  std::string software;  ///< Set by readers; writers always put this program's version.
};

/// Writes the images that are not empty, in one step: a file of that name is whole or absent.
/// @throws core::InputError if the file cannot be written.
/// @throws core::ContractViolation if images differ in size or there are none.
void write_frame_exr(const std::filesystem::path& file, const core::Frame& frame,
                     const FrameInfo& info = {}, const ExrOptions& options = {});

/// Reads what write_frame_exr() wrote, in either layout; images without channels are empty.
/// @throws core::InputError for a file that is not of this kind, is damaged, or has only some
/// of the channels of an image.
[[nodiscard]] core::Frame read_frame_exr(const std::filesystem::path& file);

/// Reads the header only. @throws core::InputError
[[nodiscard]] FrameInfo read_frame_info_exr(const std::filesystem::path& file);

/// The first rank of a Cryptomatte layer.
struct CryptomatteImage {
  core::Image<std::uint32_t> id;               ///< Bits of the id float; 0 = no object.
  core::Image<float> coverage;                 ///< [0, 1]
  std::map<std::uint32_t, std::string> names;  ///< The manifest.
};

/// @param layer  "CryptoSemantic" or "CryptoInstance"; any layer of another program's file.
/// @throws core::InputError if there is no such layer, or it has no manifest in the header.
[[nodiscard]] CryptomatteImage read_cryptomatte_exr(const std::filesystem::path& file,
                                                    const std::string& layer);

/// Reads channel Z of any EXR image, of the first part that has one.
/// @throws core::InputError if there is none.
[[nodiscard]] core::Image<float> read_depth_exr(const std::filesystem::path& file);

}  // namespace segsim::renderer
