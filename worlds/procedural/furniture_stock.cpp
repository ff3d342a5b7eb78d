#include "worlds/procedural/furniture_stock.h"

#include <algorithm>

#include "core/random.h"

namespace segsim::worlds {
namespace {

constexpr std::size_t kModelsOfKind = 3;
/// A model may be so much wider than what was asked for.
constexpr float kWidthSlack = 1.1F;

/// What is screwed to a wall hangs at the catalogue's height; everything else stands.
bool hangs(FurnitureKind kind) { return kind == FurnitureKind::kWashbasin; }

std::string credit_of(const FurnitureModel& model) {
  return model.name + " (" + model.id + ") by " + model.creator + ", from " +
         model.library.filename().string() + " of Sweet Home 3D, sweethome3d.com; " +
         model.license;
}

}  // namespace

/// Pictures are shared by all pieces made of the model.
struct FurnitureStock::Loaded {
  sim::MeshScene scene;
  std::vector<std::shared_ptr<const core::Image<core::Rgb8>>> textures;

  Loaded(const FurnitureModel& model, const TextureReader& reader)
      : scene(load_furniture_mesh(model, reader)) {
    for (core::Image<core::Rgb8>& texture : scene.textures) {
      textures.push_back(std::make_shared<const core::Image<core::Rgb8>>(std::move(texture)));
    }
    scene.textures.clear();
  }
};

FurnitureStock::FurnitureStock(const std::vector<FurnitureModel>& models, FurniturePool pool,
                               std::uint64_t seed, bool boxes, const TextureReader& textures)
    : boxes_(boxes), textures_(&textures) {
  for (const FurnitureTableRow& row : furniture_table()) {
    if (pool != FurniturePool::kAll && pool != row.pool) continue;
    const auto model =
        std::find_if(models.begin(), models.end(),
                     [&](const FurnitureModel& m) { return m.id == row.model_id; });
    if (model != models.end()) of_kind_[row.kind].push_back(*model);
  }
  core::RandomStream random(seed, "furniture stock");
  for (auto& [kind, of_kind] : of_kind_) {
    for (std::size_t i = of_kind.size(); i > 1; --i) {
      std::swap(of_kind[i - 1], of_kind[random.index(static_cast<std::uint32_t>(i))]);
    }
    of_kind.resize(std::min(of_kind.size(), kModelsOfKind));
  }
}

const FurnitureModel* FurnitureStock::choose(FurnitureKind kind, std::uint64_t seed,
                                             const FurnitureSize& size) const {
  const auto found = of_kind_.find(kind);
  if (found == of_kind_.end()) return nullptr;
  std::vector<const FurnitureModel*> fitting;
  for (const FurnitureModel& model : found->second) {
    const bool fits = size.width_m == 0.0F || model.size_m.x <= kWidthSlack * size.width_m;
    if (fits) fitting.push_back(&model);
  }
  if (fitting.empty()) return nullptr;
  core::RandomStream random(seed, "furniture model");
  return fitting[random.index(static_cast<std::uint32_t>(fitting.size()))];
}

const FurnitureStock::Loaded& FurnitureStock::loaded(const FurnitureModel& model) {
  std::shared_ptr<const Loaded>& known = loaded_[model.id];
  if (known == nullptr) known = std::make_shared<const Loaded>(model, *textures_);
  return *known;
}

Furniture FurnitureStock::make(FurnitureKind kind, FurnitureStyle style, std::uint64_t seed,
                               SurfaceLibrary& surfaces, const FurnitureSize& size) {
  const FurnitureModel* model = choose(kind, seed, size);
  if (model == nullptr) return make_furniture(kind, style, seed, surfaces, size);
  Furniture piece;
  piece.class_id = class_of(kind);
  piece.credit = credit_of(*model);
  const float lift_m = hangs(kind) ? model->elevation_m : 0.0F;
  piece.surface_height_m = lift_m + model->surface_m;
  piece.mesh.set_frame(pose_matrix({0.0F, 0.0F, lift_m}, 0.0F));
  if (boxes_) {
    piece.mesh.set_surface(surfaces.plain(glm::vec3(0.5F)));
    piece.mesh.add_box({0.0F, 0.0F, 0.5F * model->size_m.z}, model->size_m);
    return piece;
  }
  const Loaded& source = loaded(*model);
  for (const sim::SubMesh& mesh : source.scene.meshes) {
    const sim::Material& m = source.scene.materials[static_cast<std::size_t>(mesh.material)];
    piece.mesh.set_surface(surfaces.ready(
        m.albedo, m.emission,
        m.texture < 0 ? nullptr : source.textures[static_cast<std::size_t>(m.texture)]));
    piece.mesh.add_mesh(mesh);
  }
  return piece;
}

void FurnitureStock::add_credits(const std::vector<std::string>& credits) {
  credits_.insert(credits.begin(), credits.end());
}

std::vector<std::string> FurnitureStock::take_credits() {
  std::vector<std::string> credits(credits_.begin(), credits_.end());
  credits_.clear();
  return credits;
}

}  // namespace segsim::worlds
