#include "experiments/trials/sensor_picture.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <opencv2/imgproc.hpp>

#include "core/formatted.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/scenes/coverage.h"
#include "sim/ground/robot.h"
#include "sim/sensors/depth_sensor.h"
#include "sim/sensors/lidar.h"
#include "sim/sensors/rgb_sensor.h"

namespace segsim::experiments::trials {
namespace {

constexpr int kMargin_px = 12, kCaption_px = 22;
constexpr double kLetter_px = 7.0;
constexpr double kDepth_m = 6.0;        ///< Of the coldest colour.
constexpr float kErrorShown_m = 0.10F;  ///< Of the fullest colour.
constexpr double kExposure_s = 0.030, kSweep_s = 0.015;
constexpr double kNearby_m = 5.0;  ///< Height of the part of the plan that is shown larger.
const cv::Scalar kScan(40, 40, 220), kSmeared(220, 120, 20);

/// A picture with the words above it.
struct Cell {
  std::string caption;
  cv::Mat picture;
};

/// Blue: too near, red: too far, white: right; black: not measured though something is there.
cv::Mat error_picture(const core::Image<float>& truth_m, const core::Image<float>& found_m) {
  cv::Mat picture(truth_m.height_px(), truth_m.width_px(), CV_8UC3, cv::Scalar(90, 90, 90));
  for (int y = 0; y < truth_m.height_px(); ++y) {
    for (int x = 0; x < truth_m.width_px(); ++x) {
      auto& pixel = picture.at<cv::Vec3b>(y, x);
      if (!(truth_m(x, y) <= static_cast<float>(kDepth_m))) continue;
      const float error_m = found_m(x, y) - truth_m(x, y);
      if (std::isnan(error_m)) {
        pixel = {0, 0, 0};
        continue;
      }
      const float size = std::min(1.0F, std::abs(error_m) / kErrorShown_m);
      const auto rest = static_cast<std::uint8_t>(std::lround(255.0F * (1.0F - size)));
      pixel = error_m < 0.0F ? cv::Vec3b(255, rest, rest) : cv::Vec3b(rest, rest, 255);
    }
  }
  return picture;
}

/// The view under each model.
class View {
 public:
  View(core::Renderer& renderer, const SensorSheetOptions& options)
      : renderer_(renderer), options_(options), exact_(render(options.pose)) {}

  [[nodiscard]] std::vector<Cell> colours() {
    sim::RgbModel blur, noise, jpeg;
    blur.exposure_s = kExposure_s;
    blur.sub_poses = 9;
    noise.full_well_e = 1000.0;
    noise.read_noise_e = 8.0;
    jpeg.jpeg_quality = 20;
    core::Image<core::Rgb8> noisy = exact_.rgb, coded = exact_.rgb;
    sim::add_rgb_noise(noise, sim::PixelNoise(options_.seed, "camera/rgb", 0), noisy);
    sim::compress_jpeg(jpeg, coded);
    return {
        {"colour: exact", drawing::to_bgr(exact_.rgb)},
        {core::print("exposure %.0f ms at %.1f rad/s", 1e3 * kExposure_s, options_.turn_radps),
         drawing::to_bgr(exposed(blur))},
        {"shot and read noise: full well 1000 e-, 8 e-", drawing::to_bgr(noisy)},
        {"JPEG, quality 20", drawing::to_bgr(coded)}};
  }

  /// Depth, and below it its errors.
  void append_depths(std::vector<Cell>& depths, std::vector<Cell>& errors) const {
    sim::DepthModel ideal, kinect, redwood, edges;
    kinect.noise = sim::DepthNoise::kKinectAxial;
    redwood.noise = sim::DepthNoise::kRedwood;
    edges = kinect;
    edges.flying_pixels = 0.5;
    edges.grazing_limit_rad = 1.396;
    edges.min_range_m = 0.5;
    const std::pair<const char*, sim::DepthModel*> shown[] = {
        {"depth: ideal", &ideal},
        {"kinect-axial", &kinect},
        {"redwood", &redwood},
        {"kinect-axial, flying pixels, grazing 80 deg", &edges}};
    for (const auto& [name, model] : shown) {
      model->max_range_m = kDepth_m;
      core::Image<float> measured_m;
      sim::measure_depth(*model, options_.camera,
                         sim::PixelNoise(options_.seed, "camera/depth", 0), exact_.depth_m,
                         measured_m);
      depths.push_back({name, drawing::to_bgr(drawing::depth_picture(measured_m, kDepth_m))});
      errors.push_back({core::print("error: red far, blue near (full: %.0f cm), black none",
                                    100.0 * double{kErrorShown_m}),
                        error_picture(exact_.depth_m, measured_m)});
    }
  }

 private:
  [[nodiscard]] core::Frame render(const core::Pose2& pose) {
    return renderer_.render(core::transform_from_pose2<core::frame::World>(pose) *
                                core::mast_camera(options_.camera_height_m, 0.0),
                            options_.camera, core::Channels::kRgbd);
  }

  [[nodiscard]] core::Image<core::Rgb8> exposed(const sim::RgbModel& model) {
    sim::ExposureMean mean;
    for (const double offset_s : model.exposure_offsets_s()) {
      mean.add(
          render(sim::drive_arc(options_.pose, {0.0, options_.turn_radps}, offset_s)).rgb);
    }
    core::Image<core::Rgb8> made;
    mean.finish(made);
    return made;
  }

  core::Renderer& renderer_;
  const SensorSheetOptions& options_;
  core::Frame exact_;
};

/// The ends of the beams on the plan, as the robot at `pose` would draw them.
void draw_scan(cv::Mat& map, const drawing::FloorPlan& plan, double scale,
               const sim::LidarModel& model, const core::Pose2& pose,
               const std::vector<float>& ranges_m, const cv::Scalar& color) {
  const glm::dvec2 origin_m(pose.x_m + model.forward_m * std::cos(pose.yaw_rad),
                            pose.y_m + model.forward_m * std::sin(pose.yaw_rad));
  for (int beam = 0; beam < model.beams; ++beam) {
    const double range_m = ranges_m[static_cast<std::size_t>(beam)];
    if (std::isnan(range_m)) continue;
    const double angle = pose.yaw_rad + model.angle_rad(beam);
    const glm::dvec2 p =
        scale * plan.to_px(origin_m + range_m * glm::dvec2(std::cos(angle), std::sin(angle)));
    constexpr int kShift = 4;  // OpenCV draws in sixteenths of a pixel.
    cv::circle(map, {cvRound(16.0 * p.x), cvRound(16.0 * p.y)}, 24, color, cv::FILLED,
               cv::LINE_AA, kShift);
  }
}

/// Two scans of a turning robot on the plan, drawn at that scale.
cv::Mat scan_map(const sim::World& world, const drawing::FloorPlan& plan,
                 const SensorSheetOptions& options, double scale) {
  cv::Mat map;
  cv::resize(drawing::to_bgr(plan.rgb), map, {}, scale, scale, cv::INTER_AREA);
  map = 0.45 * map + 0.55 * cv::Mat(map.size(), CV_8UC3, drawing::ink::kPaper);
  const auto rays = sim::make_ray_scene(world.mesh());
  sim::LidarModel model;
  const auto turning = [&options](core::TimeNs t) {
    return sim::drive_arc(options.pose, {0.0, options.turn_radps}, core::seconds(t));
  };
  model.sweep_s = kSweep_s;
  draw_scan(map, plan, scale, model, options.pose,
            sim::scan(model, *rays, turning, 0, options.seed, 0), kSmeared);
  model.sweep_s = 0.0;
  draw_scan(map, plan, scale, model, options.pose,
            sim::scan(model, *rays, turning, 0, options.seed, 0), kScan);
  const glm::dvec2 robot = scale * plan.to_px({options.pose.x_m, options.pose.y_m});
  const cv::Point at(cvRound(robot.x), cvRound(robot.y));
  cv::circle(map, at, 6, drawing::ink::kStart, cv::FILLED, cv::LINE_AA);
  cv::line(map, at,
           {cvRound(robot.x + 16.0 * std::cos(options.pose.yaw_rad)),
            cvRound(robot.y - 16.0 * std::sin(options.pose.yaw_rad))},
           drawing::ink::kStart, 2, cv::LINE_AA);
  return map;
}

/// The whole plan, and what lies around the robot, larger.
std::vector<Cell> scan_cells(const sim::World& world, const drawing::FloorPlan& plan,
                             const SensorSheetOptions& options, int width_px, int height_px) {
  const double whole = std::min(static_cast<double>(width_px) / plan.rgb.width_px(),
                                static_cast<double>(height_px) / plan.rgb.height_px());
  const double near = std::min(width_px, height_px) / (kNearby_m * plan.px_per_m);
  const cv::Mat large = scan_map(world, plan, options, near);
  const glm::dvec2 robot = near * plan.to_px({options.pose.x_m, options.pose.y_m});
  const cv::Rect around(cvRound(robot.x) - width_px / 2, cvRound(robot.y) - height_px / 2,
                        width_px, height_px);
  return {{"lidar, 720 beams: red all at once", scan_map(world, plan, options, whole)},
          {core::print(
               "blue: swept in %.0f ms at %.1f rad/s, drawn from the pose of the first beam",
               1e3 * kSweep_s, options.turn_radps),
           large(around & cv::Rect({0, 0}, large.size())).clone()}};
}

void place(cv::Mat& sheet, const Cell& cell, int left, int top) {
  drawing::draw_text(sheet, cell.caption, {static_cast<double>(left), top + kCaption_px - 7.0},
                     kLetter_px, drawing::ink::kText);
  cell.picture.copyTo(
      sheet(cv::Rect(left, top + kCaption_px, cell.picture.cols, cell.picture.rows)));
}

}  // namespace

core::Pose2 roomiest_pose(const sim::World& world) {
  const std::vector<glm::dvec2> cells_m = scenes::reachable_cells_m(world);
  const auto roomiest = std::max_element(
      cells_m.begin(), cells_m.end(), [&world](const glm::dvec2& a, const glm::dvec2& b) {
        return world.collision().body_distance_m(a) < world.collision().body_distance_m(b);
      });
  return {roomiest->x, roomiest->y, 0.0};
}

core::Image<core::Rgb8> draw_sensor_sheet(core::Renderer& renderer, const sim::World& world,
                                          const drawing::FloorPlan& plan,
                                          const SensorSheetOptions& options) {
  View view(renderer, options);
  std::vector<std::vector<Cell>> rows{view.colours()};
  rows.resize(3);
  view.append_depths(rows[1], rows[2]);
  const int step_x = options.camera.width_px + kMargin_px;
  const int step_y = options.camera.height_px + kCaption_px + kMargin_px;
  const int columns = static_cast<int>(rows[0].size());
  const int width_px = kMargin_px + columns * step_x;
  const std::vector<Cell> maps =
      scan_cells(world, plan, options, 2 * step_x - kMargin_px, 2 * options.camera.height_px);
  cv::Mat sheet(kMargin_px + 3 * step_y +
                    std::max(maps[0].picture.rows, maps[1].picture.rows) + kCaption_px +
                    kMargin_px,
                width_px, CV_8UC3, drawing::ink::kPaper);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < columns; ++column) {
      place(sheet, rows[static_cast<std::size_t>(row)][static_cast<std::size_t>(column)],
            kMargin_px + column * step_x, kMargin_px + row * step_y);
    }
  }
  for (int k = 0; k < 2; ++k) {
    place(sheet, maps[static_cast<std::size_t>(k)], kMargin_px + 2 * k * step_x,
          kMargin_px + 3 * step_y);
  }
  return drawing::from_bgr(sheet);
}

}  // namespace segsim::experiments::trials
