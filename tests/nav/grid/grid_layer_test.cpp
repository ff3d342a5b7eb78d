/// Layers of growing maps: what is stored stays where it lies, what was added holds the fill,
/// and memory that was used before is zero again.

#include "nav/grid/grid_layer.h"

#include <thread>
#include <vector>

#include <gmock/gmock.h>

#include "core/random.h"

namespace segsim::nav {
namespace {

/// The same cells without any plane: a copy at every growth.
struct PlainLayer {
  int width, height;
  float fill;
  std::vector<float> cells =
      std::vector<float>(static_cast<std::size_t>(width * height), fill);

  float& at(int x, int y) { return cells[static_cast<std::size_t>(y * width + x)]; }
  void grow(const Margins& added) {
    PlainLayer larger{width + added.left + added.right, height + added.bottom + added.top,
                      fill};
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) larger.at(x + added.left, y + added.bottom) = at(x, y);
    }
    *this = larger;
  }
};

class GridLayerGrowth : public testing::TestWithParam<float> {};

TEST_P(GridLayerGrowth, KeepsCellsAndFillsNewOnes) {
  core::RandomStream random(5, "grid_layer");
  GridLayer<float> layer(20, 30, GetParam());
  PlainLayer plain{20, 30, GetParam()};
  for (int round = 0; round < 40; ++round) {  // Planes are replaced on the way.
    for (int k = 0; k < 50; ++k) {
      const int x = static_cast<int>(random.index(static_cast<std::size_t>(plain.width)));
      const int y = static_cast<int>(random.index(static_cast<std::size_t>(plain.height)));
      layer(x, y) = plain.at(x, y) = static_cast<float>(random.uniform(1.0, 2.0));
    }
    const auto cells = [&] {
      return random.chance(0.4) ? static_cast<int>(random.index(30)) : 0;
    };
    const Margins added{cells(), cells(), cells(), cells()};
    layer.grow(added);
    plain.grow(added);
    ASSERT_EQ(layer.width_cells(), plain.width);
    ASSERT_EQ(layer.height_cells(), plain.height);
    for (int y = 0; y < plain.height; ++y) {
      for (int x = 0; x < plain.width; ++x) ASSERT_EQ(layer(x, y), plain.at(x, y));
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Fills, GridLayerGrowth, testing::Values(0.0F, 1.0F));

TEST(GridLayer, GrowsInItsPlaneUntilThatIsFull) {
  GridLayer<int> layer(100, 100);
  layer(3, 4) = 7;
  const int* cell = &layer(3, 4);
  layer.grow({50, 0, 0, 50});
  EXPECT_EQ(&layer(53, 4), cell);
  layer.grow({2000, 0, 0, 0});
  EXPECT_EQ(layer(2053, 4), 7);
  EXPECT_NE(&layer(2053, 4), cell);
}

TEST(GridLayer, IndicesAreThoseOfEveryLayerMadeAlike) {
  GridLayer<int> layer(40, 50, 9);
  GridLayer<std::uint8_t> other;
  other.cover_like(layer);
  for (const Cell& cell : {Cell(0, 0), Cell(39, 49), Cell(17, 3)}) {
    EXPECT_EQ(layer.index_of(cell), other.index_of(cell));
    EXPECT_EQ(layer.cell_of(layer.index_of(cell)), cell);
    EXPECT_EQ(layer.plane() + layer.index_of(cell), &layer(cell.x, cell.y));
  }
  // Growth inside of the plane leaves indices as they are.
  const std::ptrdiff_t before = layer.index_of({5, 5});
  layer.grow({10, 20, 0, 0});
  EXPECT_EQ(layer.index_of({15, 25}), before);
  EXPECT_NE(other.index_of({15, 25}), before);
  other(1, 1) = 3;
  other.cover_like(layer);
  EXPECT_EQ(other.index_of({15, 25}), before);
  EXPECT_EQ(other(11, 21), 3);
}

TEST(GridLayer, ARimOfZerosLiesAroundEveryWindow) {
  GridLayer<int> layer(30, 30, 5);
  for (int round = 0; round < 200; ++round) {
    const Cell size(layer.width_cells(), layer.height_cells());
    for (int k = -1; k <= size.x; ++k) {
      ASSERT_EQ(layer.plane()[layer.index_of({k, -1})], 0);
      ASSERT_EQ(layer.plane()[layer.index_of({k, size.y})], 0);
    }
    for (int k = -1; k <= size.y; ++k) {
      ASSERT_EQ(layer.plane()[layer.index_of({-1, k})], 0);
      ASSERT_EQ(layer.plane()[layer.index_of({size.x, k})], 0);
    }
    layer.grow({1, 0, 0, 1});
  }
}

TEST(GridLayer, MemoryOfAnEarlierLayerIsZeroAgain) {
  for (int round = 0; round < 20; ++round) {
    GridLayer<std::uint64_t> layer(200 + round, 150);
    for (int y = 0; y < layer.height_cells(); ++y) {
      for (int x = 0; x < layer.width_cells(); ++x) {
        ASSERT_EQ(layer(x, y), 0U);
        if ((x + y + round) % 3 == 0) layer(x, y) = ~std::uint64_t{0};
      }
    }
    layer.grow({30, 30, 30, 30});
    ASSERT_EQ(layer(0, 0), 0U);
  }
}

TEST(GridLayer, SeveralThreadsMayMakeLayers) {
  std::vector<std::thread> threads;
  std::vector<int> wrong(4, 0);
  for (std::size_t k = 0; k < wrong.size(); ++k) {
    threads.emplace_back([&, k] {
      for (int round = 0; round < 50; ++round) {
        GridLayer<int> layer(100, 100);
        for (int y = 0; y < 100; ++y) {
          for (int x = 0; x < 100; ++x) {
            wrong[k] += layer(x, y) != 0 ? 1 : 0;
            layer(x, y) = round + 1;
          }
        }
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(wrong, testing::Each(0));
}

TEST(GridLayer, AnImageCanBeReadAsOne) {
  core::Image<std::uint8_t> image(4, 3);
  image(2, 1) = 8;
  GridLayer<std::uint8_t> layer(4, 3);
  layer(2, 1) = 9;
  const GridView<std::uint8_t> of_image(image), of_layer(layer);
  EXPECT_EQ(of_image(2, 1), 8);
  EXPECT_EQ(of_layer(2, 1), 9);
  EXPECT_TRUE(same_size(of_image, of_layer));
  EXPECT_FALSE(same_size(of_image, GridView<std::uint8_t>()));
  EXPECT_TRUE(GridView<std::uint8_t>().empty());
}

}  // namespace
}  // namespace segsim::nav
