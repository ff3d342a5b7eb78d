#include "reconstruction/datasets/mask_files.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include <opencv2/imgcodecs.hpp>

#include "core/check.h"
#include "core/system/remakeable_file.h"
#include "reconstruction/datasets/internal/image_files.h"
#include "reconstruction/datasets/internal/json_file.h"
#include "reconstruction/datasets/labels_file.h"

namespace segsim::reconstruction {
namespace {

namespace fs = std::filesystem;
using core::FrameMasks;
using core::InputError;
using core::SceneClass;
using internal::JsonNode;
using IdImage = core::Image<std::uint16_t>;

constexpr const char* kInfoFile = "masks.yaml";

template <class Pixel>
void write_png(const fs::path& file, const core::Image<Pixel>& image, int type) {
  const cv::Mat pixels(image.height_px(), image.width_px(), type,
                       const_cast<Pixel*>(image.data()));
  std::vector<unsigned char> bytes;
  SEGSIM_CHECK(cv::imencode(".png", pixels, bytes), file.string());
  core::write_remakeable_file(file, [&](std::ostream& stream) {
    stream.write(reinterpret_cast<const char*>(bytes.data()),
                 static_cast<std::streamsize>(bytes.size()));
  });
}

/// An intact id image of the expected size.
IdImage read_ids(const fs::path& file, int width_px, int height_px) {
  const internal::ImageSize size = internal::check_image_file(file);
  if (size != internal::ImageSize{width_px, height_px}) {
    throw InputError::expected(
        file.string(),
        std::to_string(width_px) + "x" + std::to_string(height_px) +
            " pixels, as the recording has",
        std::to_string(size.width_px) + "x" + std::to_string(size.height_px));
  }
  return internal::read_id_image(file);
}

/// Stems of the files in `folder` that end in `suffix`.
std::vector<std::string> names_with(const fs::path& folder, const std::string& suffix) {
  std::vector<std::string> names;
  if (!fs::is_directory(folder)) return names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.size() > suffix.size() && name.ends_with(suffix)) {
      names.push_back(name.substr(0, name.size() - suffix.size()));
    }
  }
  std::sort(names.begin(), names.end());
  return names;
}

const SceneClass* find_class(const std::vector<SceneClass>& classes, const std::string& name) {
  const auto found = std::find_if(classes.begin(), classes.end(),
                                  [&](const SceneClass& c) { return c.name == name; });
  return found == classes.end() ? nullptr : &*found;
}

/// Class id -> is it a thing; ids that are missing are no classes.
std::map<std::uint16_t, bool> things_of(const std::vector<SceneClass>& classes) {
  std::map<std::uint16_t, bool> things;
  for (const SceneClass& c : classes) things[c.id] = c.thing;
  return things;
}

/// Refuses classes that are not in the table, and clears the ids of stuff and void.
void tidy_labels(FrameMasks& masks, const std::vector<SceneClass>& classes,
                 const fs::path& semantic_file) {
  const std::map<std::uint16_t, bool> things = things_of(classes);
  for (std::size_t i = 0; i < masks.semantic.size(); ++i) {
    const std::uint16_t class_id = masks.semantic.pixels()[i];
    const auto known = things.find(class_id);
    if (class_id != 0 && known == things.end()) {
      throw InputError::expected(semantic_file.string(), "class ids of the scene's table",
                                 std::to_string(class_id));
    }
    if (class_id == 0 || !known->second) masks.instance.pixels()[i] = 0;
  }
}

class FolderMasks : public MaskSet {
 public:
  FolderMasks(fs::path folder, MaskSetInfo info, std::vector<std::string> names)
      : folder_(std::move(folder)), info_(std::move(info)), names_(std::move(names)) {}

  const MaskSetInfo& info() const override { return info_; }
  const std::vector<std::string>& names() const override { return names_; }
  FrameMasks read_as_stored(const std::string& name) const override {
    const internal::ImageSize size = internal::check_image_file(ids_of(name));
    return read(name, size.width_px, size.height_px);
  }

 protected:
  [[nodiscard]] fs::path file(const std::string& name) const { return folder_ / name; }
  /// The image that says how large a view is.
  [[nodiscard]] virtual fs::path ids_of(const std::string& name) const = 0;

 private:
  fs::path folder_;
  MaskSetInfo info_;
  std::vector<std::string> names_;
};

class SegsimMasks final : public FolderMasks {
 public:
  using FolderMasks::FolderMasks;
  MaskLayout layout() const override { return MaskLayout::kSegsim; }
  fs::path ids_of(const std::string& name) const override { return file(name + "_sem.png"); }

  FrameMasks read(const std::string& name, int width_px, int height_px) const override {
    const fs::path semantic_file = ids_of(name);
    FrameMasks masks;
    masks.semantic = read_ids(semantic_file, width_px, height_px);
    masks.instance = read_ids(file(name + "_ins.png"), width_px, height_px);
    const IdImage scores = read_ids(file(name + "_conf.png"), width_px, height_px);
    tidy_labels(masks, info().classes, semantic_file);
    masks.confidence = core::Image<std::uint8_t>(width_px, height_px);
    for (std::size_t i = 0; i < scores.size(); ++i) {
      masks.confidence.pixels()[i] = static_cast<std::uint8_t>(scores.pixels()[i]);
    }
    masks.segments = core::segments_of(masks);
    apply_entries(JsonNode::load(file(name + ".json")), masks);
    return masks;
  }

 private:
  /// Takes scores and crowds, and checks that every segment has an entry of its class.
  void apply_entries(const JsonNode& json, FrameMasks& masks) const {
    if (!json.is_list()) json.fail("a list of masks", "something else");
    struct Entry {
      float score = 0.0F;
      bool crowd = false;
    };
    std::map<std::pair<std::int64_t, std::uint16_t>, Entry> entries;
    for (std::size_t i = 0; i < json.size(); ++i) {
      const JsonNode entry = json.at(i);
      const SceneClass* label = find_class(info().classes, entry.text("label"));
      if (label == nullptr)
        entry.child("label").fail("a class of masks.yaml", "'" + entry.text("label") + "'");
      const double score = entry.number("score");
      if (score < 0.0 || score > 1.0) {
        entry.child("score").fail("a score in [0, 1]", std::to_string(score));
      }
      const bool crowd = entry.has("iscrowd") && entry.child("iscrowd").as_integer(0, 1) == 1;
      if (crowd && !label->thing) entry.child("iscrowd").fail("0 for stuff", "1");
      entries[{entry.child("id").as_integer(0, 65535), label->id}] = {
          static_cast<float>(score), crowd};
    }
    for (core::MaskSegment& segment : masks.segments) {
      const auto found = entries.find({segment.id, segment.class_id});
      if (found == entries.end()) {
        json.fail("an entry for id " + std::to_string(segment.id) + " of class " +
                      std::to_string(segment.class_id) + ", which the images show",
                  "none");
      }
      segment.score = found->second.score;
      segment.crowd = found->second.crowd;
    }
  }
};

class GroundedSamMasks final : public FolderMasks {
 public:
  using FolderMasks::FolderMasks;
  MaskLayout layout() const override { return MaskLayout::kGroundedSam; }
  fs::path ids_of(const std::string& name) const override { return file(name + ".png"); }

  FrameMasks read(const std::string& name, int width_px, int height_px) const override {
    const IdImage values = read_ids(ids_of(name), width_px, height_px);
    const JsonNode root = JsonNode::load(file(name + ".json"));
    const std::map<std::uint16_t, Entry> entries =
        read_entries(root.is_list() ? root : root.child("mask"));
    FrameMasks masks{IdImage(width_px, height_px),
                     IdImage(width_px, height_px),
                     core::Image<std::uint8_t>(width_px, height_px),
                     {}};
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::uint16_t value = values.pixels()[i];
      if (value == 0) continue;
      const auto entry = entries.find(value);
      if (entry == entries.end()) {
        root.fail("an entry for value " + std::to_string(value) + ", which the image shows",
                  "none");
      }
      if (entry->second.label == nullptr) continue;  // Not a class of the scene: void.
      masks.semantic.pixels()[i] = entry->second.label->id;
      masks.instance.pixels()[i] = entry->second.label->thing ? value : std::uint16_t{0};
      masks.confidence.pixels()[i] =
          static_cast<std::uint8_t>(std::lround(entry->second.score * 255.0));
    }
    masks.segments = core::segments_of(masks);
    return masks;
  }

 private:
  struct Entry {
    const SceneClass* label = nullptr;
    double score = 0.0;
  };

  [[nodiscard]] std::map<std::uint16_t, Entry> read_entries(const JsonNode& list) const {
    std::map<std::uint16_t, Entry> entries;
    for (std::size_t i = 0; i < list.size(); ++i) {
      const JsonNode node = list.at(i);
      const auto value = static_cast<std::uint16_t>(node.child("value").as_integer(0, 65535));
      if (value == 0) continue;  // "background"
      Entry entry{find_class(info().classes, node.text("label")), 1.0};
      if (node.has("logit")) entry.score = node.number("logit");  // A probability, by habit.
      if (entry.score < 0.0 || entry.score > 1.0) {
        node.child("logit").fail("a score in [0, 1]", std::to_string(entry.score));
      }
      if (!entries.emplace(value, entry).second) {
        node.child("value").fail("a value that is not used above", std::to_string(value));
      }
    }
    return entries;
  }
};

class PanopticReconMasks final : public FolderMasks {
 public:
  using FolderMasks::FolderMasks;
  MaskLayout layout() const override { return MaskLayout::kPanopticRecon; }
  fs::path ids_of(const std::string& name) const override {
    return file("semantic_image/" + name + ".png");
  }

  FrameMasks read(const std::string& name, int width_px, int height_px) const override {
    const fs::path semantic_file = ids_of(name);
    FrameMasks masks;
    masks.semantic = read_ids(semantic_file, width_px, height_px);
    masks.instance = read_ids(file("instance_image/" + name + ".png"), width_px, height_px);
    tidy_labels(masks, info().classes, semantic_file);
    masks.confidence = core::Image<std::uint8_t>(width_px, height_px);
    for (std::size_t i = 0; i < masks.semantic.size(); ++i) {
      masks.confidence.pixels()[i] = masks.semantic.pixels()[i] == 0 ? 0 : 255;
    }
    masks.segments = core::segments_of(masks);
    return masks;
  }
};

/// Masks may know classes that the scene does not have, under ids of their own.
void expect_same_classes(const fs::path& file, const std::vector<SceneClass>& scene,
                         const std::vector<SceneClass>& masks) {
  for (const SceneClass& c : masks) {
    for (const SceneClass& s : scene) {
      if ((s.id == c.id) == (s.name == c.name)) continue;
      throw InputError::expected(file.string(),
                                 "class " + std::to_string(s.id) + " to be '" + s.name + "'",
                                 "class " + std::to_string(c.id) + ", '" + c.name + "'");
    }
  }
}

MaskSetInfo without_file(const std::vector<SceneClass>& classes, const fs::path& folder,
                         const std::string& source) {
  if (classes.empty()) {
    throw InputError::expected(
        folder.string(), std::string(kInfoFile) + " or the classes of a scene", "neither");
  }
  MaskSetInfo info;
  info.source = source;
  info.classes = classes;
  return info;
}

}  // namespace

bool is_mask_set(const fs::path& folder) { return fs::exists(folder / kInfoFile); }

std::unique_ptr<MaskSet> open_masks(const fs::path& folder,
                                    const std::vector<SceneClass>& classes) {
  if (!fs::is_directory(folder)) {
    throw InputError::expected(folder.string(), "a folder of masks", "no such folder");
  }
  if (is_mask_set(folder)) {
    MaskSetInfo info = read_mask_set_info(folder / kInfoFile);
    if (!classes.empty()) expect_same_classes(folder / kInfoFile, classes, info.classes);
    return std::make_unique<SegsimMasks>(folder, std::move(info),
                                         names_with(folder, "_sem.png"));
  }
  if (!names_with(folder, "_sem.png").empty()) {
    throw InputError::expected((folder / kInfoFile).string(),
                               "the list of classes; it is written last", "no such file");
  }
  if (auto names = names_with(folder / "semantic_image", ".png"); !names.empty()) {
    return std::make_unique<PanopticReconMasks>(
        folder, without_file(classes, folder, "semantic_image and instance_image"), names);
  }
  if (auto names = names_with(folder, ".json"); !names.empty()) {
    return std::make_unique<GroundedSamMasks>(
        folder, without_file(classes, folder, "Grounded-SAM export"), names);
  }
  throw InputError::expected(folder.string(),
                             "masks (masks.yaml with <n>_sem.png; <n>.png with <n>.json; or "
                             "semantic_image/ with instance_image/)",
                             "none of these files");
}

void write_masks(const fs::path& folder, const std::string& name, const FrameMasks& masks,
                 const std::vector<SceneClass>& classes) {
  auto list = nlohmann::ordered_json::array();
  for (const core::MaskSegment& segment : masks.segments) {
    const auto label = std::find_if(classes.begin(), classes.end(), [&](const SceneClass& c) {
      return c.id == segment.class_id;
    });
    SEGSIM_CHECK(label != classes.end(), "class " + std::to_string(segment.class_id));
    nlohmann::ordered_json entry;
    entry["id"] = segment.id;
    entry["label"] = label->name;
    entry["score"] = std::round(segment.score * 1e4) / 1e4;
    entry["area"] = segment.area_px;
    if (segment.crowd) entry["iscrowd"] = 1;
    for (const float side :
         {segment.box.x0, segment.box.y0, segment.box.width_px(), segment.box.height_px()}) {
      entry["bbox"].push_back(std::lround(side));
    }
    list.push_back(std::move(entry));
  }
  write_png(folder / (name + "_sem.png"), masks.semantic, CV_16UC1);
  write_png(folder / (name + "_ins.png"), masks.instance, CV_16UC1);
  write_png(folder / (name + "_conf.png"), masks.confidence, CV_8UC1);
  core::write_file_atomically(folder / (name + ".json"),
                              [&](std::ostream& stream) { stream << list.dump(1) << '\n'; });
}

}  // namespace segsim::reconstruction
