#include "worlds/mesh/texture_reader.h"

namespace segsim::worlds {
namespace {

class BlankTextures final : public TextureReader {
 public:
  [[nodiscard]] core::Image<core::Rgb8> from_file(
      const std::filesystem::path& /*file*/) const override {
    return white();
  }
  [[nodiscard]] core::Image<core::Rgb8> from_bytes(
      std::span<const unsigned char> /*bytes*/) const override {
    return white();
  }
  [[nodiscard]] bool is_blank() const override { return true; }

 private:
  [[nodiscard]] static core::Image<core::Rgb8> white() {
    return core::Image<core::Rgb8>(1, 1, core::Rgb8{255, 255, 255});
  }
};

}  // namespace

const TextureReader& blank_textures() {
  static const BlankTextures reader;
  return reader;
}

}  // namespace segsim::worlds
