#include "experiments/detection/view_split.h"

#include <gtest/gtest.h>

#include <set>

#include "core/error.h"
#include "core/random.h"

namespace segsim::experiments {
namespace {

perception::CocoDataset views_in(const std::vector<std::string>& scenes, int views) {
  perception::CocoDataset dataset;
  dataset.class_names = {"chair"};
  core::RandomStream random(5, "test views");
  for (const std::string& scene : scenes) {
    for (int i = 0; i < views; ++i) {
      perception::LabeledImage image;
      image.id = static_cast<std::int64_t>(dataset.images.size()) + 1;
      image.file = "images/" + std::to_string(image.id) + ".png";
      image.width_px = image.height_px = 10;
      image.scene = scene;
      image.view = {random.uniform(0.0, 4.0), random.uniform(0.0, 4.0),
                    random.uniform(-3.1, 3.1)};
      dataset.images.push_back(image);
    }
  }
  return dataset;
}

TEST(ViewSplit, NoTrainingViewIsLikeAHeldOutOne) {
  const auto dataset = views_in({"a", "b"}, 300);
  detection::ViewSplitOptions options;
  options.apart = {0.5, 0.5};
  const detection::ViewSplit split = detection::split_views(dataset, options);
  EXPECT_EQ(split.val_views.images.size(), 120U);
  EXPECT_GT(split.dropped, 0);
  EXPECT_EQ(split.train.images.size() + 120U + static_cast<std::size_t>(split.dropped), 600U);
  int same_place_other_scene = 0;
  for (const auto& train : split.train.images) {
    for (const auto& held_out : split.val_views.images) {
      const bool alike = options.apart.alike(*train.view, *held_out.view);
      if (train.scene == held_out.scene) {
        EXPECT_FALSE(alike);
      } else if (alike) {
        ++same_place_other_scene;
      }
    }
  }
  EXPECT_GT(same_place_other_scene, 0);  // Places of other scenes do not count.
}

TEST(ViewSplit, HeldOutScenesAreWhole) {
  auto dataset = views_in({"a", "b", "c"}, 40);
  const perception::ImagedScene a{"a", "1"}, b{"b", "2"}, c{"c", "3"};
  dataset.scenes = std::vector{a, b, c};
  detection::ViewSplitOptions options;
  options.val_scenes = {"b"};
  const detection::ViewSplit split = detection::split_views(dataset, options);
  EXPECT_EQ(split.val_scenes.scenes, std::vector{b});  // Each part says its own places alone.
  EXPECT_EQ(split.train.scenes, (std::vector{a, c}));
  EXPECT_EQ(split.val_scenes.images.size(), 40U);
  for (const auto& image : split.val_scenes.images) EXPECT_EQ(image.scene, "b");
  for (const auto& image : split.train.images) EXPECT_NE(image.scene, "b");
  for (const auto& image : split.val_views.images) EXPECT_NE(image.scene, "b");
}

TEST(ViewSplit, SeedDecidesAndZeroShareHoldsNothingOut) {
  const auto dataset = views_in({"a"}, 50);
  const auto ids = [&](std::uint64_t seed) {
    std::set<std::int64_t> result;
    for (const auto& image :
         detection::split_views(dataset, {0.2, {}, {}, seed}).val_views.images) {
      result.insert(image.id);
    }
    return result;
  };
  EXPECT_EQ(ids(1), ids(1));
  EXPECT_NE(ids(1), ids(2));
  const detection::ViewSplit none = detection::split_views(dataset, {0.0, {}, {}, 1});
  EXPECT_EQ(none.train.images.size(), 50U);
  EXPECT_EQ(none.dropped, 0);
}

TEST(ViewSplit, FaultsAreInputErrors) {
  auto dataset = views_in({"a"}, 4);
  EXPECT_THROW((void)detection::split_views(dataset, {0.2, {}, {"nowhere"}, 1}),
               core::InputError);
  EXPECT_THROW((void)detection::split_views(dataset, {0.2, {}, {"a"}, 1}), core::InputError);
  dataset.images[2].view.reset();
  EXPECT_THROW((void)detection::split_views(dataset, {}), core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
