#include "worlds/masks/mask_simulator.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <string_view>

#include "core/check.h"
#include "core/random.h"
#include "core/render.h"
#include "worlds/masks/internal/mask_shapes.h"

namespace segsim::worlds {
namespace {

using core::RandomStream;
using internal::Shape;

constexpr double kReferenceWidth_px = 320.0;
/// Classes that such segmenters mix up: as published, and their neighbours in homes.
constexpr std::array<std::pair<std::string_view, std::string_view>, 17> kLookAlikes{
    {{"table", "cabinet"},
     {"table", "desk"},
     {"dining table", "desk"},
     {"dining table", "cabinet"},
     {"whiteboard", "wall"},
     {"whiteboard", "blackboard"},
     {"door", "wall"},
     {"door", "cabinet"},
     {"monitor", "tv"},
     {"monitor", "whiteboard"},
     {"sofa", "armchair"},
     {"couch", "chair"},
     {"couch", "bed"},
     {"refrigerator", "cabinet"},
     {"window", "picture"},
     {"cabinet", "shelf"},
     {"chair", "stool"}}};

struct Pixel {
  std::uint16_t class_id = 0, id = 0;
  bool operator==(const Pixel&) const = default;
};

/// Draws of one operator on one object of one view.
struct Draws {
  std::uint64_t seed = 0;
  std::uint32_t frame = 0;

  [[nodiscard]] RandomStream of(std::string_view operation, std::uint32_t object) const {
    return {seed, operation, std::uint64_t{frame} << 32U | object};
  }
};

/// What the truth shows: a thing, all of a stuff class, or things merged into one.
struct TrueSegment {
  std::uint16_t class_id = 0;
  bool thing = false;
  std::uint32_t object = 0;  ///< core::panoptic_id, names the draws.
  Shape shape;
  int area_px = 0;
};

/// A mask on its way to the picture.
struct Mask {
  double score = 0.0;
  std::uint16_t class_id = 0;
  bool thing = false;
  Shape shape;
};

double normal_cdf(double z) { return 0.5 * std::erfc(-z / std::numbers::sqrt2); }

/// One run of the operators on one view.
class Run {
 public:
  Run(const ExactView& view, const std::vector<core::SceneClass>& classes,
      const MaskNoise& noise, std::uint64_t seed)
      : view_(view),
        classes_(classes),
        noise_(noise),
        draws_{seed, view.frame},
        image_(view.semantic.width_px(), view.semantic.height_px()),
        scale_(image_.width / kReferenceWidth_px) {}

  [[nodiscard]] core::FrameMasks simulate() {
    std::vector<TrueSegment> segments = true_segments();
    const std::size_t seen = segments.size();
    merge_touching(segments);
    std::vector<Mask> masks;
    for (const TrueSegment& segment : segments) {
      if (!is_missed(segment)) add_masks(segment, masks);
    }
    hallucinate(seen, masks);
    return painted(masks);
  }

 private:
  [[nodiscard]] const core::SceneClass* find_class(std::uint16_t id) const {
    const auto found = std::find_if(classes_.begin(), classes_.end(),
                                    [id](const core::SceneClass& c) { return c.id == id; });
    return found == classes_.end() || id == 0 ? nullptr : &*found;
  }

  [[nodiscard]] std::vector<TrueSegment> true_segments() const;
  void merge_touching(std::vector<TrueSegment>& segments) const;
  [[nodiscard]] std::set<std::pair<std::uint32_t, std::uint32_t>> touching_pairs() const;
  [[nodiscard]] bool is_missed(const TrueSegment& segment) const;
  void add_masks(const TrueSegment& segment, std::vector<Mask>& masks) const;
  [[nodiscard]] Shape leaked(Shape shape, std::uint32_t object) const;
  [[nodiscard]] std::uint16_t named_class(const TrueSegment& segment) const;
  [[nodiscard]] std::uint16_t other_class(std::uint16_t class_id, RandomStream& random) const;
  [[nodiscard]] std::uint32_t view_sector(const TrueSegment& segment) const;
  void hallucinate(std::size_t true_segments, std::vector<Mask>& masks) const;
  [[nodiscard]] core::FrameMasks painted(std::vector<Mask>& masks) const;

  const ExactView& view_;
  const std::vector<core::SceneClass>& classes_;
  const MaskNoise& noise_;
  Draws draws_;
  cv::Size image_;
  double scale_;  ///< Pixels here per pixel at the reference width.
};

std::vector<TrueSegment> Run::true_segments() const {
  struct Extent {
    int x0, y0, x1, y1, area_px;
  };
  const auto key_of = [&](const Pixel& pixel) -> std::uint32_t {
    const core::SceneClass* c = find_class(pixel.class_id);
    if (c == nullptr) return 0;
    return core::panoptic_id(c->id, c->thing ? pixel.id : std::uint16_t{0});
  };
  core::Image<std::uint32_t> keys(image_.width, image_.height);
  std::map<std::uint32_t, Extent> extents;
  // Looked up once a run of equal pixels.
  Pixel last;
  std::uint32_t key = 0;
  Extent* extent = nullptr;
  for (int y = 0; y < image_.height; ++y) {
    for (int x = 0; x < image_.width; ++x) {
      const Pixel pixel{view_.semantic(x, y), view_.instance(x, y)};
      if (pixel != last) {
        last = pixel;
        key = key_of(pixel);
        extent = key == 0 ? nullptr
                          : &extents.try_emplace(key, Extent{x, y, x, y, 0}).first->second;
      }
      keys(x, y) = key;
      if (extent == nullptr) continue;
      *extent = {std::min(extent->x0, x), extent->y0, std::max(extent->x1, x), y,
                 extent->area_px + 1};
    }
  }
  std::vector<TrueSegment> segments;
  for (const auto& [object, e] : extents) {
    if (e.area_px < noise_.smallest_px * scale_ * scale_) continue;
    TrueSegment segment;
    segment.class_id = static_cast<std::uint16_t>(object >> 16U);
    segment.thing = find_class(segment.class_id)->thing;
    segment.object = object;
    segment.area_px = e.area_px;
    segment.shape.box = {e.x0, e.y0, e.x1 - e.x0 + 1, e.y1 - e.y0 + 1};
    segment.shape.set = cv::Mat1b(segment.shape.box.size(), std::uint8_t{0});
    for (int y = e.y0; y <= e.y1; ++y) {
      for (int x = e.x0; x <= e.x1; ++x) {
        if (keys(x, y) == object) segment.shape.set(y - e.y0, x - e.x0) = 255;
      }
    }
    segments.push_back(std::move(segment));
  }
  return segments;
}

/// Things of one class that come within reach of each other, lower id first.
std::set<std::pair<std::uint32_t, std::uint32_t>> Run::touching_pairs() const {
  const int reach_px =
      std::max(1, static_cast<int>(std::lround(scale_ * noise_.merge_reach_px)));
  std::set<std::pair<std::uint32_t, std::uint32_t>> pairs;
  const auto note = [&](int x, int y, int other_x, int other_y) {
    if (other_x < 0 || other_x >= image_.width || other_y >= image_.height) return;
    const std::uint16_t a = view_.instance(x, y), b = view_.instance(other_x, other_y);
    const std::uint16_t class_id = view_.semantic(x, y);
    if (a == b || class_id != view_.semantic(other_x, other_y)) return;
    pairs.insert(std::minmax(core::panoptic_id(class_id, a), core::panoptic_id(class_id, b)));
  };
  for (int y = 0; y < image_.height; ++y) {
    for (int x = 0; x < image_.width; ++x) {
      if (view_.instance(x, y) == 0) continue;
      for (int dy = 0; dy <= reach_px; ++dy) {
        for (int dx = dy == 0 ? 1 : dy - reach_px; dx <= reach_px - dy; ++dx) {
          note(x, y, x + dx, y + dy);
        }
      }
    }
  }
  return pairs;
}

void Run::merge_touching(std::vector<TrueSegment>& segments) const {
  if (noise_.merge <= 0.0) return;
  std::map<std::uint32_t, std::size_t> place;
  for (std::size_t i = 0; i < segments.size(); ++i) {
    if (segments[i].thing) place[segments[i].object] = i;
  }
  std::set<std::uint32_t> swallowed;
  for (const auto& [a, b] : touching_pairs()) {
    if (!place.contains(a) || !place.contains(b)) continue;
    if (swallowed.contains(a) || swallowed.contains(b)) continue;
    RandomStream random(draws_.seed ^ b, "mask.merge", std::uint64_t{view_.frame} << 32U | a);
    if (!random.chance(noise_.merge)) continue;
    TrueSegment& into = segments[place[a]];
    into.shape = united(into.shape, segments[place[b]].shape);
    into.area_px += segments[place[b]].area_px;
    swallowed.insert(b);
  }
  std::erase_if(segments,
                [&](const TrueSegment& s) { return s.thing && swallowed.contains(s.object); });
}

/// A stationary first-order process in time, as a sum over past draws: needs no state.
bool Run::is_missed(const TrueSegment& segment) const {
  const double rho = std::pow(noise_.miss_correlation, 1.0 / noise_.miss_step);
  double z = 0.0, variance = 0.0, weight = 1.0;
  for (std::uint32_t past = 0; weight > 0.01; ++past, weight *= rho) {
    // Draws before the first view have numbers of their own: the difference wraps around.
    RandomStream random(draws_.seed, "mask.miss",
                        std::uint64_t{view_.frame - past} << 32U | segment.object);
    z += weight * random.normal();
    variance += weight * weight;
    if (rho == 0.0) break;
  }
  const cv::Rect& box = segment.shape.box;
  const bool cut_off =
      box.x == 0 || box.y == 0 || box.br().x == image_.width || box.br().y == image_.height;
  const double share = segment.area_px / static_cast<double>(image_.area());
  const double p_miss = noise_.miss_always +
                        noise_.miss_small * std::exp(-share / noise_.miss_area) +
                        (segment.thing && cut_off ? noise_.miss_border : 0.0);
  return normal_cdf(z / std::sqrt(variance)) < p_miss;
}

Shape Run::leaked(Shape shape, std::uint32_t object) const {
  RandomStream random = draws_.of("mask.leak", object);
  if (!random.chance(noise_.leak)) return shape;
  const double area_px =
      shape.area_px() * random.uniform(noise_.leak_share_min, noise_.leak_share_max);
  if (random.chance(noise_.leak_outward)) {
    const int width_px = static_cast<int>(std::ceil(3.0 * scale_));
    const Shape ring = ring_around(shape, width_px, image_);
    if (ring.area_px() == 0) return shape;  // It fills the image.
    // About a third of the blob falls on the mask itself.
    return united(shape, random_blob(ring, 1.6 * area_px, image_, random));
  }
  Shape rest = without(shape, random_blob(shape, 1.2 * area_px, image_, random));
  return rest.area_px() > 0 ? rest : shape;
}

/// The direction from which an object is seen, in steps of 60 degrees.
std::uint32_t Run::view_sector(const TrueSegment& segment) const {
  const cv::Rect& box = segment.shape.box;
  const glm::dvec2 px{box.x + 0.5 * box.width, box.y + 0.5 * box.height};
  const glm::dvec3 ray =
      view_.T_world_camera.rotation() * view_.intrinsics.back_project(px, 1.0);
  const double turn = (std::atan2(ray.y, ray.x) + std::numbers::pi) / (2.0 * std::numbers::pi);
  return static_cast<std::uint32_t>(turn * 6.0) % 6U;
}

std::uint16_t Run::other_class(std::uint16_t class_id, RandomStream& random) const {
  const std::string& name = find_class(class_id)->name;
  std::vector<std::uint16_t> listed, all;
  for (const core::SceneClass& c : classes_) {
    if (c.id == class_id) continue;
    all.push_back(c.id);
    const bool alike = std::any_of(kLookAlikes.begin(), kLookAlikes.end(), [&](const auto& p) {
      return (p.first == name && p.second == c.name) ||
             (p.second == name && p.first == c.name);
    });
    if (alike) listed.push_back(c.id);
  }
  if (all.empty()) return class_id;
  const bool from_list = random.chance(noise_.confuse_listed) && !listed.empty();
  const std::vector<std::uint16_t>& choice = from_list ? listed : all;
  return choice[random.index(static_cast<std::uint32_t>(choice.size()))];
}

std::uint16_t Run::named_class(const TrueSegment& segment) const {
  const double p_systematic = noise_.confuse * noise_.confuse_systematic;
  RandomStream systematic(draws_.seed, "mask.look_alike",
                          std::uint64_t{view_sector(segment)} << 32U | segment.object);
  if (systematic.chance(p_systematic)) return other_class(segment.class_id, systematic);
  RandomStream random = draws_.of("mask.confuse", segment.object);
  // So that both together have the probability asked for.
  const double p_random = (noise_.confuse - p_systematic) / std::max(1.0 - p_systematic, 1e-9);
  return random.chance(p_random) ? other_class(segment.class_id, random) : segment.class_id;
}

void Run::add_masks(const TrueSegment& segment, std::vector<Mask>& masks) const {
  RandomStream border = draws_.of("mask.border", segment.object);
  const double shift_px = scale_ * noise_.border_shift_px * border.normal();
  Shape shape = with_moved_border(segment.shape, shift_px, scale_ * noise_.border_wobble_px,
                                  scale_ * noise_.wobble_length_px, image_, border);
  if (shape.area_px() == 0) return;
  shape = leaked(std::move(shape), segment.object);

  // Scores are uniform in [0.3, 0.9] but for a part that knows how good the mask is.
  RandomStream random = draws_.of("mask.score", segment.object);
  const double rho = noise_.score_correlation;
  const double goodness = std::clamp((iou(shape, segment.shape) - 0.90) / 0.07, -2.0, 1.5);
  const double score = std::clamp(
      0.6 + 0.173 * rho * goodness + std::sqrt(1.0 - rho * rho) * random.uniform(-0.3, 0.3),
      0.05, 0.95);
  Mask mask{score, named_class(segment), false, shape};
  mask.thing = find_class(mask.class_id)->thing;

  RandomStream split = draws_.of("mask.split", segment.object);
  if (segment.thing && mask.thing && split.chance(noise_.split)) {
    Mask part = mask;
    part.shape = random_part(shape, split);
    part.score *= 0.99;
    mask.shape = without(shape, part.shape);
    masks.push_back(std::move(part));
  }
  masks.push_back(mask);
  RandomStream again = draws_.of("mask.duplicate", segment.object);
  if (segment.thing && again.chance(noise_.duplicate)) {
    mask.shape = common(
        shape, random_blob(shape, shape.area_px() * again.uniform(0.15, 0.5), image_, again));
    mask.score = std::clamp(score + again.uniform(-0.1, 0.1), 0.05, 0.95);
    masks.push_back(std::move(mask));
  }
}

void Run::hallucinate(std::size_t true_segments, std::vector<Mask>& masks) const {
  RandomStream random = draws_.of("mask.hallucinate", 0);
  std::vector<std::uint16_t> classes;
  for (const core::SceneClass& c : classes_) {
    if (c.name != "floor" && c.name != "wall") classes.push_back(c.id);
  }
  if (classes.empty()) return;
  const Shape everywhere{{0, 0, image_.width, image_.height},
                         cv::Mat1b(image_, std::uint8_t{255})};
  // Poisson, by Knuth's product of uniforms.
  const double none = std::exp(-noise_.hallucinate * static_cast<double>(true_segments));
  for (double product = random.uniform(); product > none; product *= random.uniform()) {
    const double share =
        noise_.hallucinated_area * std::exp(noise_.hallucinated_spread * random.normal());
    Mask mask;
    mask.class_id = classes[random.index(static_cast<std::uint32_t>(classes.size()))];
    mask.thing = find_class(mask.class_id)->thing;
    mask.score = random.uniform(0.25, 0.6);
    mask.shape = random_blob(everywhere, std::max(share * image_.area(), 1.0), image_, random);
    masks.push_back(std::move(mask));
  }
}

/// Ids 1 ... n in random order.
std::vector<std::uint16_t> shuffled_ids(std::size_t n, RandomStream random) {
  std::vector<std::uint16_t> ids(n);
  for (std::size_t i = 0; i < n; ++i) ids[i] = static_cast<std::uint16_t>(i + 1);
  for (std::size_t i = n; i > 1; --i) {
    std::swap(ids[i - 1], ids[random.index(static_cast<std::uint32_t>(i))]);
  }
  return ids;
}

core::FrameMasks Run::painted(std::vector<Mask>& masks) const {
  std::stable_sort(masks.begin(), masks.end(),
                   [](const Mask& a, const Mask& b) { return a.score < b.score; });
  cv::Mat1i owner(image_, -1);
  for (std::size_t i = 0; i < masks.size(); ++i) {
    if (masks[i].shape.set.empty()) continue;
    owner(masks[i].shape.box).setTo(static_cast<int>(i), masks[i].shape.set);
  }
  std::vector<bool> visible(masks.size(), false);
  for (const int i : owner) {
    if (i >= 0) visible[static_cast<std::size_t>(i)] = true;
  }
  std::vector<std::uint16_t> id_of(masks.size(), 0);
  std::vector<std::size_t> things;
  for (std::size_t i = 0; i < masks.size(); ++i) {
    if (visible[i] && masks[i].thing) things.push_back(i);
  }
  const auto ids = shuffled_ids(things.size(), draws_.of("mask.ids", 0));
  for (std::size_t k = 0; k < things.size(); ++k) id_of[things[k]] = ids[k];

  core::FrameMasks result;
  result.semantic = result.instance = core::Image<std::uint16_t>(image_.width, image_.height);
  result.confidence = core::Image<std::uint8_t>(image_.width, image_.height);
  for (int y = 0; y < image_.height; ++y) {
    for (int x = 0; x < image_.width; ++x) {
      if (owner(y, x) < 0) continue;
      const auto i = static_cast<std::size_t>(owner(y, x));
      result.semantic(x, y) = masks[i].class_id;
      result.instance(x, y) = id_of[i];
      result.confidence(x, y) = static_cast<std::uint8_t>(std::lround(masks[i].score * 255.0));
    }
  }
  result.segments = core::segments_of(result);
  return result;
}

}  // namespace

MaskSimulator::MaskSimulator(std::vector<core::SceneClass> classes, const MaskNoise& noise,
                             std::uint64_t seed, const std::string& scene)
    : classes_(std::move(classes)), noise_(noise), seed_(core::hash64(scene, seed)) {
  SEGSIM_CHECK(noise.miss_correlation >= 0.0 && noise.miss_correlation < 1.0,
               std::to_string(noise.miss_correlation));
}

core::FrameMasks MaskSimulator::simulate(const ExactView& view) const {
  SEGSIM_CHECK(view.semantic.width_px() == view.instance.width_px() &&
                   view.semantic.height_px() == view.instance.height_px() &&
                   !view.semantic.empty(),
               "label images of one view");
  return Run(view, classes_, noise_, seed_).simulate();
}

}  // namespace segsim::worlds
