#include "sim/ground/ground_grid.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "core/random.h"
#include "tests/box_mesh.h"

namespace segsim::sim {
namespace {

GridFrame frame_of(int width, int height, double cell_m) {
  return {.origin_m = {0.0, 0.0}, .cell_m = cell_m, .width = width, .height = height};
}

TEST(DistanceTransform, MatchesBruteForce) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    core::RandomStream random(seed, "mask");
    GridMask mask(17, 23, 0);
    const double density = seed == 0 ? 0.0 : random.uniform(0.005, 0.3);
    for (auto& value : mask.pixels()) value = random.chance(density) ? 1 : 0;
    const core::Image<float> distance = distance_to_marked(mask, 0.1);
    for (int j = 0; j < 23; ++j) {
      for (int i = 0; i < 17; ++i) {
        double best = std::numeric_limits<double>::infinity();
        for (int b = 0; b < 23; ++b) {
          for (int a = 0; a < 17; ++a) {
            if (mask(a, b) != 0) best = std::min(best, 0.1 * std::hypot(a - i, b - j));
          }
        }
        if (std::isinf(best)) {
          EXPECT_TRUE(std::isinf(distance(i, j)));
        } else {
          EXPECT_NEAR(distance(i, j), best, 1e-6) << seed << ": " << i << ", " << j;
        }
      }
    }
  }
}

TEST(MarkBand, MatchesDenseSamplingOfRandomTriangles) {
  const GridFrame frame = frame_of(20, 20, 0.1);
  core::RandomStream random(5, "triangles");
  for (int trial = 0; trial < 30; ++trial) {
    TriangleMesh mesh;
    for (int k = 0; k < 3; ++k) {
      mesh.positions_m.emplace_back(random.uniform(0.1, 1.9), random.uniform(0.1, 1.9),
                                    random.uniform(-0.5, 1.5));
    }
    mesh.triangles.emplace_back(0, 1, 2);
    GridMask mask(20, 20, 0);
    mark_band(mesh, 0.2, 0.8, frame, mask);
    GridMask sampled(20, 20, 0);
    GridMask near_sampled(20, 20, 0);
    constexpr int kSteps = 400;
    for (int a = 0; a <= kSteps; ++a) {
      for (int b = 0; a + b <= kSteps; ++b) {
        const float u = static_cast<float>(a) / kSteps;
        const float v = static_cast<float>(b) / kSteps;
        const glm::vec3 p = mesh.positions_m[0] * (1 - u - v) + mesh.positions_m[1] * u +
                            mesh.positions_m[2] * v;
        const glm::ivec2 c = frame.cell_of({p.x, p.y});
        // What lies in the slice must be marked; what is marked must lie near the slice.
        if (p.z > 0.2F && p.z < 0.8F) sampled(c.x, c.y) = 1;
        if (p.z > 0.18F && p.z < 0.82F) {
          for (int dj = -1; dj <= 1; ++dj) {
            for (int di = -1; di <= 1; ++di) {
              const glm::ivec2 n = frame.cell_of({p.x + 0.01 * di, p.y + 0.01 * dj});
              if (frame.contains(n)) near_sampled(n.x, n.y) = 1;
            }
          }
        }
      }
    }
    for (int j = 0; j < 20; ++j) {
      for (int i = 0; i < 20; ++i) {
        // A sample within rounding of a grid line may fall on its other side.
        if (sampled(i, j) != 0) {
          const bool marked_near = mask(i, j) != 0 || mask(std::max(0, i - 1), j) != 0 ||
                                   mask(i, std::max(0, j - 1)) != 0;
          EXPECT_TRUE(marked_near);
        }
        if (mask(i, j) != 0) {
          EXPECT_NE(near_sampled(i, j), 0) << trial << ": " << i << ", " << j;
        }
      }
    }
  }
}

TEST(MarkBand, WallOnGridLineFillsOneColumn) {
  TriangleMesh mesh;
  append_box(mesh, {0.5F, 0.2F, 0.0F}, {0.5F, 0.6F, 1.0F});
  GridMask mask(10, 10, 0);
  mark_band(mesh, 0.1, 0.9, frame_of(10, 10, 0.1), mask);
  for (int j = 2; j < 6; ++j) {
    EXPECT_EQ(mask(4, j), 0);
    EXPECT_EQ(mask(5, j), 1);
    EXPECT_EQ(mask(6, j), 0);
  }
}

TEST(MarkBand, SkipsWhatIsAboveOrBelow) {
  TriangleMesh mesh;
  append_box(mesh, {0.2F, 0.2F, 0.7F}, {0.8F, 0.8F, 1.0F});
  append_box(mesh, {0.2F, 0.2F, 0.0F}, {0.8F, 0.8F, 0.05F});
  GridMask mask(10, 10, 0);
  mark_band(mesh, 0.06, 0.6, frame_of(10, 10, 0.1), mask);
  for (const auto value : mask.pixels()) EXPECT_EQ(value, 0);
}

TEST(MarkFloor, CoversExactlyItsCellsWithoutSeam) {
  TriangleMesh mesh;
  append_floor(mesh, 0.2F, 0.3F, 0.8F, 0.7F);
  append_box(mesh, {0.0F, 0.0F, 0.5F}, {1.0F, 1.0F, 0.6F});  // Too high to be floor.
  GridMask mask(10, 10, 0);
  mark_floor(mesh, 0.06, frame_of(10, 10, 0.1), mask);
  for (int j = 0; j < 10; ++j) {
    for (int i = 0; i < 10; ++i) {
      EXPECT_EQ(mask(i, j) != 0, i >= 2 && i < 8 && j >= 3 && j < 7) << i << ", " << j;
    }
  }
}

TEST(LabelPieces, RanksBySize) {
  GridMask mask(6, 3, 0);
  mask(0, 0) = 1;                              // One cell.
  mask(1, 1) = 1;                              // Only a corner touches: another piece.
  for (int i = 3; i < 6; ++i) mask(i, 2) = 1;  // Three cells.
  const auto piece = label_pieces(mask);
  EXPECT_EQ(piece(4, 2), 1);
  EXPECT_EQ(piece(0, 0), 2);
  EXPECT_EQ(piece(1, 1), 3);
  EXPECT_EQ(piece(2, 0), 0);
}

}  // namespace
}  // namespace segsim::sim
