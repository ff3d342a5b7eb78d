#include "reconstruction/datasets/internal/colmap_files.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>

#include "core/error.h"
#include "core/file_io.h"
#include "reconstruction/datasets/internal/calibration_files.h"

namespace segsim::reconstruction::internal {
namespace {

namespace fs = std::filesystem;
using core::InputError;

struct CameraModel {
  int id;
  const char* name;
  std::size_t parameters;
};
constexpr std::array<CameraModel, 6> kModels{{{0, "SIMPLE_PINHOLE", 3},
                                              {1, "PINHOLE", 4},
                                              {2, "SIMPLE_RADIAL", 4},
                                              {3, "RADIAL", 5},
                                              {4, "OPENCV", 8},
                                              {5, "OPENCV_FISHEYE", 8}}};

std::string known_models() {
  std::string names;
  for (const CameraModel& model : kModels)
    names += (names.empty() ? "" : ", ") + std::string(model.name);
  return names;
}

Lens lens_of(const CameraModel& model, std::int64_t width_px, std::int64_t height_px,
             const std::vector<double>& p, const std::string& place) {
  for (const double value : p) {
    if (!std::isfinite(value)) {
      throw InputError::expected(place, "finite parameters", std::to_string(value));
    }
  }
  // One focal length, or two.
  const bool one = model.id == 0 || model.id == 2 || model.id == 3;
  const std::size_t k = one ? 3 : 4;  // First parameter of the lens.
  Lens lens;
  lens.model = model.id == 5   ? LensModel::kFisheye
               : model.id <= 1 ? LensModel::kPinhole
                               : LensModel::kBrown;
  lens.camera = {static_cast<int>(width_px),
                 static_cast<int>(height_px),
                 p[0],
                 one ? p[0] : p[1],
                 p[k - 2],
                 p[k - 1]};
  if (width_px <= 0 || height_px <= 0 || width_px > 100000 || height_px > 100000 ||
      lens.camera.fx_px <= 0.0 || lens.camera.fy_px <= 0.0) {
    throw InputError::expected(place, "an image size and focal lengths > 0", "others");
  }
  if (model.id == 2) lens.k = {p[3], 0.0, 0.0, 0.0};
  if (model.id == 3) lens.k = {p[3], p[4], 0.0, 0.0};
  if (model.id == 4) lens.k = {p[4], p[5], 0.0, 0.0}, lens.p1 = p[6], lens.p2 = p[7];
  if (model.id == 5) lens.k = {p[4], p[5], p[6], p[7]};
  return lens;
}

core::CameraPose pose_of(const std::array<double, 7>& n, const std::string& place) {
  // The file has T_camera_world; the checks are the same for both directions.
  const core::CameraPose in_file =
      pose_from_quaternion(glm::dquat(n[0], n[1], n[2], n[3]), {n[4], n[5], n[6]}, place);
  const auto inverse = in_file.inverse();
  return {inverse.rotation(), inverse.translation_m()};
}

// ---- Text

/// Words of the lines that are no comments; empty lines are kept if asked for.
class TextLines {
 public:
  explicit TextLines(const fs::path& file)
      : place_(file.string()), text_(core::read_file(file)) {}

  /// False at the end. @param skip_empty  Image lists have lines that may be empty.
  bool next(bool skip_empty) {
    std::string line;
    while (std::getline(text_, line)) {
      ++number_;
      if (!line.empty() && line.back() == '\r') line.pop_back();
      if (line.starts_with('#')) continue;
      if (skip_empty && line.find_first_not_of(" \t") == std::string::npos) continue;
      words_.clear();
      std::istringstream cells(line);
      for (std::string word; cells >> word;) words_.push_back(word);
      return true;
    }
    return false;
  }
  [[nodiscard]] std::string place() const { return place_ + ":" + std::to_string(number_); }
  [[nodiscard]] const std::vector<std::string>& words() const { return words_; }
  [[nodiscard]] double number(std::size_t i) const {
    char* end = nullptr;
    const double value = std::strtod(words_[i].c_str(), &end);
    if (*end != '\0' || words_[i].empty()) {
      throw InputError::expected(place(), "a number", "'" + words_[i] + "'");
    }
    return value;
  }
  /// An id or a size.
  [[nodiscard]] std::uint32_t whole_number(std::size_t i) const {
    constexpr auto kMost = std::numeric_limits<std::uint32_t>::max();
    const double value = number(i);
    if (!(value >= 0.0 && value <= kMost && value == std::floor(value))) {
      throw InputError::expected(place(), "a whole number from 0 to " + std::to_string(kMost),
                                 "'" + words_[i] + "'");
    }
    return static_cast<std::uint32_t>(value);
  }
  void expect_words(std::size_t count, const std::string& what) const {
    if (words_.size() < count) {
      throw InputError::expected(place(), what, std::to_string(words_.size()) + " words");
    }
  }

 private:
  std::string place_;
  std::istringstream text_;
  int number_ = 0;
  std::vector<std::string> words_;
};

constexpr double kLargestError_px = 2.0;  ///< Of a sparse point; a worse one is a mismatch.

/// Files the point under the images that saw it.
void add_point(const glm::dvec3& p_m, double error_px,
               const std::vector<std::uint32_t>& image_ids, const std::string& place,
               ColmapModel& result) {
  if (!std::isfinite(p_m.x) || !std::isfinite(p_m.y) || !std::isfinite(p_m.z)) {
    throw InputError::expected(place, "a finite place of the point", "another");
  }
  if (!(error_px <= kLargestError_px)) return;
  const auto index = static_cast<std::uint32_t>(result.points_m.size());
  result.points_m.push_back(p_m);
  for (const std::uint32_t id : image_ids) {
    const auto image = result.image_of_id.find(id);
    if (image == result.image_of_id.end()) continue;
    std::vector<std::uint32_t>& seen = result.images[image->second].seen_points;
    if (seen.empty() || seen.back() != index) seen.push_back(index);
  }
}

void read_text_points(const fs::path& file, ColmapModel& result) {
  TextLines lines(file);
  while (lines.next(true)) {
    lines.expect_words(8, "id, x, y, z, red, green, blue and error");
    std::vector<std::uint32_t> image_ids;
    for (std::size_t i = 8; i + 1 < lines.words().size(); i += 2) {
      image_ids.push_back(lines.whole_number(i));
    }
    add_point({lines.number(1), lines.number(2), lines.number(3)}, lines.number(7), image_ids,
              lines.place(), result);
  }
}

void read_text_cameras(const fs::path& file, ColmapModel& result) {
  TextLines lines(file);
  while (lines.next(true)) {
    lines.expect_words(4, "id, model, width, height and parameters");
    const auto model = std::find_if(kModels.begin(), kModels.end(), [&](const CameraModel& m) {
      return lines.words()[1] == m.name;
    });
    if (model == kModels.end()) {
      throw InputError::expected(lines.place(), "one of " + known_models(),
                                 "'" + lines.words()[1] + "'");
    }
    lines.expect_words(4 + model->parameters,
                       std::to_string(model->parameters) + " parameters of " + model->name);
    std::vector<double> parameters;
    for (std::size_t i = 0; i < model->parameters; ++i)
      parameters.push_back(lines.number(4 + i));
    result.cameras[lines.whole_number(0)] = lens_of(
        *model, lines.whole_number(2), lines.whole_number(3), parameters, lines.place());
  }
}

void read_text_images(const fs::path& file, ColmapModel& result) {
  TextLines lines(file);
  while (lines.next(true)) {
    lines.expect_words(10, "id, quaternion, translation, camera id and name");
    std::array<double, 7> pose{};
    for (std::size_t i = 0; i < pose.size(); ++i) pose[i] = lines.number(1 + i);
    ColmapImage image;
    image.place = lines.place();
    image.camera_id = lines.whole_number(8);
    result.image_of_id[lines.whole_number(0)] = result.images.size();
    image.T_world_camera = pose_of(pose, image.place);
    image.name = lines.words()[9];
    for (std::size_t i = 10; i < lines.words().size(); ++i) {
      image.name += " " + lines.words()[i];
    }
    result.images.push_back(std::move(image));
    (void)lines.next(false);  // Its 2-D points.
  }
}

// ---- Binary, little endian

class Bytes {
 public:
  explicit Bytes(const fs::path& file)
      : place_(file.string()), bytes_(core::read_file(file)) {}

  template <class Value>
  Value read() {
    Value value;
    expect(sizeof value);
    std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return value;
  }
  std::string text() {
    const auto end = bytes_.find('\0', at_);
    if (end == std::string::npos) expect(bytes_.size() + 1);
    std::string result = bytes_.substr(at_, end - at_);
    at_ = end + 1;
    return result;
  }
  void skip(std::uint64_t count, std::uint64_t size) {
    if (count > bytes_.size() / size) expect(bytes_.size() + 1);
    expect(count * size);
    at_ += count * size;
  }
  [[nodiscard]] const std::string& place() const { return place_; }

 private:
  void expect(std::uint64_t count) const {
    if (count > bytes_.size() - at_) {
      throw InputError::expected(place_, "more data at byte " + std::to_string(at_),
                                 "the end of the file");
    }
  }

  std::string place_, bytes_;
  std::uint64_t at_ = 0;
};

void read_binary_cameras(const fs::path& file, ColmapModel& result) {
  Bytes bytes(file);
  const auto count = bytes.read<std::uint64_t>();
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::string place = bytes.place() + ": camera " + std::to_string(i);
    const auto id = bytes.read<std::uint32_t>();
    const auto model_id = bytes.read<std::int32_t>();
    const auto width_px = bytes.read<std::uint64_t>(), height_px = bytes.read<std::uint64_t>();
    const auto model = std::find_if(kModels.begin(), kModels.end(),
                                    [&](const CameraModel& m) { return m.id == model_id; });
    if (model == kModels.end()) {
      throw InputError::expected(place, "one of " + known_models(),
                                 "model " + std::to_string(model_id));
    }
    std::vector<double> parameters(model->parameters);
    for (double& value : parameters) value = bytes.read<double>();
    result.cameras[id] = lens_of(*model, static_cast<std::int64_t>(width_px),
                                 static_cast<std::int64_t>(height_px), parameters, place);
  }
}

void read_binary_images(const fs::path& file, ColmapModel& result) {
  Bytes bytes(file);
  const auto count = bytes.read<std::uint64_t>();
  for (std::uint64_t i = 0; i < count; ++i) {
    ColmapImage image;
    image.place = bytes.place() + ": image " + std::to_string(i);
    result.image_of_id[bytes.read<std::uint32_t>()] = result.images.size();
    std::array<double, 7> pose{};
    for (double& value : pose) value = bytes.read<double>();
    image.T_world_camera = pose_of(pose, image.place);
    image.camera_id = bytes.read<std::uint32_t>();
    image.name = bytes.text();
    bytes.skip(bytes.read<std::uint64_t>(), 24);  // 2-D points: x, y, 3-D point.
    result.images.push_back(std::move(image));
  }
}

void read_binary_points(const fs::path& file, ColmapModel& result) {
  Bytes bytes(file);
  const auto count = bytes.read<std::uint64_t>();
  for (std::uint64_t i = 0; i < count; ++i) {
    (void)bytes.read<std::uint64_t>();  // Its id.
    glm::dvec3 p_m;
    for (int axis = 0; axis < 3; ++axis) p_m[axis] = bytes.read<double>();
    bytes.skip(3, 1);  // Its colour.
    const auto error_px = bytes.read<double>();
    const auto length = bytes.read<std::uint64_t>();
    std::vector<std::uint32_t> image_ids;
    for (std::uint64_t k = 0; k < length; ++k) {
      image_ids.push_back(bytes.read<std::uint32_t>());
      (void)bytes.read<std::uint32_t>();  // Which of the image's 2-D points.
    }
    add_point(p_m, error_px, image_ids, bytes.place() + ": point " + std::to_string(i),
              result);
  }
}

bool has_both(const fs::path& folder, const char* extension) {
  return fs::exists(folder / (std::string("cameras") + extension)) &&
         fs::exists(folder / (std::string("images") + extension));
}

}  // namespace

bool has_colmap_model(const fs::path& folder) {
  return has_both(folder, ".bin") || has_both(folder, ".txt");
}

ColmapModel read_colmap_model(const fs::path& folder) {
  ColmapModel model;
  if (has_both(folder, ".bin")) {
    read_binary_cameras(folder / "cameras.bin", model);
    read_binary_images(folder / "images.bin", model);
    if (fs::exists(folder / "points3D.bin")) {
      read_binary_points(folder / "points3D.bin", model);
    }
  } else if (has_both(folder, ".txt")) {
    read_text_cameras(folder / "cameras.txt", model);
    read_text_images(folder / "images.txt", model);
    if (fs::exists(folder / "points3D.txt")) read_text_points(folder / "points3D.txt", model);
  } else {
    throw InputError::expected(folder.string(), "cameras and images, .bin or .txt", "none");
  }
  for (const ColmapImage& image : model.images) {
    if (!model.cameras.contains(image.camera_id)) {
      throw InputError::expected(image.place, "a camera of the model",
                                 "camera " + std::to_string(image.camera_id));
    }
  }
  model.image_of_id.clear();  // Sorting moves them.
  std::sort(model.images.begin(), model.images.end(),
            [](const ColmapImage& a, const ColmapImage& b) { return a.name < b.name; });
  return model;
}

Lens common_lens(const ColmapModel& model, const fs::path& folder) {
  if (model.images.empty()) {
    throw InputError::expected(folder.string(), "at least one image", "none");
  }
  const Lens& lens = model.cameras.at(model.images.front().camera_id);
  for (const ColmapImage& image : model.images) {
    if (!(model.cameras.at(image.camera_id) == lens)) {
      throw InputError::expected(
          image.place, "the camera of " + model.images.front().name + ": one for all images",
          "camera " + std::to_string(image.camera_id));
    }
  }
  return lens;
}

}  // namespace segsim::reconstruction::internal
