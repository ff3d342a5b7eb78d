#include "reconstruction/datasets/internal/file_sequence.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <utility>

#include <glm/geometric.hpp>

#include "core/error.h"
#include "reconstruction/datasets/internal/depth_files.h"
#include "reconstruction/datasets/internal/frame_times.h"
#include "reconstruction/datasets/internal/place_world.h"
#include "reconstruction/datasets/internal/pose_jumps.h"
#include "reconstruction/datasets/internal/rolling_shutter.h"

namespace segsim::reconstruction::internal {
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
  if (!has_aspect_of(camera, size.width_px, size.height_px)) {
    throw InputError::expected(file.string(),
                               "the aspect ratio of the colour image, " +
                                   size_text(camera.width_px, camera.height_px),
                               size_text(size.width_px, size.height_px));
  }
}

void check_files(const FrameFiles& frame, const core::CameraIntrinsics& camera,
                 const std::optional<core::CameraIntrinsics>& depth_camera, bool has_masks) {
  expect_size(frame.rgb, check_image_file(frame.rgb), camera);
  if (!frame.depth_png.empty()) {
    const ImageSize size = check_image_file(frame.depth_png);
    if (depth_camera) {
      expect_size(frame.depth_png, size, *depth_camera);
    } else {
      expect_same_aspect(frame.depth_png, size, camera);
    }
  }
  if (!frame.valid.empty()) expect_size(frame.valid, check_image_file(frame.valid), camera);
  if (!has_masks) return;
  expect_size(frame.semantic, check_image_file(frame.semantic), camera);
  expect_size(frame.instance, check_image_file(frame.instance), camera);
}

void expect_near_origin(const FrameFiles& frame, const std::string& sequence) {
  constexpr double kFarthest_m = 1e4;  // Voxel keys cover 20 km at 2 cm.
  for (int i = 0; i < 3; ++i) {
    const double p_m = frame.T_world_camera.translation_m()[i];
    if (std::abs(p_m) <= kFarthest_m) continue;
    std::ostringstream found;
    found << p_m << " m; if poses are in millimetres: --pose-scale 0.001";
    throw InputError::expected(sequence + ", pose of frame " + frame.name,
                               "a position within 10 km of the origin", found.str());
  }
}

/// Poses and depth in metres, poses camera-to-world, if the files hold something else.
void apply_corrections(SequenceParts& parts, const WorldConvention& convention) {
  parts.depth_scale = convention.depth_scale;
  const auto correct = [&](core::CameraPose& T) {
    if (convention.invert_poses) {
      const auto T_camera_world = T.inverse();
      T = {T_camera_world.rotation(), T_camera_world.translation_m()};
    }
    if (convention.pose_scale != 1.0) {
      T = {T.rotation(), convention.pose_scale * T.translation_m()};
    }
  };
  for (FrameFiles& frame : parts.frames) correct(frame.T_world_camera);
  parts.track.for_each(correct);
  for (glm::dvec3& p_m : parts.sparse_points_m) p_m *= convention.pose_scale;
  const auto tell = [&](const std::string& what, double factor) {
    if (factor == 1.0) return;
    std::ostringstream note;
    note << what << " multiplied with " << factor;
    parts.notes.push_back(note.str());
  };
  tell("depth", convention.depth_scale);
  tell("positions of the poses", convention.pose_scale);
  if (convention.invert_poses) parts.notes.emplace_back("poses inverted");
}

/// Where depth comes from, if the files do not say it themselves.
void state_rig(SequenceParts& parts, const WorldConvention& convention) {
  parts.sensor = convention.sensor;
  if (parts.sensor != DepthSensor::kUnstated) {
    parts.notes.push_back("depth weighs as of a sensor of kind " + words_of(parts.sensor));
  }
  if (!convention.color_depth) return;
  parts.T_color_depth = convention.color_depth->T_color_depth;
  if (convention.color_depth->depth_camera) {
    parts.depth_camera = convention.color_depth->depth_camera;
  }
  parts.notes.emplace_back("depth reprojected into the colour camera by --color-depth");
}

/// After all frames that are to be left out are: the images are named by the others' indices.
void replace_depth(SequenceParts& parts, const WorldConvention& convention) {
  if (!convention.ignore_depth && convention.own_depth.empty()) return;
  parts.own_depth = !convention.own_depth.empty();
  if (parts.own_depth) parts.depth_scale = 1.0;
  for (std::size_t i = 0; i < parts.frames.size(); ++i) {
    FrameFiles& frame = parts.frames[i];
    frame.depth_png.clear(), frame.depth_exr.clear();
    const std::filesystem::path file = convention.own_depth / own_depth_name(i);
    if (parts.own_depth && std::filesystem::exists(file)) frame.depth_exr = file;
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
        has_depth_(std::all_of(parts_.frames.begin(), parts_.frames.end(),
                               [](const FrameFiles& frame) {
                                 return !frame.depth_png.empty() || !frame.depth_exr.empty();
                               }) ||
                   parts_.own_depth),
        known_classes_(known_ids(parts_.classes)) {
    if (parts_.lens) {
      undistortion_.emplace(*parts_.lens, parts_.intrinsics, parts_.intrinsics.width_px,
                            parts_.intrinsics.height_px);
    }
    if (parts_.label_map && parts_.has_masks) list_instances();
    known_instances_ = known_ids(parts_.instances);
  }

  const std::string& name() const override { return parts_.name; }
  const core::CameraIntrinsics& intrinsics() const override { return parts_.intrinsics; }
  std::size_t frame_count() const override { return parts_.frames.size(); }
  const std::string& frame_name(std::size_t i) const override { return at(i).name; }
  const CameraPose& pose(std::size_t i) const override { return at(i).T_world_camera; }
  core::Transform<core::frame::World, core::frame::World> T_world_source() const override {
    return parts_.T_world_source;
  }
  bool has_depth() const override { return has_depth_; }
  bool has_masks() const override { return parts_.has_masks; }
  const std::vector<core::SceneClass>& classes() const override { return parts_.classes; }
  const std::vector<core::SceneInstance>& instances() const override {
    return parts_.instances;
  }
  std::optional<double> time_s(std::size_t i) const override { return at(i).time_s; }
  std::optional<double> depth_time_s(std::size_t i) const override {
    return at(i).depth_time_s;
  }
  const PoseTrack& pose_track() const override { return parts_.track; }
  DepthSensor sensor() const override { return parts_.sensor; }
  const std::vector<std::string>& warnings() const override { return parts_.warnings; }
  const std::vector<std::string>& notes() const override { return parts_.notes; }
  const WorldPlacement* placement() const override { return &parts_.placement; }
  std::vector<glm::dvec3> seen_points_m(std::size_t i) const override {
    std::vector<glm::dvec3> points_m;
    for (const std::uint32_t point : at(i).seen_points) {
      points_m.push_back((parts_.T_world_source *
                          core::Point<core::frame::World>{parts_.sparse_points_m[point]})
                             .xyz_m);
    }
    return points_m;
  }

  RgbdFrame load(std::size_t i) const override {
    const FrameFiles& files = at(i);
    RgbdFrame frame;
    frame.name = files.name;
    frame.T_world_camera = files.T_world_camera;
    frame.rgb = read_color_image(files.rgb);
    expect_size(files.rgb, {frame.rgb.width_px(), frame.rgb.height_px()}, parts_.intrinsics);
    if (undistortion_) frame.rgb = undistortion_->color(frame.rgb);
    frame.depth_m = read_depth(files, parts_);
    if (!frame.depth_m.empty()) {
      expect_same_aspect(files.depth_exr.empty() ? files.depth_png : files.depth_exr,
                         {frame.depth_m.width_px(), frame.depth_m.height_px()},
                         parts_.intrinsics);
    }
    read_valid(files, frame);
    if (parts_.has_masks) {
      read_labels(files, frame);
      frame.crowds = parts_.crowds;
      expect_known(files.semantic, frame.semantic, known_classes_, "classes");
      expect_known(files.instance, frame.instance, known_instances_, "instances");
    }
    if (parts_.times.read_out_s) {
      straighten_rows(
          row_motion(parts_.track, *files.time_s - parts_.times.pose_offset_s.value_or(0.0),
                     *parts_.times.read_out_s, parts_.intrinsics.height_px),
          parts_.intrinsics, frame);
    }
    return frame;
  }

 private:
  const FrameFiles& at(std::size_t i) const {
    SEGSIM_CHECK(i < parts_.frames.size(), "frame " + std::to_string(i));
    return parts_.frames[i];
  }

  /// Ids of the view of the colour image.
  core::Image<std::uint16_t> read_ids(const std::filesystem::path& file) const {
    core::Image<std::uint16_t> ids = read_id_image(file);
    expect_size(file, {ids.width_px(), ids.height_px()}, parts_.intrinsics);
    return undistortion_ ? undistortion_->nearest(ids) : ids;
  }

  void read_valid(const FrameFiles& files, RgbdFrame& frame) const {
    if (files.valid.empty()) return;
    const core::Image<std::uint16_t> mask = read_ids(files.valid);
    frame.valid = core::Image<std::uint8_t>(mask.width_px(), mask.height_px());
    for (std::size_t i = 0; i < mask.size(); ++i) {
      frame.valid.pixels()[i] = mask.pixels()[i] == 0 ? 0 : 255;
    }
    // What is not to be learned from is no measurement either.
    core::Image<float>& depth_m = frame.depth_m;
    for (int y = 0; y < depth_m.height_px(); ++y) {
      for (int x = 0; x < depth_m.width_px(); ++x) {
        const int mask_x = x * mask.width_px() / depth_m.width_px();
        const int mask_y = y * mask.height_px() / depth_m.height_px();
        if (mask(mask_x, mask_y) == 0) depth_m(x, y) = std::nanf("");
      }
    }
  }

  /// Label images; with a label map, in its classes and with ids on things only.
  void read_labels(const FrameFiles& files, RgbdFrame& frame) const {
    frame.semantic = read_ids(files.semantic);
    frame.instance = read_ids(files.instance);
    if (!parts_.label_map) return;
    for (std::size_t i = 0; i < frame.semantic.size(); ++i) {
      std::uint16_t& class_id = frame.semantic.pixels()[i];
      std::uint16_t& id = frame.instance.pixels()[i];
      class_id = class_of_source_[class_id];
      if (!is_thing_[class_id] || id > parts_.last_instance) id = 0;
    }
  }

  /// Reads all label images once: class of an instance is that of most of its pixels.
  void list_instances() {
    class_of_source_.assign(65536, 0);
    is_thing_.assign(65536, false);
    for (std::size_t id = 1; id < class_of_source_.size(); ++id) {
      class_of_source_[id] = parts_.label_map->class_of(static_cast<std::uint16_t>(id));
    }
    for (const core::SceneClass& c : parts_.classes) is_thing_[c.id] = c.thing;
    std::map<std::uint16_t, std::map<std::uint16_t, std::uint64_t>> pixels;
    for (const FrameFiles& files : parts_.frames) {
      RgbdFrame frame;
      read_labels(files, frame);
      for (std::size_t i = 0; i < frame.instance.size(); ++i) {
        const std::uint16_t id = frame.instance.pixels()[i];
        if (id != 0) ++pixels[id][frame.semantic.pixels()[i]];
      }
    }
    for (const auto& [id, classes] : pixels) {
      const auto most =
          std::max_element(classes.begin(), classes.end(),
                           [](const auto& a, const auto& b) { return a.second < b.second; });
      const auto found =
          std::find_if(parts_.classes.begin(), parts_.classes.end(),
                       [&](const core::SceneClass& c) { return c.id == most->first; });
      parts_.instances.push_back(
          {id, most->first, found->name + "_" + std::to_string(id), {}, {}});
    }
  }

  static void expect_known(const std::filesystem::path& file,
                           const core::Image<std::uint16_t>& ids,
                           const std::vector<bool>& known, const std::string& what) {
    for (const std::uint16_t id : ids.pixels()) {
      if (!known[id]) {
        throw InputError::expected(
            file.string(), "ids listed under " + what + " in labels.yaml", std::to_string(id));
      }
    }
  }

  SequenceParts parts_;
  bool has_depth_;
  std::optional<Undistortion> undistortion_;
  std::vector<bool> known_classes_, known_instances_;
  std::vector<std::uint16_t> class_of_source_;  ///< With a label map: by source id.
  std::vector<bool> is_thing_;                  ///< By class id.
};

}  // namespace

bool accept_frame(OnBadFrame on_bad_frame, const std::string& frame_name,
                  std::vector<std::string>& warnings, const std::function<void()>& check) {
  try {
    check();
    return true;
  } catch (const InputError& error) {
    if (on_bad_frame == OnBadFrame::kRefuse) {
      throw InputError(std::string(error.what()) + " (--on-bad-frame skip leaves frame " +
                       frame_name + " out)");
    }
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

bool has_aspect_of(const core::CameraIntrinsics& camera, int width_px, int height_px) {
  const double ratio = static_cast<double>(width_px) * camera.height_px /
                       (static_cast<double>(height_px) * camera.width_px);
  return std::abs(ratio - 1.0) <= 0.02;
}

std::string sequence_name(const std::filesystem::path& folder) {
  const std::string name =
      std::filesystem::absolute(folder).lexically_normal().filename().string();
  return name.empty() ? "sequence" : name;  // The path ended in a slash.
}

std::optional<LabelMap> choose_label_map(const SequenceOptions& options,
                                         const std::function<std::optional<LabelMap>()>& own,
                                         std::vector<std::string>& warnings) {
  if (!options.label_map.empty()) return read_label_map(options.label_map);
  std::optional<LabelMap> map = own();
  if (!map) {
    warnings.emplace_back("label images are left alone: no table of their classes found");
  }
  return map;
}

WorldConvention convention_of(const SequenceOptions& options, UpAxis habit) {
  if (options.gravity) {
    const double length = glm::length(*options.gravity);
    if (!(length > 0.0) || !std::isfinite(length)) {
      const glm::dvec3& g = *options.gravity;
      throw InputError::expected(
          "--gravity", "a direction, three numbers that are not all 0",
          std::to_string(g.x) + " " + std::to_string(g.y) + " " + std::to_string(g.z));
    }
    if (options.up_axis != UpAxis::kAuto) {
      throw InputError::expected("--gravity and --up", "one of them", "both");
    }
  }
  if (!std::isfinite(options.floor_height_m.value_or(0.0))) {
    throw InputError::expected("--floor-height", "a height in metres",
                               std::to_string(*options.floor_height_m));
  }
  WorldConvention convention;
  convention.up = options.up_axis == UpAxis::kAuto ? habit : options.up_axis;
  convention.up_given = options.up_axis != UpAxis::kAuto;
  convention.gravity = options.gravity;
  convention.depth_scale = options.depth_scale;
  convention.pose_scale = options.pose_scale;
  convention.invert_poses = options.invert_poses;
  convention.ignore_depth = options.ignore_depth;
  convention.own_depth = options.own_depth;
  convention.floor_height_m = options.floor_height_m;
  convention.floor_points_m = options.floor_points_m;
  convention.color_depth = options.color_depth;
  convention.sensor = options.sensor;
  convention.times = options.times;
  return convention;
}

void turn_opengl_axes(std::vector<double>& matrix) {
  for (std::size_t row = 0; row + 3 < matrix.size() && row < 12; row += 4) {
    matrix[row + 1] = -matrix[row + 1];
    matrix[row + 2] = -matrix[row + 2];
  }
}

std::unique_ptr<RgbdSequence> finish_sequence(SequenceParts parts,
                                              const std::filesystem::path& folder,
                                              const WorldConvention& convention,
                                              OnBadFrame on_bad_frame) {
  if (parts.lens && !parts.lens->bends()) {
    parts.intrinsics = parts.lens->camera;
    parts.lens.reset();
  } else if (parts.lens) {
    parts.intrinsics = straight_camera(*parts.lens);
    std::ostringstream note;
    note.precision(5);
    note << "lens: straightened to fx " << parts.intrinsics.fx_px << " px, fy "
         << parts.intrinsics.fy_px << " px";
    parts.notes.push_back(note.str());
  }
  state_rig(parts, convention);
  std::vector<FrameFiles> good;
  for (FrameFiles& frame : parts.frames) {
    if (accept_frame(on_bad_frame, frame.name, parts.warnings, [&] {
          check_files(frame, parts.intrinsics, parts.depth_camera, parts.has_masks);
        })) {
      good.push_back(std::move(frame));
    }
  }
  parts.frames = std::move(good);
  apply_corrections(parts, convention);
  std::erase_if(parts.frames, [&](const FrameFiles& frame) {
    return !accept_frame(on_bad_frame, frame.name, parts.warnings,
                         [&] { expect_near_origin(frame, parts.name); });
  });
  if (parts.frames.empty()) {
    throw InputError::expected(
        folder.string(), "at least one usable frame",
        std::to_string(parts.warnings.size()) + " warnings and no frame" +
            (parts.warnings.empty() ? "" : ": " + parts.warnings.front()));
  }
  apply_times(parts, convention.times);
  check_pose_jumps(parts, on_bad_frame);
  replace_depth(parts, convention);
  if (parts.label_map) parts.classes = parts.label_map->classes;
  place_world(parts, convention);
  parts.track.for_each([&](core::CameraPose& T) { T = parts.T_world_source * T; });
  return std::make_unique<FileSequence>(std::move(parts));
}

}  // namespace segsim::reconstruction::internal
