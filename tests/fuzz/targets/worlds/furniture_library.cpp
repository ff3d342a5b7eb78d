// Furniture libraries of Sweet Home 3D: zip, catalogue, models
// (worlds/mesh/furniture/furniture_catalogue.h). An input is either a zip file or, behind a
// '#', the catalogue of one that is made of it.
#include <minizip/zip.h>

#include <cstdlib>
#include <map>

#include "tests/fuzz/fuzz_target.h"
#include "worlds/mesh/furniture/furniture_catalogue.h"

namespace segsim::fuzz {
namespace {

std::filesystem::path zip_of(const std::string& catalogue) {
  const std::map<std::string, std::string> entries = {
      {"PluginFurnitureCatalog.properties", catalogue},
      {"bed/wedge.mtl", "newmtl red\nKd 1 0 0\n"},
      {"bed/wedge.obj",
       "mtllib wedge.mtl\nusemtl red\nv -1 0 0.5\nv 1 0 0.5\nv 1 0 -0.5\nv -1 0 -0.5\n"
       "v -1 4 -0.5\nv 1 4 -0.5\nf 1 4 3 2\nf 3 4 5 6\nf 1 2 6 5\nf 2 3 6\nf 1 5 4\n"}};
  std::filesystem::path file = in_file("", "library.sh3f");
  zipFile zip = zipOpen64(file.c_str(), APPEND_STATUS_CREATE);
  if (zip == nullptr) std::abort();
  for (const auto& [name, bytes] : entries) {
    const zip_fileinfo info{};
    zipOpenNewFileInZip(zip, name.c_str(), &info, nullptr, 0, nullptr, 0, nullptr, Z_DEFLATED,
                        Z_DEFAULT_COMPRESSION);
    zipWriteInFileInZip(zip, bytes.data(), static_cast<unsigned>(bytes.size()));
    zipCloseFileInZip(zip);
  }
  zipClose(zip, nullptr);
  return file;
}

constexpr const char* kCatalogue =
    "#id=Test#Library\nlicense=CC0 \xa9 somebody\nid#1=Test#bed\nname#1=Wei\xdf\\u0065\n"
    "category#1=Bedroom\nmodel#1=/bed/wedge.obj\nwidth#1=80\ndepth#1=50\nheight#1=40\n"
    "elevation#1=30\ncreator#1=A. Maker\nmodelRotation#1=1 0 0 0 1 0 0 0 1\n"
    "dropOnTopElevation#1=30\n";

}  // namespace

void parse(const std::string& bytes) {
  const std::filesystem::path library =
      bytes.starts_with('#') ? zip_of(bytes.substr(1)) : in_file(bytes, "library.sh3f");
  for (const worlds::FurnitureModel& model : worlds::read_furniture_library(library)) {
    (void)worlds::load_furniture_mesh(model, worlds::blank_textures());
  }
}

std::vector<std::string> seeds() {
  const std::string zip = written(
      [](const auto& file) { std::filesystem::copy_file(zip_of(kCatalogue + 1), file); });
  return {kCatalogue, zip};
}

}  // namespace segsim::fuzz
