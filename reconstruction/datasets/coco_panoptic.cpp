#include "reconstruction/datasets/coco_panoptic.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "reconstruction/datasets/internal/image_files.h"
#include "reconstruction/datasets/internal/json_file.h"

namespace segsim::reconstruction {
namespace {

namespace fs = std::filesystem;
using core::FrameMasks;
using core::InputError;
using core::SceneClass;
using internal::JsonNode;
using IdImage = core::Image<std::uint16_t>;

constexpr std::int64_t kMostId = 0xFFFFFF, kMostNumber = 0xFFFF;

struct Segment {
  std::uint16_t class_id = 0;
  std::uint16_t number = 0;  ///< 0: stuff.
  bool crowd = false;
};

struct View {
  std::string file_name;
  std::map<std::uint32_t, Segment> segments;  ///< By the id that the picture shows.
};

std::vector<SceneClass> read_categories(const JsonNode& list) {
  std::vector<SceneClass> classes;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const JsonNode node = list.at(i);
    SceneClass c;
    c.id = static_cast<std::uint16_t>(node.child("id").as_integer(1, kMostNumber));
    c.name = node.text("name");
    c.thing = node.child("isthing").as_integer(0, 1) == 1;
    for (const SceneClass& other : classes) {
      if (other.id == c.id) node.child("id").fail("an id that is not used above", "it again");
    }
    classes.push_back(std::move(c));
  }
  return classes;
}

const SceneClass* class_of(const std::vector<SceneClass>& classes, std::int64_t id) {
  const auto found = std::find_if(classes.begin(), classes.end(),
                                  [&](const SceneClass& c) { return c.id == id; });
  return found == classes.end() ? nullptr : &*found;
}

View read_view(const JsonNode& annotation, const std::vector<SceneClass>& classes) {
  View view;
  view.file_name = annotation.text("file_name");
  const JsonNode list = annotation.child("segments_info");
  if (!list.is_list()) list.fail("a list of segments", "something else");
  std::int64_t things = 0;
  for (std::size_t i = 0; i < list.size(); ++i) {
    const JsonNode node = list.at(i);
    const auto id = static_cast<std::uint32_t>(node.child("id").as_integer(1, kMostId));
    const std::int64_t category = node.child("category_id").as_integer(1, kMostNumber);
    const SceneClass* c = class_of(classes, category);
    if (c == nullptr) {
      node.child("category_id").fail("one of the categories", std::to_string(category));
    }
    Segment segment{c->id, 0, false};
    segment.crowd = node.has("iscrowd") && node.child("iscrowd").as_integer(0, 1) == 1;
    if (segment.crowd && !c->thing) node.child("iscrowd").fail("0 for stuff", "1");
    if (c->thing) {
      if (++things > kMostNumber) node.fail("at most 65535 things in a view", "more");
      segment.number = static_cast<std::uint16_t>(things);
    }
    if (!view.segments.emplace(id, segment).second) {
      node.child("id").fail("an id that is not used above", std::to_string(id));
    }
  }
  return view;
}

/// Gives every id of a thing one number in all views, in the order of the ids.
void number_by_scene(std::map<std::string, View>& views, const JsonNode& root) {
  std::map<std::uint32_t, std::uint16_t> numbers;
  for (const auto& [name, view] : views) {
    for (const auto& [id, segment] : view.segments) {
      if (segment.number > 0) numbers[id] = 0;
    }
  }
  if (numbers.size() > static_cast<std::size_t>(kMostNumber)) {
    root.fail("at most 65535 objects in a scene", std::to_string(numbers.size()));
  }
  std::uint16_t next = 0;
  for (auto& [id, number] : numbers) number = ++next;
  for (auto& [name, view] : views) {
    for (auto& [id, segment] : view.segments) {
      if (segment.number > 0) segment.number = numbers.at(id);
    }
  }
}

class CocoPanopticMasks final : public MaskSet {
 public:
  CocoPanopticMasks(const fs::path& json, const std::vector<SceneClass>& classes,
                    IdScope scope)
      : folder_(fs::path(json).replace_extension()) {
    const JsonNode root = JsonNode::load(json);
    info_.source = json.filename().string();
    info_.classes =
        root.has("categories") ? read_categories(root.child("categories")) : classes;
    if (info_.classes.empty())
      root.fail("the key categories, or classes of the truth", "none");
    const JsonNode list = root.child("annotations");
    if (!list.is_list()) list.fail("a list of annotations", "something else");
    for (std::size_t i = 0; i < list.size(); ++i) {
      const JsonNode annotation = list.at(i);
      View view = read_view(annotation, info_.classes);
      const std::string name = fs::path(view.file_name).stem().string();
      if (!views_.emplace(name, std::move(view)).second) {
        annotation.child("file_name")
            .fail("one annotation for a picture", "another of " + name);
      }
      names_.push_back(name);
    }
    std::sort(names_.begin(), names_.end());
    if (scope == IdScope::kScene) number_by_scene(views_, root);
  }

  MaskLayout layout() const override { return MaskLayout::kCocoPanoptic; }
  const MaskSetInfo& info() const override { return info_; }
  const std::vector<std::string>& names() const override { return names_; }

  FrameMasks read_as_stored(const std::string& name) const override {
    const internal::ImageSize size = internal::check_image_file(picture_of(name));
    return read(name, size.width_px, size.height_px);
  }

  FrameMasks read(const std::string& name, int width_px, int height_px) const override {
    const fs::path file = picture_of(name);
    const core::Image<core::Rgb8> ids = internal::read_color_image(file);
    if (ids.width_px() != width_px || ids.height_px() != height_px) {
      throw InputError::expected(
          file.string(),
          std::to_string(width_px) + "x" + std::to_string(height_px) + " pixels",
          std::to_string(ids.width_px()) + "x" + std::to_string(ids.height_px()));
    }
    const View& view = views_.at(name);
    FrameMasks masks{IdImage(width_px, height_px),
                     IdImage(width_px, height_px),
                     core::Image<std::uint8_t>(width_px, height_px),
                     {}};
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const core::Rgb8 colour = ids.pixels()[i];
      const auto id = static_cast<std::uint32_t>(colour.r + 256 * colour.g + 65536 * colour.b);
      if (id == 0) continue;
      const auto found = view.segments.find(id);
      if (found == view.segments.end()) {
        throw InputError::expected(file.string(), "ids of its segments_info",
                                   std::to_string(id));
      }
      masks.semantic.pixels()[i] = found->second.class_id;
      masks.instance.pixels()[i] = found->second.number;
      masks.confidence.pixels()[i] = 255;
    }
    masks.segments = core::segments_of(masks);
    for (core::MaskSegment& segment : masks.segments) {
      for (const auto& [id, known] : view.segments) {
        if (known.class_id == segment.class_id && known.number == segment.id) {
          segment.crowd = segment.crowd || known.crowd;
        }
      }
    }
    return masks;
  }

 private:
  [[nodiscard]] fs::path picture_of(const std::string& name) const {
    const auto found = views_.find(name);
    if (found == views_.end()) {
      throw InputError::expected(folder_.string() + ".json", "an annotation of " + name,
                                 "none");
    }
    return folder_ / fs::path(found->second.file_name).filename();
  }

  fs::path folder_;
  MaskSetInfo info_;
  std::map<std::string, View> views_;  ///< By the picture's name without ending.
  std::vector<std::string> names_;
};

}  // namespace

std::unique_ptr<MaskSet> open_coco_panoptic(const fs::path& json,
                                            const std::vector<SceneClass>& classes,
                                            IdScope scope) {
  return std::make_unique<CocoPanopticMasks>(json, classes, scope);
}

}  // namespace segsim::reconstruction
