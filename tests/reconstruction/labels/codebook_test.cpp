#include "reconstruction/labels/internal/codebook.h"

#include <filesystem>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "core/random.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr std::int64_t kSurfels = 400;

/// Four places with two features each: [surfels, 1] and [surfels, 3].
struct Cloud {
  Cloud() {
    core::RandomStream random(3, "codebook_test");
    for (std::int64_t s = 0; s < kSurfels; ++s) {
      const auto place = static_cast<int>(s % 4), kind = static_cast<int>(s / 4 % 2);
      feature.push_back(static_cast<float>(0.8 * kind + 0.01 * random.normal()));
      for (const double x : {10.0 * place, -5.0 * place, 0.0}) {
        position.push_back(static_cast<float>(x + 0.01 * random.normal()));
      }
      leaf.push_back(place * 2 + kind);
    }
  }
  [[nodiscard]] Tensor features() const {
    return device_tensor(feature, torch::kFloat32, torch::kCPU).view({-1, 1});
  }
  [[nodiscard]] Tensor places() const {
    return device_tensor(position, torch::kFloat32, torch::kCPU).view({-1, 3});
  }
  std::vector<float> feature, position;
  std::vector<std::int64_t> leaf;
};

TEST(Codebook, GroupsAreSurfelsOfLikePlacesAndFeatures) {
  const Cloud cloud;
  Codebook book(kSurfels, 16, 3, 5, 1, torch::kCPU);
  EXPECT_EQ(book.level(), Codebook::Level::kNone);
  book.assign_coarse(cloud.features(), cloud.places());
  EXPECT_EQ(book.level(), Codebook::Level::kCoarse);
  book.assign_fine(cloud.features());
  EXPECT_EQ(book.level(), Codebook::Level::kFine);
  std::map<std::int64_t, std::set<std::int64_t>> kinds;  // Group -> leaves of the scene.
  for (std::int64_t s = 0; s < kSurfels; ++s) {
    const std::int64_t group = book.group().data_ptr<std::int64_t>()[s];
    ASSERT_GE(group, 0);
    ASSERT_LT(group, book.size());
    kinds[group].insert(cloud.leaf[static_cast<std::size_t>(s)]);
  }
  EXPECT_GE(kinds.size(), 8U);
  for (const auto& [group, leaves] : kinds) EXPECT_EQ(leaves.size(), 1U) << group;
}

TEST(Codebook, MeansAreThoseOfTheGroups) {
  const Cloud cloud;
  Codebook book(kSurfels, 4, 2, 5, 1, torch::kCPU);
  book.assign_coarse(cloud.features(), cloud.places());
  const Tensor means = book.means(cloud.features());
  std::map<std::int64_t, std::pair<double, int>> sums;
  for (std::int64_t s = 0; s < kSurfels; ++s) {
    auto& [sum, count] = sums[book.group().data_ptr<std::int64_t>()[s]];
    sum += static_cast<double>(cloud.feature[static_cast<std::size_t>(s)]);
    ++count;
  }
  for (std::int64_t g = 0; g < book.size(); ++g) {
    const auto found = sums.find(g);
    const double mean = found == sums.end() ? 0.0 : found->second.first / found->second.second;
    EXPECT_NEAR(means.data_ptr<float>()[g], mean, 1e-5) << g;
  }
}

TEST(Codebook, MoreGroupsThanSurfelsAndLoadedStatesAreFine) {
  const Cloud cloud;
  Codebook book(kSurfels, 1000, 2, 2, 1, torch::kCPU);
  book.assign_coarse(cloud.features(), cloud.places());
  book.assign_fine(cloud.features());
  const auto file = std::filesystem::path(::testing::TempDir()) / "codebook.state";
  StateWriter out("codebook");
  book.save(out);
  out.write(file);
  Codebook other(kSurfels, 1000, 2, 2, 1, torch::kCPU);
  other.load(StateReader(file, "codebook"));
  EXPECT_TRUE(other.group().equal(book.group()));
  EXPECT_EQ(other.level(), Codebook::Level::kFine);
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace segsim::reconstruction::internal
