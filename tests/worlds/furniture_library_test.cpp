#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <minizip/zip.h>

#include <glm/common.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "tests/temporary_folder.h"
#include "worlds/mesh/furniture/furniture_catalogue.h"
#include "worlds/procedural/furniture_stock.h"
#include "worlds/procedural/furniture_table.h"

namespace segsim::worlds {
namespace {

namespace fs = std::filesystem;

using testing::HasSubstr;

/// A wedge that is 2 wide, 4 high and 1 deep in the file's own units, higher at the back
/// (z = -0.5).
constexpr const char* kWedge =
    "mtllib wedge.mtl\nusemtl red\n"
    "v -1 0 0.5\nv 1 0 0.5\nv 1 0 -0.5\nv -1 0 -0.5\nv -1 4 -0.5\nv 1 4 -0.5\n"
    "f 1 4 3 2\nf 3 4 5 6\nf 1 2 6 5\nf 2 3 6\nf 1 5 4\n";
constexpr const char* kRed = "newmtl red\nKd 1 0 0\n";

std::string row(const std::string& id, const std::string& width = "80") {
  return "id=Test#Library\nlicense=CC0 \xa9 somebody\nid#1=" + id +
         "\nname#1=Wei\xdf\\u0065\ncategory#1=Bedroom\nmodel#1=/bed/wedge.obj\nwidth#1=" +
         width + "\ndepth#1=50\nheight#1=40\nelevation#1=30\ncreator#1=A. Maker\n";
}

void write_zip(const fs::path& file, const std::map<std::string, std::string>& entries) {
  zipFile zip = zipOpen64(file.c_str(), APPEND_STATUS_CREATE);
  ASSERT_NE(zip, nullptr);
  for (const auto& [name, bytes] : entries) {
    const zip_fileinfo info{};
    ASSERT_EQ(zipOpenNewFileInZip(zip, name.c_str(), &info, nullptr, 0, nullptr, 0, nullptr,
                                  Z_DEFLATED, Z_DEFAULT_COMPRESSION),
              ZIP_OK);
    ASSERT_EQ(zipWriteInFileInZip(zip, bytes.data(), static_cast<unsigned>(bytes.size())),
              ZIP_OK);
    ASSERT_EQ(zipCloseFileInZip(zip), ZIP_OK);
  }
  ASSERT_EQ(zipClose(zip, nullptr), ZIP_OK);
}

class FurnitureLibrary : public testing::Test {
 protected:
  std::map<std::string, std::string> entries(const std::string& catalogue) const {
    return {{"PluginFurnitureCatalog.properties", catalogue},
            {"bed/wedge.obj", kWedge},
            {"bed/wedge.mtl", kRed}};
  }
  fs::path library(const std::map<std::string, std::string>& content) const {
    const fs::path file = folder_.path() / "test.sh3f";
    fs::remove(file);
    write_zip(file, content);
    return file;
  }
  void expect_refused(const fs::path& file, const std::string& reason) const {
    try {
      static_cast<void>(read_furniture_library(file));
      ADD_FAILURE() << "not refused: " << reason;
    } catch (const core::InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(reason));
      EXPECT_THAT(error.what(), HasSubstr(file.filename().string()));
      EXPECT_THAT(error.what(), testing::Not(HasSubstr("\n")));
    }
  }

  tests::TemporaryFolder folder_{"furniture"};
};

TEST_F(FurnitureLibrary, ReadsItsCatalogue) {
  const auto models = read_furniture_library(library(entries(row("Test#bed"))));
  ASSERT_EQ(models.size(), 1U);
  const FurnitureModel& model = models[0];
  EXPECT_EQ(model.id, "Test#bed");
  EXPECT_EQ(model.name, "Weiße");
  EXPECT_EQ(model.creator, "A. Maker");
  EXPECT_EQ(model.license, "CC0 © somebody");
  EXPECT_FLOAT_EQ(model.size_m.x, 0.8F);
  EXPECT_FLOAT_EQ(model.size_m.y, 0.5F);
  EXPECT_FLOAT_EQ(model.size_m.z, 0.4F);
  EXPECT_FLOAT_EQ(model.elevation_m, 0.3F);
  EXPECT_FLOAT_EQ(model.surface_m, 0.4F);
}

TEST_F(FurnitureLibrary, ModelsHaveTheCataloguesSizeAndFaceTheFront) {
  const auto models = read_furniture_library(library(entries(row("Test#bed"))));
  const sim::MeshScene scene = load_furniture_mesh(models[0]);
  ASSERT_EQ(scene.triangle_count(), 8U);
  glm::vec3 low(1e9F), high(-1e9F);
  for (const sim::SubMesh& mesh : scene.meshes) {
    EXPECT_EQ(scene.materials[static_cast<std::size_t>(mesh.material)].albedo,
              glm::vec3(1, 0, 0));
    for (const glm::vec3& p : mesh.positions_m) {
      low = glm::min(low, p);
      high = glm::max(high, p);
      if (p.z > 0.2F) {
        EXPECT_GT(p.y, 0.0F) << "the high edge is at the back";
      }
    }
  }
  const glm::vec3 expected_low(-0.4F, -0.25F, 0.0F), expected_high(0.4F, 0.25F, 0.4F);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(low[axis], expected_low[axis], 1e-5F);
    EXPECT_NEAR(high[axis], expected_high[axis], 1e-5F);
  }
}

TEST_F(FurnitureLibrary, IsTurnedBeforeItIsScaled) {
  // About y by 180 degrees: the high edge comes to the front.
  const auto models = read_furniture_library(
      library(entries(row("Test#bed") + "modelRotation#1=-1 0 0 0 1 0 0 0 -1\n")));
  for (const sim::SubMesh& mesh : load_furniture_mesh(models[0]).meshes) {
    for (const glm::vec3& p : mesh.positions_m) {
      if (p.z > 0.2F) {
        EXPECT_LT(p.y, 0.0F);
      }
    }
  }
}

TEST_F(FurnitureLibrary, BrokenFilesAreOneLine) {
  expect_refused(folder_.path() / "absent.sh3f", "whole zip file");
  const fs::path whole = library(entries(row("Test#bed")));
  const std::string bytes = core::read_file(whole);
  for (const std::size_t length : {std::size_t{0}, std::size_t{10}, bytes.size() - 30}) {
    std::ofstream(whole, std::ios::binary) << bytes.substr(0, length);
    expect_refused(whole, "whole zip file");
  }
  // A byte of the mesh's compressed data: the directory is whole, the entry is not.
  std::string flipped = bytes;
  const std::size_t name = flipped.find("bed/wedge.obj");
  flipped[name + 40] = static_cast<char>(flipped[name + 40] ^ 0x55);
  std::ofstream(whole, std::ios::binary) << flipped;
  EXPECT_THROW(static_cast<void>(load_furniture_mesh(read_furniture_library(whole)[0])),
               core::InputError);
}

TEST_F(FurnitureLibrary, NamesMustStayInside) {
  for (const std::string name : {"../evil.obj", "/etc/evil", "bed/../../evil", "c:evil"}) {
    auto content = entries(row("Test#bed"));
    content[name] = "x";
    expect_refused(library(content), "inside the archive");
  }
}

TEST_F(FurnitureLibrary, AbsurdRowsAreRefused) {
  for (const char* width : {"0", "-3", "1e9", "nan", "wide"}) {
    expect_refused(library(entries(row("Test#bed", width))), "width#1");
  }
  expect_refused(library(entries("id=Test\n")), "at least one model");
  auto no_mesh = entries(row("Test#bed"));
  no_mesh.erase("bed/wedge.obj");
  expect_refused(library(no_mesh), "model#1");
  auto no_catalogue = entries("");
  no_catalogue.erase("PluginFurnitureCatalog.properties");
  expect_refused(library(no_catalogue), "PluginFurnitureCatalog.properties");
  auto large = entries(row("Test#bed"));
  large["bed/large.obj"] = std::string((std::size_t{64} << 20U) + 1, ' ');
  expect_refused(library(large), "at most");
}

TEST_F(FurnitureLibrary, AFolderHasEachIdOnce) {
  EXPECT_THROW(static_cast<void>(read_furniture_folder(folder_.path())), core::InputError);
  const fs::path first = library(entries(row("Test#bed")));
  EXPECT_EQ(read_furniture_folder(folder_.path()).size(), 1U);
  fs::copy_file(first, folder_.path() / "twin.sh3f");
  EXPECT_THROW(static_cast<void>(read_furniture_folder(folder_.path())), core::InputError);
}

TEST_F(FurnitureLibrary, StockFurnishesWithListedModelsAndCreditsThem) {
  const auto models = read_furniture_library(library(entries(row("Scopia#bed1"))));
  sim::MeshScene scene;
  SurfaceLibrary surfaces(scene);
  FurnitureStock stock(models, FurniturePool::kTrain, 1, false, image_textures());
  const Furniture bed = stock.make(FurnitureKind::kBed, FurnitureStyle::kTarget, 5, surfaces);
  EXPECT_EQ(bed.class_id, ProceduralClass::kBed);
  EXPECT_NEAR(bed.size_m().x, 0.8F, 1e-5F);
  EXPECT_THAT(bed.credit, HasSubstr("Scopia#bed1"));
  EXPECT_THAT(bed.credit, HasSubstr("A. Maker"));
  EXPECT_THAT(bed.credit, HasSubstr("CC0"));
  // Another kind, or a place that is too narrow, takes a shape of our own.
  EXPECT_TRUE(
      stock.make(FurnitureKind::kDesk, FurnitureStyle::kTarget, 5, surfaces).credit.empty());
  EXPECT_TRUE(stock.make(FurnitureKind::kBed, FurnitureStyle::kTarget, 5, surfaces, {0.5F})
                  .credit.empty());
  // The model belongs to the other pool.
  FurnitureStock unseen(models, FurniturePool::kUnseen, 1, false, image_textures());
  EXPECT_TRUE(
      unseen.make(FurnitureKind::kBed, FurnitureStyle::kTarget, 5, surfaces).credit.empty());
}

TEST(FurnitureTable, SplitsModelsByIdOnce) {
  std::set<std::string> ids;
  std::map<ProceduralClass, std::set<FurniturePool>> pools;
  for (const FurnitureTableRow& row : furniture_table()) {
    EXPECT_TRUE(ids.insert(row.model_id).second) << row.model_id;
    EXPECT_NE(row.pool, FurniturePool::kAll);
    pools[class_of(row.kind)].insert(row.pool);
  }
  EXPECT_GT(ids.size(), 150U);
  for (const ProceduralClass goal :
       {ProceduralClass::kChair, ProceduralClass::kCouch, ProceduralClass::kBed,
        ProceduralClass::kDiningTable, ProceduralClass::kPottedPlant, ProceduralClass::kTv,
        ProceduralClass::kToilet, ProceduralClass::kRefrigerator}) {
    EXPECT_EQ(pools[goal].size(), 2U) << class_name(goal);
  }
}

/// Debian's package, where it is installed or SEGSIM_FURNITURE names its folder.
TEST(FurniturePackage, EveryListedModelIsThere) {
  const char* named = std::getenv("SEGSIM_FURNITURE");
  const fs::path folder = named != nullptr ? named : kFurnitureFolder;
  if (!fs::is_directory(folder)) GTEST_SKIP() << "sweethome3d-furniture is not installed";
  const auto models = read_furniture_folder(folder);
  EXPECT_GE(models.size(), 820U);
  std::set<std::string> ids;
  for (const FurnitureModel& model : models) ids.insert(model.id);
  for (const FurnitureTableRow& row : furniture_table()) {
    EXPECT_TRUE(ids.contains(row.model_id)) << row.model_id;
  }
  const auto bed = std::find_if(models.begin(), models.end(),
                                [](const auto& model) { return model.id == "Scopia#bed1"; });
  ASSERT_NE(bed, models.end());
  EXPECT_GT(load_furniture_mesh(*bed).triangle_count(), 100U);
}

}  // namespace
}  // namespace segsim::worlds
