#include "reconstruction/labels/internal/pixel_store.h"

#include <filesystem>
#include <set>

#include <gtest/gtest.h>

namespace segsim::reconstruction::internal {
namespace {

/// Pixel p of four sees surfels p and p + 1 of five, with weights 0.2 and 0.6.
struct Batch {
  explicit Batch(std::int64_t frame) {
    for (std::int32_t p = 0; p < 4; ++p) {
      surfel.insert(surfel.end(), {p, p + 1});
      weight.insert(weight.end(), {0.2F, 0.6F});
      start.push_back(static_cast<std::int32_t>(surfel.size()));
    }
    batch.frame = frame;
    batch.weights = {4, 8, start.data(), surfel.data(), weight.data()};
    batch.instance = instance.data();
    targets.class_index = {3, 3, 1, 1};
    targets.mask_index = {0, 1, -1, -1};
  }
  std::vector<std::int32_t> start{0}, surfel;
  std::vector<float> weight;
  std::vector<std::uint16_t> instance{8, 9, 9, 0};
  PanopticBatch batch;
  BatchTargets targets;
};

class PixelStoreTest : public ::testing::Test {
 protected:
  void keep(PixelStore& store, std::int64_t frame,
            const std::vector<std::int64_t>& candidates) {
    const Batch b(frame);
    store.keep(b.batch, maker_.make(b.batch.weights), b.targets, candidates);
  }
  BlendMatrixMaker maker_{5, torch::kCPU};
  Tensor values_ =
      torch::arange(5, torch::TensorOptions().dtype(torch::kFloat32)).view({5, 1});
};

TEST_F(PixelStoreTest, KeptPixelsAreRenderedAsTheirBatchWas) {
  PixelStore store(2, 100, 1, torch::kCPU);
  keep(store, 7, {1, 3});
  keep(store, 4, {0});
  EXPECT_EQ(store.frame(), (std::vector<std::int64_t>{7, 7, 4}));
  EXPECT_EQ(store.class_index(), (std::vector<std::int64_t>{3, 1, 3}));
  EXPECT_EQ(store.mask_id(), (std::vector<std::int64_t>{9, 0, 8}));
  const Tensor rendered = store.blend(values_);  // p + 3 / 4.
  ASSERT_EQ(rendered.size(0), 3);
  EXPECT_NEAR(rendered.data_ptr<float>()[0], 1.75, 1e-6);
  EXPECT_NEAR(rendered.data_ptr<float>()[1], 3.75, 1e-6);
  EXPECT_NEAR(rendered.data_ptr<float>()[2], 0.75, 1e-6);
}

TEST_F(PixelStoreTest, EveryFrameHasItsShareOnce) {
  PixelStore store(3, 5, 1, torch::kCPU);  // Two of each frame.
  keep(store, 0, {});
  EXPECT_EQ(store.size(), 0);
  keep(store, 0, {0, 1, 2, 3});
  EXPECT_EQ(store.size(), 2);
  keep(store, 0, {0, 1, 2, 3});
  EXPECT_EQ(store.size(), 2);
  keep(store, 1, {2});
  EXPECT_EQ(store.size(), 3);
  EXPECT_NEAR(store.blend(values_).data_ptr<float>()[2], 2.75, 1e-6);
}

TEST_F(PixelStoreTest, LoadedStoresAreTheSame) {
  PixelStore store(2, 4, 1, torch::kCPU);
  keep(store, 1, {0, 1, 2, 3});
  const auto file = std::filesystem::path(::testing::TempDir()) / "pixels.state";
  StateWriter out("pixels");
  store.save(out);
  out.write(file);
  PixelStore other(2, 4, 1, torch::kCPU);
  other.load(StateReader(file, "pixels"));
  EXPECT_TRUE(other.blend(values_).equal(store.blend(values_)));
  EXPECT_EQ(other.mask_id(), store.mask_id());
  keep(other, 1, {0, 1});  // The frame has its share already.
  EXPECT_EQ(other.size(), store.size());
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace segsim::reconstruction::internal
