#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <glm/common.hpp>

#include "worlds/surface/internal/distance_volume.h"

namespace segsim::worlds::internal {
namespace {

/// Marching cubes works on dense pieces of this many blocks; a piece has a sample more to
/// every side than cells.
constexpr int kPieceBlocks = 4;
constexpr int kCells = kPieceBlocks * kBlockSide;
constexpr int kSamples = kCells + 1;
/// A distance of 0 would put vertices onto samples, where three edges meet and welding by edge
/// ends. Of the truncation.
constexpr float kLeastShare = 1e-3F;

/// One dense piece, handed to VTK in coordinates of its own samples.
class Piece {
 public:
  Piece() {
    values_->SetNumberOfTuples(kSamples * kSamples * kSamples);
    image_->SetDimensions(kSamples, kSamples, kSamples);
    image_->GetPointData()->SetScalars(values_);
    known_.resize(static_cast<std::size_t>(values_->GetNumberOfTuples()));
    contour_->SetInputData(image_);
    contour_->SetValue(0, 0.0);
    contour_->ComputeNormalsOff();
    contour_->ComputeGradientsOff();
    contour_->ComputeScalarsOff();
  }

  /// @param place  In pieces. @return  False if there is no surface in it.
  bool fill(const DistanceVolume& volume, const glm::ivec3& place, float truncation,
            float min_weight);
  vtkPolyData* contour() {
    values_->Modified();
    image_->Modified();
    contour_->Update();
    return contour_->GetOutput();
  }
  /// Are all eight samples of a cell seen, and one of them well?
  [[nodiscard]] bool is_known(const glm::ivec3& cell) const {
    std::uint8_t best = kUnknown;
    for (int c = 0; c < 8; ++c) {
      const std::uint8_t k =
          known_[slot(cell.x + (c & 1), cell.y + (c >> 1 & 1), cell.z + (c >> 2))];
      if (k == kUnknown) return false;
      best = std::max(best, k);
    }
    return best == kSeenWell;
  }

 private:
  enum : std::uint8_t { kUnknown, kSeen, kSeenWell };

  static std::size_t slot(int x, int y, int z) {
    return static_cast<std::size_t>((z * kSamples + y) * kSamples + x);
  }

  vtkNew<vtkFloatArray> values_;
  vtkNew<vtkImageData> image_;
  vtkNew<vtkFlyingEdges3D> contour_;
  std::vector<std::uint8_t> known_;  ///< kUnknown, kSeen, kSeenWell
};

bool Piece::fill(const DistanceVolume& volume, const glm::ivec3& place, float truncation,
                 float min_weight) {
  // Unknown samples count as free here; cells that have one are dropped afterwards.
  std::fill_n(values_->GetPointer(0), known_.size(), truncation);
  std::fill(known_.begin(), known_.end(), kUnknown);
  const float least = kLeastShare * truncation;
  bool inside = false, outside = false;
  for (int bz = 0; bz <= kPieceBlocks; ++bz) {
    for (int by = 0; by <= kPieceBlocks; ++by) {
      for (int bx = 0; bx <= kPieceBlocks; ++bx) {
        const VoxelBlock* block = volume.find(place * kPieceBlocks + glm::ivec3(bx, by, bz));
        if (block == nullptr) continue;
        for (int k = 0; k < kBlockVoxels; ++k) {
          const int x = bx * kBlockSide + k % kBlockSide;
          const int y = by * kBlockSide + k / kBlockSide % kBlockSide;
          const int z = bz * kBlockSide + k / (kBlockSide * kBlockSide);
          const auto at = static_cast<std::size_t>(k);
          if (x > kCells || y > kCells || z > kCells || block->weight[at] <= 0.0F) continue;
          const float d = block->distance[at];
          const std::size_t here = slot(x, y, z);
          values_->SetValue(static_cast<vtkIdType>(here),
                            std::abs(d) < least ? std::copysign(least, d) : d);
          known_[here] = block->weight[at] < min_weight ? kSeen : kSeenWell;
          (d < 0.0F ? inside : outside) = true;
        }
      }
    }
  }
  return inside && outside;
}

/// Joins the vertices of all pieces: a vertex belongs to the edge between two samples.
class Welder {
 public:
  explicit Welder(double voxel_m) : voxel_m_(voxel_m) {}

  /// @param p  In samples of the piece whose first sample is `origin`.
  std::uint32_t vertex(const glm::dvec3& p, const glm::ivec3& origin) {
    // The axis of the edge is the one along which p is farthest from a sample.
    const glm::dvec3 off = glm::abs(p - glm::round(p));
    const int axis = off.x >= off.y && off.x >= off.z ? 0 : off.y >= off.z ? 1 : 2;
    glm::dvec3 start = glm::round(p);
    start[axis] = std::floor(p[axis]);
    const glm::ivec3 sample = origin + glm::ivec3(start);
    const PlaceKey key = place_key(sample.x, sample.y, sample.z);
    auto& known = edges_[static_cast<std::size_t>(axis)];
    const auto [found, is_new] =
        known.try_emplace(key, static_cast<std::uint32_t>(mesh.positions_m.size()));
    if (is_new) {
      glm::dvec3 place(sample);
      place[axis] += p[axis] - start[axis];
      mesh.positions_m.emplace_back(place * voxel_m_);
    }
    return found->second;
  }

  sim::TriangleMesh mesh;

 private:
  double voxel_m_;
  std::array<std::unordered_map<PlaceKey, std::uint32_t>, 3> edges_;
};

void append_piece(const Piece& piece, vtkPolyData& contour, const glm::ivec3& origin,
                  Welder& welder) {
  vtkCellArray* cells = contour.GetPolys();
  vtkIdType count = 0;
  const vtkIdType* ids = nullptr;
  for (cells->InitTraversal(); cells->GetNextCell(count, ids) != 0;) {
    std::array<glm::dvec3, 3> p;
    for (std::size_t i = 0; i < 3; ++i) contour.GetPoint(ids[i], &p[i].x);
    const glm::ivec3 cell(glm::floor((p[0] + p[1] + p[2]) / 3.0));
    if (!piece.is_known(glm::clamp(cell, 0, kCells - 1))) continue;
    // VTK's normals point along the gradient's descent: inwards for distances.
    const glm::uvec3 triangle(welder.vertex(p[0], origin), welder.vertex(p[2], origin),
                              welder.vertex(p[1], origin));
    welder.mesh.triangles.push_back(triangle);
  }
}

}  // namespace

sim::TriangleMesh extract_surface(const DistanceVolume& volume, double truncation_m,
                                  double min_weight) {
  // A cell belongs to the piece of its first sample, which may lie in the block before.
  std::set<PlaceKey> pieces;
  const auto piece_of = [](int block) {
    return static_cast<int>(std::floor(static_cast<double>(block) / kPieceBlocks));
  };
  for (const VoxelBlock& block : volume.blocks) {
    for (int c = 0; c < 8; ++c) {
      const glm::ivec3 b = block.place - glm::ivec3(c & 1, c >> 1 & 1, c >> 2);
      pieces.insert(place_key(piece_of(b.x), piece_of(b.y), piece_of(b.z)));
    }
  }
  Piece piece;
  Welder welder(volume.voxel_m);
  for (const PlaceKey key : pieces) {
    const glm::ivec3 place = place_of(key);
    if (!piece.fill(volume, place, static_cast<float>(truncation_m),
                    static_cast<float>(min_weight))) {
      continue;
    }
    append_piece(piece, *piece.contour(), place * kCells, welder);
  }
  return std::move(welder.mesh);
}

}  // namespace segsim::worlds::internal
