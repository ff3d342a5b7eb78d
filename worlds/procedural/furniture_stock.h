#pragma once

/// @file
/// Furniture for one home: models of a library, a few for each kind, and shapes of our own for
/// kinds that the library has not.

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "worlds/mesh/furniture/furniture_catalogue.h"
#include "worlds/procedural/furniture_table.h"
#include "worlds/procedural/procedural_furniture.h"

namespace segsim::worlds {

class FurnitureStock {
 public:
  /// No models: everything is made from the seed.
  FurnitureStock() = default;
  /// @param models  Of a furniture folder; those that the table does not list are not used.
  /// @param seed  Chooses at most three models of each kind, so that a home has a style.
  /// @param boxes  Every model is a plain box of its size, which takes no time to load.
  /// @param textures  Outlives the stock.
  FurnitureStock(const std::vector<FurnitureModel>& models, FurniturePool pool,
                 std::uint64_t seed, bool boxes, const TextureReader& textures);

  /// A model of that kind, or make_furniture() where there is none that is narrow enough.
  /// @throws InputError if the model cannot be loaded.
  [[nodiscard]] Furniture make(FurnitureKind kind, FurnitureStyle style, std::uint64_t seed,
                               SurfaceLibrary& surfaces, const FurnitureSize& size = {});

  /// Counts each once.
  void add_credits(const std::vector<std::string>& credits);
  /// Those added since the last call, in order.
  [[nodiscard]] std::vector<std::string> take_credits();

 private:
  struct Loaded;
  [[nodiscard]] const FurnitureModel* choose(FurnitureKind kind, std::uint64_t seed,
                                             const FurnitureSize& size) const;
  const Loaded& loaded(const FurnitureModel& model);

  std::map<FurnitureKind, std::vector<FurnitureModel>> of_kind_;
  std::map<std::string, std::shared_ptr<const Loaded>> loaded_;
  std::set<std::string> credits_;
  bool boxes_ = false;
  const TextureReader* textures_ = nullptr;
};

}  // namespace segsim::worlds
