// Draws the models of a furniture library as contact sheets, one for each class, so that a
// person can see whether a model is what the table says, stands upright and faces the front.
//
//     furniture_sheet [FOLDER]
//
// FOLDER holds .sh3f files; Debian's package sweethome3d-furniture is the default. Writes
// sheet_CLASS.ppm into the current folder and says which model is in which row and column.
// Models are seen from the front and from the right; a square of the floor is half a metre.

#include <iostream>
#include <map>

#include "core/error.h"
#include "examples/picture.h"
#include "worlds/capture/mesh_renderer.h"
#include "worlds/mesh/furniture/furniture_catalogue.h"
#include "worlds/procedural/furniture_table.h"

using namespace segsim;

namespace {

constexpr int kTile_px = 200, kColumns = 7;

/// The model on a floor with lamps around it.
core::Image<core::Rgb8> draw(const worlds::FurnitureModel& model) {
  sim::MeshScene scene = worlds::load_furniture_mesh(model);
  const float size_m = std::max({model.size_m.x, model.size_m.y, model.size_m.z});
  constexpr float kSquare_m = 0.5F;
  for (const float grey : {0.45F, 0.6F}) {
    scene.materials.push_back({glm::vec3(grey), -1, glm::vec3(0.0F)});
  }
  worlds::MeshBuilder floor;
  const int squares = static_cast<int>(1.2F * size_m / kSquare_m) + 1;
  for (int y = -squares; y < squares; ++y) {
    for (int x = -squares; x < squares; ++x) {
      floor.set_surface({static_cast<int>(scene.materials.size()) - 1 - ((x + y) & 1)});
      floor.add_quad({kSquare_m * static_cast<float>(x), kSquare_m * static_cast<float>(y), 0},
                     {kSquare_m, 0, 0}, {0, kSquare_m, 0});
    }
  }
  for (sim::SubMesh& mesh : floor.build(glm::mat4(1.0F), 0, 0)) scene.meshes.push_back(mesh);
  for (const glm::vec3& direction :
       {glm::vec3(-1.2F, -1.5F, 1.8F), glm::vec3(1.8F, -0.8F, 1.4F), glm::vec3(0, 1, 2.2F)}) {
    sim::PointLight light;
    light.position_m = (size_m + 0.4F) * direction;
    light.radiance = glm::vec3(3.0F * size_m * size_m + 1.0F);
    scene.lights.push_back(light);
  }
  const auto camera = worlds::make_mesh_renderer(
      scene, {.cell_m = 0.03F * size_m, .shadow_samples = 4, .bounce_samples = 16});
  const glm::dvec3 target(0, 0, 0.45 * static_cast<double>(model.size_m.z));
  const glm::dvec3 eye =
      target + glm::dvec3(0.75, -1.35, 0.75) * (0.85 * static_cast<double>(size_m) + 0.05);
  return camera
      ->render(core::look_at(eye, target),
               core::CameraIntrinsics::from_fov(kTile_px, kTile_px, 0.9), core::Channels::kRgb)
      .rgb;
}

void copy_tile(const core::Image<core::Rgb8>& tile, int index,
               core::Image<core::Rgb8>& sheet) {
  const int x0 = index % kColumns * kTile_px, y0 = index / kColumns * kTile_px;
  for (int y = 0; y < kTile_px - 2; ++y) {
    for (int x = 0; x < kTile_px - 2; ++x) sheet(x0 + x, y0 + y) = tile(x, y);
  }
}

void draw_sheets(const std::filesystem::path& folder) {
  std::map<std::string, worlds::FurnitureModel> models;
  for (worlds::FurnitureModel& model : worlds::read_furniture_folder(folder)) {
    models.emplace(model.id, std::move(model));
  }
  std::map<std::string, std::vector<const worlds::FurnitureModel*>> sheets;
  for (const worlds::FurnitureTableRow& row : worlds::furniture_table()) {
    const auto model = models.find(row.model_id);
    if (model == models.end()) continue;
    sheets[worlds::class_name(worlds::class_of(row.kind))].push_back(&model->second);
  }
  for (const auto& [class_name, of_class] : sheets) {
    const int count = static_cast<int>(of_class.size());
    core::Image<core::Rgb8> sheet(kColumns * kTile_px,
                                  (count + kColumns - 1) / kColumns * kTile_px);
    for (int i = 0; i < count; ++i) {
      const worlds::FurnitureModel& model = *of_class[static_cast<std::size_t>(i)];
      copy_tile(draw(model), i, sheet);
      std::cout << class_name << ", row " << i / kColumns + 1 << ", column "
                << i % kColumns + 1 << ": " << model.id << ", " << model.name << std::endl;
    }
    examples::write_ppm("sheet_" + class_name + ".ppm", sheet);
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    draw_sheets(argc > 1 ? argv[1] : worlds::kFurnitureFolder);
  } catch (const core::InputError& error) {
    std::cerr << "furniture_sheet: " << error.what() << '\n';
    return 2;
  }
  return 0;
}
