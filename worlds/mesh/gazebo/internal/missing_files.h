#pragma once

/// @file
/// The files that a world names and that are not there, for one message about all of them.

#include <cstdint>
#include <string>
#include <vector>

namespace segsim::worlds::internal {

enum class MissingKind : std::uint8_t {
  kModel,
  kMesh,
  kMaterial,     ///< Name of a script, or a material library of an OBJ file.
  kTexture,      ///< Of a script or a <pbr> material.
  kMeshTexture,  ///< Named in a mesh file; reading the file warns of it again.
};

struct MissingFile {
  MissingKind kind = MissingKind::kModel;
  std::string uri;   ///< As the world has it.
  std::string user;  ///< The first that names it, a model or a file.
  int count = 1;     ///< How many name it.
};

class MissingFiles {
 public:
  void add(MissingKind kind, const std::string& uri, const std::string& user);
  [[nodiscard]] const std::vector<MissingFile>& files() const { return files_; }
  [[nodiscard]] bool has(MissingKind kind) const;
  /// "mesh model://bowl/bowl.dae (bowl and 1 more)".
  [[nodiscard]] static std::string text(const MissingFile& file);
  /// All of them in one line.
  [[nodiscard]] std::string text() const;

 private:
  std::vector<MissingFile> files_;
};

}  // namespace segsim::worlds::internal
