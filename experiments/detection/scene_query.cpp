#include "experiments/detection/scene_query.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/formatted.h"
#include "core/frames.h"
#include "experiments/drawing/box_picture.h"

namespace segsim::experiments::detection {
namespace {

using Picture = core::Image<core::Rgb8>;

constexpr core::Rgb8 kGrey{128, 128, 128};

struct PixelBox {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;  ///< x1, y1 are outside.
  int pixels = 0;
};

PixelBox box_of(const core::Image<std::uint16_t>& ids, std::uint16_t id) {
  PixelBox box{ids.width_px(), ids.height_px(), 0, 0, 0};
  for (int y = 0; y < ids.height_px(); ++y) {
    for (int x = 0; x < ids.width_px(); ++x) {
      if (ids(x, y) != id) continue;
      box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1),
             std::max(box.y1, y + 1), box.pixels + 1};
    }
  }
  return box;
}

PixelBox widened(const PixelBox& box, double margin, const Picture& within) {
  const auto by = static_cast<int>(margin * std::max(box.x1 - box.x0, box.y1 - box.y0));
  return {std::max(0, box.x0 - by), std::max(0, box.y0 - by),
          std::min(within.width_px(), box.x1 + by), std::min(within.height_px(), box.y1 + by),
          box.pixels};
}

/// A view of an object: around it, and alone.
struct ObjectView {
  int pixels = 0;
  Picture crop, alone;
};

ObjectView cut_out(const core::Frame& frame, std::uint16_t id, const PixelBox& tight,
                   double margin) {
  const PixelBox box = widened(tight, margin, frame.rgb);
  ObjectView view{tight.pixels, Picture(box.x1 - box.x0, box.y1 - box.y0),
                  Picture(box.x1 - box.x0, box.y1 - box.y0)};
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) {
      const core::Rgb8 colour = frame.rgb(x, y);
      view.crop(x - box.x0, y - box.y0) = colour;
      view.alone(x - box.x0, y - box.y0) = frame.instance(x, y) == id ? colour : kGrey;
    }
  }
  return view;
}

/// Around the object, twice: once so near that it about fills the view, once from farther
/// away. What stands between hides it, and such a view is not used.
std::vector<core::CameraPose> eyes_around(const core::SceneInstance& instance,
                                          const SceneQueryOptions& options) {
  const glm::dvec3 centre_m = 0.5 * (instance.box_min_m + instance.box_max_m);
  const double radius_m = 0.5 * glm::distance(instance.box_min_m, instance.box_max_m);
  const double half_view = options.hfov_deg * std::numbers::pi / 360.0;
  const double near_m = std::clamp(1.2 * radius_m / std::tan(half_view), 0.6, 4.0);
  std::vector<core::CameraPose> eyes;
  for (const double distance_m : {near_m, 1.6 * near_m}) {
    for (int k = 0; k < options.directions; ++k) {
      const double angle_rad = 2.0 * std::numbers::pi * k / options.directions;
      const glm::dvec3 eye_m(centre_m.x + distance_m * std::cos(angle_rad),
                             centre_m.y + distance_m * std::sin(angle_rad),
                             options.camera_height_m);
      eyes.push_back(core::look_at(eye_m, centre_m));
    }
  }
  return eyes;
}

std::vector<ObjectView> best_views(core::Renderer& renderer,
                                   const core::SceneInstance& instance,
                                   const SceneQueryOptions& options) {
  const auto camera = core::CameraIntrinsics::from_fov(
      options.width_px, options.height_px, options.hfov_deg * std::numbers::pi / 180.0);
  std::vector<ObjectView> views;
  core::Frame frame;
  for (const core::CameraPose& T_world_camera : eyes_around(instance, options)) {
    renderer.render(T_world_camera, camera, core::Channels::kRgb | core::Channels::kLabels,
                    frame);
    const PixelBox box = box_of(frame.instance, instance.id);
    if (box.pixels < options.least_px) continue;
    views.push_back(cut_out(frame, instance.id, box, options.margin));
  }
  std::stable_sort(views.begin(), views.end(), [](const ObjectView& a, const ObjectView& b) {
    return a.pixels > b.pixels;
  });
  views.resize(std::min(views.size(), static_cast<std::size_t>(options.views)));
  return views;
}

}  // namespace

std::vector<QueriedInstance> query_scene(core::Renderer& renderer,
                                         const core::SceneManifest& manifest,
                                         perception::ImageTextScorer& scorer,
                                         const std::vector<std::string>& phrases,
                                         const SceneQueryOptions& options,
                                         const std::function<void(int, int)>& on_instance) {
  if (manifest.instances.empty()) {
    throw core::InputError::expected("scene " + manifest.name, "things to ask about", "none");
  }
  std::vector<QueriedInstance> answers;
  for (const core::SceneInstance& instance : manifest.instances) {
    QueriedInstance answer;
    answer.id = instance.id;
    answer.name = instance.name;
    for (const core::SceneClass& c : manifest.classes) {
      if (c.id == instance.class_id) answer.class_name = c.name;
    }
    answer.centre_m = 0.5 * (instance.box_min_m + instance.box_max_m);
    std::vector<ObjectView> views = best_views(renderer, instance, options);
    answer.views = static_cast<int>(views.size());
    if (!views.empty()) answer.scores.assign(phrases.size(), 0.0);
    for (const ObjectView& view : views) {
      for (const Picture* picture : {&view.crop, &view.alone}) {
        const std::vector<float> scores = scorer.scores(*picture, phrases);
        for (std::size_t p = 0; p < phrases.size(); ++p) {
          answer.scores[p] +=
              static_cast<double>(scores[p]) / (2.0 * static_cast<double>(views.size()));
        }
      }
    }
    if (!views.empty()) answer.picture = std::move(views.front().crop);
    answers.push_back(std::move(answer));
    if (on_instance) {
      on_instance(static_cast<int>(answers.size()),
                  static_cast<int>(manifest.instances.size()));
    }
  }
  return answers;
}

std::vector<std::size_t> ranking(const std::vector<QueriedInstance>& instances,
                                 std::size_t phrase) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < instances.size(); ++i) {
    if (instances[i].views > 0) order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return instances[a].scores[phrase] > instances[b].scores[phrase];
  });
  return order;
}

std::vector<std::size_t> meant_by(const std::vector<QueriedInstance>& instances,
                                  std::size_t phrase, int count) {
  std::vector<std::size_t> meant = ranking(instances, phrase);
  if (meant.empty()) return meant;
  const std::string& class_name = instances[meant.front()].class_name;
  std::erase_if(meant, [&](std::size_t i) { return instances[i].class_name != class_name; });
  meant.resize(std::min(meant.size(), static_cast<std::size_t>(count)));
  return meant;
}

Picture query_picture(const std::vector<QueriedInstance>& instances,
                      const std::vector<std::string>& phrases, int most) {
  std::vector<drawing::SheetPicture> pictures;
  std::size_t columns = 1;
  std::string title;
  for (std::size_t p = 0; p < phrases.size(); ++p) {
    std::vector<std::size_t> order = ranking(instances, p);
    order.resize(std::min(order.size(), static_cast<std::size_t>(most)));
    columns = std::max(columns, order.size());
    title += (p == 0 ? "" : " / ") + phrases[p];
    for (const std::size_t i : order) {
      pictures.push_back({instances[i].picture,
                          core::print("%.3f  ", instances[i].scores[p]) + instances[i].name});
    }
  }
  return drawing::picture_sheet(pictures, static_cast<int>(columns), title);
}

}  // namespace segsim::experiments::detection
