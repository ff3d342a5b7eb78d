#include "renderer/datasets/internal/file_sequence.h"

#include <cmath>
#include <sstream>
#include <utility>

#include "core/error.h"
#include "renderer/datasets/floor_fit.h"
#include "renderer/exr_io.h"

namespace segsim::renderer::internal {
namespace {

using core::CameraPose;
using core::InputError;

std::string size_text(int width_px, int height_px) {
  return std::to_string(width_px) + "x" + std::to_string(height_px);
}

void expect_size(const std::filesystem::path& file, const ImageSize& size,
                 const core::CameraIntrinsics& camera) {
  if (size.width_px != camera.width_px || size.height_px != camera.height_px) {
    throw InputError::expected(file.string(),
                               size_text(camera.width_px, camera.height_px) + " pixels",
                               size_text(size.width_px, size.height_px));
  }
}

/// A depth image may have another size, but it must show the same view.
void expect_same_aspect(const std::filesystem::path& file, const ImageSize& size,
                        const core::CameraIntrinsics& camera) {
  const double ratio = static_cast<double>(size.width_px) * camera.height_px /
                       (static_cast<double>(size.height_px) * camera.width_px);
  if (std::abs(ratio - 1.0) > 0.02) {
    throw InputError::expected(file.string(),
                               "the aspect ratio of the colour image, " +
                                   size_text(camera.width_px, camera.height_px),
                               size_text(size.width_px, size.height_px));
  }
}

void check_files(const FrameFiles& frame, const core::CameraIntrinsics& camera,
                 bool has_masks) {
  expect_size(frame.rgb, check_image_file(frame.rgb), camera);
  if (frame.depth_exr.empty()) {
    expect_same_aspect(frame.depth_png, check_image_file(frame.depth_png), camera);
  }
  if (!has_masks) return;
  expect_size(frame.semantic, check_image_file(frame.semantic), camera);
  expect_size(frame.instance, check_image_file(frame.instance), camera);
}

core::Image<float> read_depth(const FrameFiles& frame) {
  if (frame.depth_exr.empty()) return read_depth_mm_image(frame.depth_png);
  core::Image<float> depth_m = read_depth_exr(frame.depth_exr);
  for (float& value : depth_m.pixels()) {
    if (!(value > 0.0F) || !std::isfinite(value)) value = std::nanf("");
  }
  return depth_m;
}

/// Source world -> our world, without the floor.
core::Transform<core::frame::World, core::frame::World> turn_up(UpAxis up) {
  if (up == UpAxis::kZ) return {};
  // (x, y, z) -> (x, -z, y): a quarter turn about x.
  return {glm::dquat(std::sqrt(0.5), std::sqrt(0.5), 0.0, 0.0), glm::dvec3(0.0)};
}

/// World points of every 8th pixel of a dozen frames.
std::vector<glm::vec3> sample_points(const SequenceParts& parts) {
  constexpr std::size_t kFrames = 16;
  constexpr int kPixelStep = 8;
  std::vector<glm::vec3> points;
  const std::size_t frames = std::min(kFrames, parts.frames.size());
  for (std::size_t k = 0; k < frames; ++k) {
    const FrameFiles& frame = parts.frames[k * parts.frames.size() / frames];
    const core::Image<float> depth_m = read_depth(frame);
    const core::CameraIntrinsics camera =
        parts.intrinsics.resized(depth_m.width_px(), depth_m.height_px());
    for (int y = kPixelStep / 2; y < depth_m.height_px(); y += kPixelStep) {
      for (int x = kPixelStep / 2; x < depth_m.width_px(); x += kPixelStep) {
        const double z = depth_m(x, y);
        if (!(z > 0.0 && z < 6.0)) continue;
        const core::Point<core::frame::Camera> p{camera.back_project({x + 0.5, y + 0.5}, z)};
        points.emplace_back((frame.T_world_camera * p).xyz_m);
      }
    }
  }
  return points;
}

void apply_convention(SequenceParts& parts, const WorldConvention& convention) {
  const auto T_turned_source = turn_up(convention.up);
  for (FrameFiles& frame : parts.frames) {
    frame.T_world_camera = T_turned_source * frame.T_world_camera;
  }
  std::optional<double> floor_m = convention.floor_height_m;
  std::string origin = "given";
  if (!floor_m && convention.fit_floor) {
    floor_m = fit_floor_height_m(sample_points(parts));
    origin = "fitted";
    if (!floor_m) {
      parts.warnings.emplace_back(
          "no floor found in the depth images: source heights are kept (set floor_height_m)");
    }
  }
  std::ostringstream note;
  note.precision(4);
  note << "world: source " << (convention.up == UpAxis::kY ? "+Y" : "+Z") << " is up";
  if (floor_m) note << ", floor at source height " << *floor_m << " m (" << origin << ")";
  parts.notes.push_back(note.str());
  const core::Transform<core::frame::World, core::frame::World> T_world_turned{
      glm::dquat(1.0, 0.0, 0.0, 0.0), {0.0, 0.0, -floor_m.value_or(0.0)}};
  for (FrameFiles& frame : parts.frames) {
    frame.T_world_camera = T_world_turned * frame.T_world_camera;
  }
}

/// Ids that the label table lists, as a lookup table.
template <class Entry>
std::vector<bool> known_ids(const std::vector<Entry>& entries) {
  std::vector<bool> known(65536, false);
  known[0] = true;
  for (const Entry& entry : entries) known[entry.id] = true;
  return known;
}

class FileSequence final : public RgbdSequence {
 public:
  explicit FileSequence(SequenceParts parts)
      : parts_(std::move(parts)),
        known_classes_(known_ids(parts_.classes)),
        known_instances_(known_ids(parts_.instances)) {}

  const std::string& name() const override { return parts_.name; }
  const core::CameraIntrinsics& intrinsics() const override { return parts_.intrinsics; }
  std::size_t frame_count() const override { return parts_.frames.size(); }
  const std::string& frame_name(std::size_t i) const override { return at(i).name; }
  const CameraPose& pose(std::size_t i) const override { return at(i).T_world_camera; }
  bool has_masks() const override { return parts_.has_masks; }
  const std::vector<core::SceneClass>& classes() const override { return parts_.classes; }
  const std::vector<core::SceneInstance>& instances() const override {
    return parts_.instances;
  }
  const std::vector<std::string>& warnings() const override { return parts_.warnings; }
  const std::vector<std::string>& notes() const override { return parts_.notes; }

  RgbdFrame load(std::size_t i) const override {
    const FrameFiles& files = at(i);
    RgbdFrame frame;
    frame.name = files.name;
    frame.T_world_camera = files.T_world_camera;
    frame.rgb = read_color_image(files.rgb);
    expect_size(files.rgb, {frame.rgb.width_px(), frame.rgb.height_px()}, parts_.intrinsics);
    frame.depth_m = read_depth(files);
    expect_same_aspect(files.depth_exr.empty() ? files.depth_png : files.depth_exr,
                       {frame.depth_m.width_px(), frame.depth_m.height_px()},
                       parts_.intrinsics);
    if (!parts_.has_masks) return frame;
    frame.semantic = read_mask(files.semantic, known_classes_, "classes");
    frame.instance = read_mask(files.instance, known_instances_, "instances");
    return frame;
  }

 private:
  const FrameFiles& at(std::size_t i) const {
    SEGSIM_CHECK(i < parts_.frames.size(), "frame " + std::to_string(i));
    return parts_.frames[i];
  }

  core::Image<std::uint16_t> read_mask(const std::filesystem::path& file,
                                       const std::vector<bool>& known,
                                       const std::string& what) const {
    core::Image<std::uint16_t> mask = read_id_image(file);
    expect_size(file, {mask.width_px(), mask.height_px()}, parts_.intrinsics);
    for (const std::uint16_t id : mask.pixels()) {
      if (!known[id]) {
        throw InputError::expected(
            file.string(), "ids listed under " + what + " in labels.yaml", std::to_string(id));
      }
    }
    return mask;
  }

  SequenceParts parts_;
  std::vector<bool> known_classes_, known_instances_;
};

}  // namespace

bool accept_frame(OnBadFrame on_bad_frame, const std::string& frame_name,
                  std::vector<std::string>& warnings, const std::function<void()>& check) {
  try {
    check();
    return true;
  } catch (const InputError& error) {
    if (on_bad_frame == OnBadFrame::kRefuse) throw;
    warnings.push_back("frame " + frame_name + " skipped: " + error.what());
    return false;
  }
}

ImageSize first_image_size(const std::vector<FrameFiles>& frames,
                           const std::filesystem::path& folder) {
  for (const FrameFiles& frame : frames) {
    try {
      return check_image_file(frame.rgb);
    } catch (const InputError&) {
      continue;  // check_files will report it.
    }
  }
  throw InputError::expected(folder.string(), "at least one intact colour image",
                             "none in " + std::to_string(frames.size()) + " frames");
}

std::unique_ptr<RgbdSequence> finish_sequence(SequenceParts parts,
                                              const std::filesystem::path& folder,
                                              const WorldConvention& convention,
                                              OnBadFrame on_bad_frame) {
  std::vector<FrameFiles> good;
  for (FrameFiles& frame : parts.frames) {
    if (accept_frame(on_bad_frame, frame.name, parts.warnings,
                     [&] { check_files(frame, parts.intrinsics, parts.has_masks); })) {
      good.push_back(std::move(frame));
    }
  }
  if (good.empty()) {
    throw InputError::expected(
        folder.string(), "at least one usable frame",
        std::to_string(parts.warnings.size()) + " warnings and no frame" +
            (parts.warnings.empty() ? "" : ": " + parts.warnings.front()));
  }
  parts.frames = std::move(good);
  apply_convention(parts, convention);
  return std::make_unique<FileSequence>(std::move(parts));
}

}  // namespace segsim::renderer::internal
