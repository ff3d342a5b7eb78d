/// @file
/// Every instruction set draws the picture of double precision, and they agree with one
/// another. Highway chooses among the sets of the processor; its portable one, which this
/// processor would never choose, is compiled into a test of its own from the same file
/// (SEGSIM_ONLY_TARGET names it).

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <hwy/targets.h>

#include "core/file_io.h"
#include "core/random.h"
#include "renderer/cpu_renderer.h"
#include "renderer/reference_renderer.h"
#include "renderer/scene/simd_target.h"
#include "tests/renderer/blending_oracle.h"
#include "tests/renderer/scenes.h"
#include "tests/renderer/surfel_weights.h"

namespace segsim::renderer {
namespace {

using core::Channels;
using core::Frame;
using testing::kOddCamera;
using testing::SceneKind;
using testing::View;

/// Pictures of every kind of loop: keys in registers, in memory, the first hits, none, all.
std::vector<RenderOptions> all_loops() {
  return {{.top_k = 4, .threads = 1},
          {.top_k = 1, .depth = DepthMode::kExpected, .threads = 1},
          {.top_k = 12, .threads = 1},
          {.top_k = 3, .top_k_rule = TopKRule::kFirst, .threads = 1},
          {.top_k = kAllSurfels, .threads = 1},
          {.compat = Compat::kInria, .threads = 1},
          {.compat = Compat::kGsplat, .threads = 1}};
}

constexpr SceneKind kScenes[] = {SceneKind::kOutside, SceneKind::kInside, SceneKind::kRoom};

std::vector<View> views() {
  std::vector<View> views;
  for (const SceneKind kind : kScenes) {
    for (const int i : {1, 6}) views.push_back(testing::view_of(kind, i));
  }
  return views;
}

/// Where double precision decides, the picture is right.
void expect_double_precision(const View& view, const Frame& frame) {
  const testing::BlendingOracle oracle(view.scene, view.pose, kOddCamera);
  double colour = 0.0, alpha = 0.0, depth = 0.0, normal = 0.0;
  int certain = 0;
  for (int y = 0; y < kOddCamera.height_px; ++y) {
    for (int x = 0; x < kOddCamera.width_px; ++x) {
      const testing::OraclePixel expected = oracle.pixel(x, y);
      if (!expected.certain) continue;
      ++certain;
      const core::Rgb8& rgb = frame.rgb(x, y);
      const glm::dvec3 off = glm::abs(glm::dvec3(rgb.r, rgb.g, rgb.b) -
                                      255.0 * glm::clamp(expected.colour, 0.0, 1.0));
      colour = std::max(colour, (std::max({off.r, off.g, off.b}) - 0.5) / 255.0);
      alpha = std::max(alpha, std::abs(static_cast<double>(frame.alpha(x, y)) - 1.0 +
                                       expected.transmittance));
      const glm::dvec3 mean = glm::normalize(expected.normal);
      normal = std::max(normal, glm::length(glm::dvec3(frame.normal(x, y)) - mean));
      if (!expected.depth_certain) continue;
      const auto depth_m = static_cast<double>(frame.depth_m(x, y));
      depth = std::max(depth, std::abs(depth_m / expected.median_depth_m - 1.0));
    }
  }
  EXPECT_GT(certain, 0.97 * kOddCamera.width_px * kOddCamera.height_px);
  EXPECT_LT(colour, 1e-3);
  EXPECT_LT(alpha, 1e-4);
  EXPECT_LT(depth, 1e-4);
  EXPECT_LT(normal, 1e-3);
}

/// Rounding may turn a threshold: in a few pixels, and there by one faint surfel.
void expect_agreement(const Frame& a, const Frame& b) {
  int off = 0, labels_off = 0;
  for (std::size_t i = 0; i < a.alpha.size(); ++i) {
    const core::Rgb8 p = a.rgb.pixels()[i], q = b.rgb.pixels()[i];
    const int colour =
        std::max({std::abs(p.r - q.r), std::abs(p.g - q.g), std::abs(p.b - q.b)});
    off += colour > 1 || std::abs(a.alpha.pixels()[i] - b.alpha.pixels()[i]) > 1e-4F ? 1 : 0;
    EXPECT_LE(colour, 4);
    labels_off += a.semantic.pixels()[i] != b.semantic.pixels()[i] ||
                          a.instance.pixels()[i] != b.instance.pixels()[i]
                      ? 1
                      : 0;
  }
  const auto pixels = static_cast<double>(a.alpha.size());
  EXPECT_LE(off, 2e-3 * pixels);
  EXPECT_LE(labels_off, 2e-3 * pixels);
}

#ifdef SEGSIM_ONLY_TARGET

TEST(InstructionSets, PortableOneIsThatOfDoublePrecision) {
  ASSERT_EQ(simd_target(), SEGSIM_ONLY_TARGET);
  for (const View& view : views()) {
    for (const RenderOptions& options : all_loops()) {
      const Frame frame = make_cpu_renderer(view.scene, options)
                              ->render(view.pose, kOddCamera, Channels::kAll);
      const Frame reference = make_reference_renderer(view.scene, options)
                                  ->render(view.pose, kOddCamera, Channels::kAll);
      expect_agreement(frame, reference);
      if (options.top_k == 4 && options.compat == Compat::kExact) {
        expect_double_precision(view, frame);
      }
    }
  }
}

#else

/// Whether a * b + c is rounded once: the only thing in which instruction sets differ.
bool fused(std::int64_t target) { return target <= HWY_AVX2; }

constexpr core::CameraIntrinsics kRecordedCamera{256, 192, 150.0, 150.0, 127.3, 96.4};

/// Tilted discs, from numbers that every C library computes alike: many small ones, and large
/// ones about the image's upper edge.
std::shared_ptr<const SurfelCloud> tilted_discs() {
  core::RandomStream random(1, "tilted_discs");
  const auto uniform = [&](double lo, double hi) {
    return static_cast<float>(random.uniform(lo, hi));
  };
  auto cloud = std::make_shared<SurfelCloud>();
  for (int i = 0; i < 24'000; ++i) {
    testing::Surfel s;
    const bool large = i % 12 == 0;
    const float z_m = uniform(1.5, 4.0);
    const float y_px = large ? uniform(-8.0, 6.0) : uniform(0.0, 192.0);
    s.position_m = {uniform(-1.5, 1.5), (y_px - 96.4F) / 150.0F * z_m, z_m};
    s.R_world_surfel = {uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0),
                        uniform(-1.0, 1.0)};
    s.scale_m = {uniform(0.003, 0.05), uniform(0.003, 0.02)};
    if (large) s.scale_m *= 8.0F;
    s.opacity = uniform(0.05, large ? 0.5 : 0.95);
    s.colour = {uniform(0.0, 1.0), uniform(0.0, 1.0), uniform(0.0, 1.0)};
    s.semantic = static_cast<std::uint16_t>(random.index(6));
    s.instance = static_cast<std::uint16_t>(random.index(20));
    testing::add(*cloud, s);
  }
  return cloud;
}

/// Few processors have several sets with fused multiply-add to compare: the picture that all
/// of them draw is recorded. (Rows 8 to 15 of a tile once had another rounding where a vector
/// has eight lanes; normals showed it, colours one pixel in millions.)
TEST(InstructionSets, ThisOneDrawsTheRecordedPicture) {
  const std::int64_t available = hwy::SupportedTargets();
  if (!fused(available & -available)) {
    GTEST_SKIP() << simd_target() << " does not fuse multiplications with additions";
  }
  RenderOptions options;
  options.threads = 1;
  const Frame frame = make_cpu_renderer(tilted_discs(), options)
                          ->render(core::CameraPose(), kRecordedCamera, Channels::kAll);
  const auto digest = [](const auto& image) {
    return core::sha256_hex(std::as_bytes(std::span(image.pixels()))).substr(0, 16);
  };
  EXPECT_EQ(digest(frame.rgb), "0b40b8d1f5cdaee2");
  EXPECT_EQ(digest(frame.depth_m), "897f7e7f37a03e99");
  EXPECT_EQ(digest(frame.normal), "16f19ab25e0648f6");
  EXPECT_EQ(digest(frame.alpha), "81cf6b2b3f12ecca");
  EXPECT_EQ(digest(frame.semantic), "775904c9c4d8e993");
  EXPECT_EQ(digest(frame.confidence), "5f54623d66ca51f1");
}

template <class T>
void expect_equal_bits(const core::Image<T>& a, const core::Image<T>& b, const char* plane) {
  ASSERT_EQ(a.size(), b.size()) << plane;
  EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(T)), 0) << plane;
}

void expect_equal_bits(const Frame& a, const Frame& b) {
  expect_equal_bits(a.rgb, b.rgb, "rgb");
  expect_equal_bits(a.depth_m, b.depth_m, "depth");
  expect_equal_bits(a.normal, b.normal, "normal");
  expect_equal_bits(a.alpha, b.alpha, "alpha");
  expect_equal_bits(a.semantic, b.semantic, "semantic");
  expect_equal_bits(a.instance, b.instance, "instance");
  expect_equal_bits(a.confidence, b.confidence, "confidence");
  expect_equal_bits(a.instance_confidence, b.instance_confidence, "instance confidence");
}

std::vector<Frame> render_all(const std::vector<View>& views) {
  std::vector<Frame> frames;
  for (const View& view : views) {
    for (const RenderOptions& options : all_loops()) {
      frames.push_back(make_cpu_renderer(view.scene, options)
                           ->render(view.pose, kOddCamera, Channels::kAll));
    }
  }
  frames.push_back(make_cpu_renderer(tilted_discs(), {.threads = 1})
                       ->render(core::CameraPose(), kRecordedCamera, Channels::kAll));
  return frames;
}

/// Makes Highway choose among `targets` only; 0: among all again.
void choose_from(std::int64_t targets) {
  hwy::SetSupportedTargetsForTest(targets);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST(InstructionSets, OfThisProcessorAgreeWithEachOtherAndDoublePrecision) {
  const std::vector<View> all_views = views();
  const std::int64_t available = hwy::SupportedTargets();
  std::vector<Frame> best;
  std::vector<std::string> tested;
  for (std::int64_t bits = available; bits != 0; bits &= bits - 1) {
    choose_from(bits & -bits);
    const std::string name = simd_target();
    // A set that was not compiled would silently be another one.
    if (name != hwy::TargetName(bits & -bits)) continue;
    SCOPED_TRACE(name);
    tested.push_back(name);
    const std::vector<Frame> frames = render_all(all_views);
    if (best.empty()) best = frames;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      SCOPED_TRACE(i);
      expect_agreement(frames[i], best[i]);
      if (fused(bits & -bits) && fused(available & -available)) {
        expect_equal_bits(frames[i], best[i]);
      }
      const auto contributions = static_cast<double>(best[i].stats.contributions);
      EXPECT_NEAR(static_cast<double>(frames[i].stats.contributions), contributions,
                  1e-3 * contributions);
    }
    for (std::size_t v = 0; v < all_views.size(); ++v) {
      SCOPED_TRACE(v);
      expect_double_precision(all_views[v], frames[v * all_loops().size()]);
    }
  }
  choose_from(0);
  EXPECT_GE(tested.size(), 2U);
  std::string names;
  for (const std::string& name : tested) names += name + " ";
  RecordProperty("targets", names);
}

#endif

}  // namespace
}  // namespace segsim::renderer
