#include "reconstruction/training/training_pack.h"

#include <array>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "reconstruction/training/raw_surfels.h"

namespace segsim::reconstruction {
namespace {

constexpr std::array<char, 8> kMagic{'S', 'E', 'G', 'S', 'I', 'M', 'T', 'P'};
constexpr std::int32_t kVersion = 2, kLargestSide_px = 32768;
constexpr std::int64_t kMostSurfels = 1'000'000'000, kMostFrames = 1'000'000'000;

template <class Value>
void put(std::ostream& out, const Value* values, std::size_t count) {
  out.write(reinterpret_cast<const char*>(values),
            static_cast<std::streamsize>(count * sizeof(Value)));
}

template <class Value>
void put(std::ostream& out, Value value) {
  put(out, &value, 1);
}

void put_view(std::ostream& out, const TrainingView& view, bool held_out) {
  const std::size_t pixels = view.rgb.size();
  SEGSIM_CHECK(view.depth_m.size() == pixels && view.masks.semantic.size() == pixels &&
                   view.masks.confidence.size() == pixels,
               "view " + view.name + " without depth or masks");
  put(out, std::int32_t{held_out});
  put(out, static_cast<std::int64_t>(view.frame));
  const glm::dquat& r = view.T_world_camera.rotation();
  const glm::dvec3& t = view.T_world_camera.translation_m();
  for (const double value : {r.w, r.x, r.y, r.z, t.x, t.y, t.z}) put(out, value);
  put(out, view.rgb.data(), pixels);
  put(out, view.depth_m.data(), pixels);
  put(out, view.masks.semantic.data(), pixels);
  put(out, view.masks.instance.data(), pixels);
  put(out, view.masks.confidence.data(), pixels);
}

/// Reads values and says where the file ended too early.
class PackReader {
 public:
  explicit PackReader(const std::filesystem::path& file)
      : place_(file.string()), in_(file, std::ios::binary) {
    if (!in_) throw core::InputError::expected(place_, "a training pack", "no readable file");
  }

  template <class Value>
  void get(Value* values, std::size_t count) {
    in_.read(reinterpret_cast<char*>(values),
             static_cast<std::streamsize>(count * sizeof(Value)));
    if (!in_) {
      throw core::InputError::expected(place_, "more bytes", "the end of the file");
    }
  }
  template <class Value>
  [[nodiscard]] Value get() {
    Value value{};
    get(&value, 1);
    return value;
  }
  /// A number of things in [least, most].
  template <class Value>
  [[nodiscard]] Value count(const char* of, Value least, Value most) {
    const Value value = get<Value>();
    if (value < least || value > most) {
      throw core::InputError::expected(place_ + ": " + of,
                                       std::to_string(least) + " ... " + std::to_string(most),
                                       std::to_string(value));
    }
    return value;
  }
  [[nodiscard]] const std::string& place() const { return place_; }

 private:
  std::string place_;
  std::ifstream in_;
};

TrainingView get_view(PackReader& in, const core::CameraIntrinsics& camera) {
  TrainingView view;
  std::array<double, 7> pose{};
  in.get(pose.data(), pose.size());
  view.T_world_camera = core::CameraPose(glm::dquat(pose[0], pose[1], pose[2], pose[3]),
                                         glm::dvec3(pose[4], pose[5], pose[6]));
  const auto image = [&](auto& to) {
    to = std::decay_t<decltype(to)>(camera.width_px, camera.height_px);
    in.get(to.data(), to.size());
  };
  image(view.rgb);
  image(view.depth_m);
  image(view.masks.semantic);
  image(view.masks.instance);
  image(view.masks.confidence);
  view.masks.segments = core::segments_of(view.masks);
  return view;
}

renderer::SurfelCloud get_surfels(PackReader& in) {
  const auto count =
      static_cast<std::size_t>(in.count<std::int64_t>("surfels", 1, kMostSurfels));
  RawSurfels raw;
  const auto get = [&](std::vector<float>& values, std::size_t each) {
    values.resize(count * each);
    in.get(values.data(), values.size());
  };
  get(raw.position_m, 3);
  get(raw.log_scale, 2);
  get(raw.rotation, 4);
  get(raw.opacity_logit, 1);
  get(raw.sh, 3);
  return surfel_cloud(raw);
}

}  // namespace

void write_training_pack(const std::filesystem::path& file, const TrainingSet& set,
                         const renderer::SurfelCloud& start) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    put(out, kMagic.data(), kMagic.size());
    put(out, kVersion);
    put(out, std::int32_t{set.intrinsics.width_px});
    put(out, std::int32_t{set.intrinsics.height_px});
    for (const double value : {set.intrinsics.fx_px, set.intrinsics.fy_px,
                               set.intrinsics.cx_px, set.intrinsics.cy_px}) {
      put(out, value);
    }
    put(out, static_cast<std::int32_t>(set.classes.size()));
    for (const core::SceneClass& c : set.classes) {
      put(out, c.id);
      put(out, std::uint16_t{c.thing});
    }
    put(out, static_cast<std::int32_t>(set.training.size() + set.held_out.size()));
    for (const TrainingView& view : set.training) put_view(out, view, false);
    for (const TrainingView& view : set.held_out) put_view(out, view, true);
    const RawSurfels raw = raw_surfels(start, 0);
    put(out, raw.count());
    for (const auto* values :
         {&raw.position_m, &raw.log_scale, &raw.rotation, &raw.opacity_logit, &raw.sh}) {
      put(out, values->data(), values->size());
    }
  });
}

TrainingPack read_training_pack(const std::filesystem::path& file) {
  PackReader in(file);
  std::array<char, 8> magic{};
  in.get(magic.data(), magic.size());
  if (magic != kMagic || in.get<std::int32_t>() != kVersion) {
    throw core::InputError::expected(in.place(), "a training pack of version 2",
                                     "another kind of file");
  }
  TrainingPack pack;
  core::CameraIntrinsics& camera = pack.set.intrinsics;
  camera.width_px = in.count<std::int32_t>("width", 1, kLargestSide_px);
  camera.height_px = in.count<std::int32_t>("height", 1, kLargestSide_px);
  for (double* value : {&camera.fx_px, &camera.fy_px, &camera.cx_px, &camera.cy_px}) {
    *value = in.get<double>();
  }
  pack.set.classes.resize(
      static_cast<std::size_t>(in.count<std::int32_t>("classes", 0, 65535)));
  for (core::SceneClass& c : pack.set.classes) {
    c.id = in.get<std::uint16_t>();
    c.thing = in.get<std::uint16_t>() != 0;
    c.name = "class " + std::to_string(c.id);
  }
  const auto views = in.count<std::int32_t>("views", 1, 1'000'000);
  for (std::int32_t i = 0; i < views; ++i) {
    const bool held_out = in.count<std::int32_t>("held_out", 0, 1) != 0;
    const auto frame = in.count<std::int64_t>("frame", 0, kMostFrames);
    TrainingView view = get_view(in, camera);
    view.frame = static_cast<std::size_t>(frame);
    view.name = std::to_string(frame);
    (held_out ? pack.set.held_out : pack.set.training).push_back(std::move(view));
  }
  pack.set.has_true_labels = true;
  pack.start = get_surfels(in);
  return pack;
}

}  // namespace segsim::reconstruction
