#include "reconstruction/datasets/rgbd_sequence.h"

#include <array>
#include <cctype>
#include <charconv>
#include <cstdio>

#include "core/error.h"
#include "reconstruction/datasets/internal/file_sequence.h"

namespace segsim::reconstruction {
namespace {

struct LayoutRow {
  SequenceLayout layout;
  const char* word;
  const char* looks_like;  ///< For the message when nothing matches.
  bool (*matches)(const std::filesystem::path& folder);
  std::unique_ptr<RgbdSequence> (*open)(const std::filesystem::path& folder,
                                        const SequenceOptions& options);
};

constexpr std::array kLayouts{
    LayoutRow{SequenceLayout::kHololens, "hololens", "rgb/, depth/, poses.txt, K.txt",
              internal::looks_like_hololens, internal::open_hololens},
    LayoutRow{SequenceLayout::kSevenScenes, "7scenes", "frame-NNNNNN.pose.txt, intrinsics.txt",
              internal::looks_like_seven_scenes, internal::open_seven_scenes},
    LayoutRow{SequenceLayout::kScanNet, "scannet", "color/, depth/, pose/, intrinsic/",
              internal::looks_like_scannet, internal::open_scannet},
    LayoutRow{SequenceLayout::kScanNetPlusPlus, "scannetpp", "dslr/ or iphone/ with colmap/",
              internal::looks_like_scannetpp, internal::open_scannetpp},
    LayoutRow{SequenceLayout::kReplica, "replica", "traj_w_c.txt, rgb/; or traj.txt, results/",
              internal::looks_like_replica, internal::open_replica},
    LayoutRow{SequenceLayout::kTum, "tum", "rgb.txt, depth.txt, groundtruth.txt",
              internal::looks_like_tum, internal::open_tum},
    LayoutRow{SequenceLayout::kNerfstudio, "nerfstudio", "transforms.json",
              internal::looks_like_nerfstudio, internal::open_nerfstudio},
    LayoutRow{SequenceLayout::kColmap, "colmap", "sparse/0/images.bin or .txt, images/",
              internal::looks_like_colmap, internal::open_colmap},
};

template <class Value>
struct Word {
  const char* word;
  Value value;
};

template <class Value, std::size_t n>
Value parse_word(const std::array<Word<Value>, n>& words, const std::string& word,
                 const std::string& place) {
  std::string known;
  for (const auto& entry : words) {
    if (word == entry.word) return entry.value;
    known += (known.empty() ? "" : ", ") + std::string(entry.word);
  }
  throw core::InputError::expected(place, "one of " + known, "'" + word + "'");
}

}  // namespace

std::optional<std::int64_t> frame_number(const std::string& name) {
  std::size_t begin = name.size();
  while (begin > 0 && std::isdigit(static_cast<unsigned char>(name[begin - 1])) != 0) --begin;
  std::int64_t number = 0;
  const auto [end, error] =
      std::from_chars(name.data() + begin, name.data() + name.size(), number);
  if (begin == name.size() || error != std::errc{}) return std::nullopt;
  return number;
}

const PoseTrack& RgbdSequence::pose_track() const {
  static const PoseTrack kNone;
  return kNone;
}

std::string own_depth_name(std::size_t frame) {
  char name[32];
  std::snprintf(name, sizeof name, "%06zu.exr", frame);
  return name;
}

std::unique_ptr<RgbdSequence> open_sequence(const std::filesystem::path& folder,
                                            const SequenceOptions& options) {
  if (!std::filesystem::is_directory(folder)) {
    throw core::InputError::expected(folder.string(), "a folder with RGB-D frames",
                                     "no such folder");
  }
  std::string known;
  for (const LayoutRow& row : kLayouts) {
    const bool wanted = options.layout == SequenceLayout::kAuto ? row.matches(folder)
                                                                : options.layout == row.layout;
    if (wanted) return row.open(folder, options);
    known += (known.empty() ? "" : "; or ") + std::string(row.word) + ": " + row.looks_like;
  }
  throw core::InputError::expected(folder.string(), "an RGB-D sequence (" + known + ")",
                                   "none of these files");
}

SequenceLayout parse_sequence_layout(const std::string& word, const std::string& place) {
  std::array<Word<SequenceLayout>, kLayouts.size() + 1> words{};
  words[0] = {"auto", SequenceLayout::kAuto};
  for (std::size_t i = 0; i < kLayouts.size(); ++i) {
    words[i + 1] = {kLayouts[i].word, kLayouts[i].layout};
  }
  return parse_word(words, word, place);
}

UpAxis parse_up_axis(const std::string& word, const std::string& place) {
  static constexpr std::array<Word<UpAxis>, 3> kWords{
      {{"auto", UpAxis::kAuto}, {"y", UpAxis::kY}, {"z", UpAxis::kZ}}};
  return parse_word(kWords, word, place);
}

OnBadFrame parse_on_bad_frame(const std::string& word, const std::string& place) {
  static constexpr std::array<Word<OnBadFrame>, 2> kWords{
      {{"refuse", OnBadFrame::kRefuse}, {"skip", OnBadFrame::kSkip}}};
  return parse_word(kWords, word, place);
}

core::Image<float> depth_of_size(const core::Image<float>& depth_m, int width_px,
                                 int height_px) {
  if (depth_m.empty() ||
      (depth_m.width_px() == width_px && depth_m.height_px() == height_px)) {
    return depth_m;
  }
  core::Image<float> resized(width_px, height_px);
  for (int y = 0; y < height_px; ++y) {
    const int from_y = y * depth_m.height_px() / height_px;
    for (int x = 0; x < width_px; ++x) {
      resized(x, y) = depth_m(x * depth_m.width_px() / width_px, from_y);
    }
  }
  return resized;
}

}  // namespace segsim::reconstruction
