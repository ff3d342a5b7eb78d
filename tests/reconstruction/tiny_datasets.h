#pragma once

/// @file
/// Folders in the layouts of public data sets, two to three frames of 16 x 12 pixels each.
/// Frame i of each looks along the world's +z from (i + 1, 2, 3), so that the position tells
/// the frame and the direction tells the axes.

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/error.h"
#include "reconstruction/datasets/rgbd_sequence.h"
#include "tests/reconstruction/tiny_sequence.h"

namespace segsim::reconstruction::testing {

namespace fs = std::filesystem;

/// Message of the InputError that opening the folder throws; "no error" otherwise.
inline std::string open_error(const fs::path& folder, const SequenceOptions& options = {}) {
  try {
    (void)open_sequence(folder, options);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "no error";
}

/// World z of the source is up, and its height 0 the floor.
inline SequenceOptions as_is(SequenceLayout layout = SequenceLayout::kAuto) {
  SequenceOptions options;
  options.layout = layout;
  options.floor_height_m = 0.0;
  return options;
}

inline void write_rgb(const fs::path& file, int width = kWidth, int height = kHeight) {
  fs::create_directories(file.parent_path());
  cv::imwrite(file.string(), cv::Mat(height, width, CV_8UC3, cv::Scalar(30, 20, 10)));
}

/// Depth of `counts` everywhere, 0 in the first pixel.
inline void write_depth(const fs::path& file, int counts, int width = kWidth,
                        int height = kHeight) {
  fs::create_directories(file.parent_path());
  cv::Mat image(height, width, CV_16UC1, cv::Scalar(counts));
  image.at<std::uint16_t>(0, 0) = 0;
  cv::imwrite(file.string(), image);
}

/// `left` in the left half, `right` in the right half.
inline void write_ids(const fs::path& file, int left, int right, int type = CV_16UC1) {
  fs::create_directories(file.parent_path());
  cv::Mat image(kHeight, kWidth, type, cv::Scalar(left));
  image(cv::Rect(kWidth / 2, 0, kWidth / 2, kHeight)).setTo(cv::Scalar(right));
  cv::imwrite(file.string(), image);
}

inline void write_file(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  write_text(file, text);
}

inline constexpr const char* kMatrix4 = "20 0 7.5 0\n0 21 5.5 0\n0 0 1 0\n0 0 0 1\n";

/// Frames 2, 9 and 10; tracking was lost in 9.
inline void write_scannet(const fs::path& scan, bool labels = true) {
  for (const int n : {2, 9, 10}) {
    const std::string name = std::to_string(n);
    write_rgb(scan / "color" / (name + ".jpg"));
    write_depth(scan / "depth" / (name + ".png"), 1500, 8, 6);
    const std::string row = "-inf -inf -inf -inf\n";
    write_file(scan / "pose" / (name + ".txt"),
               n == 9 ? row + row + row + row : pose_line(n, 2.0, 3.0, "\n"));
    if (!labels) continue;
    write_ids(scan / "label-filt" / (name + ".png"), 1, n == 2 ? 23 : 500);
    write_ids(scan / "instance-filt" / (name + ".png"), 4, 7, CV_8UC1);
  }
  write_file(scan / "intrinsic/intrinsic_color.txt", kMatrix4);
  write_file(scan / "intrinsic/intrinsic_depth.txt",
             "10 0 3.5 0\n0 10.5 2.5 0\n0 0 1 0\n0 0 0 1\n");
}

/// The new layout of the table: raw ids 1 wall, 23 armchair -> chair, 500 something else.
inline const std::string kScanNetTable =
    "id\traw_category\tcategory\tcount\tnyu40id\teigen13id\n1\twall\twall\t9\t1\t12\n"
    "23\tarmchair\tchair\t5\t5\t4\n500\tdragon\tother\t1\t40\t7\n";

inline void write_replica(const fs::path& sequence) {
  for (const int n : {0, 1}) {
    const std::string i = std::to_string(n) + ".png";
    write_rgb(sequence / "rgb" / ("rgb_" + i));
    write_depth(sequence / "depth" / ("depth_" + i), 1500);
    write_ids(sequence / "semantic_class" / ("semantic_class_" + i), 93, 20);
    write_ids(sequence / "semantic_instance" / ("semantic_instance_" + i), 3, 12);
  }
  write_file(sequence / "traj_w_c.txt", pose_line(1, 2, 3) + pose_line(2, 2, 3));
  write_file(sequence / "intrinsics.txt", kMatrix4);
}

inline const std::string kReplicaClasses =
    R"({"classes": [{"id": 20, "name": "chair"}, {"id": 93, "name": "wall"}],
        "objects": [{"id": 12, "class_id": 20}]})";

inline void write_tum(const fs::path& folder) {
  std::string rgb = "# color images\n# timestamp filename\n", depth, poses;
  for (int i = 0; i < 3; ++i) {
    const std::string time = std::to_string(1305031102.1 + 0.1 * i);
    write_rgb(folder / "rgb" / (time + ".png"));
    write_depth(folder / "depth" / (time + ".png"), 7500);
    rgb += time + " rgb/" + time + ".png\n";
    // The depth of the last one comes too late.
    depth += std::to_string(1305031102.1 + 0.1 * i + (i == 2 ? 0.03 : 0.015)) + " depth/" +
             time + ".png\n";
    poses += std::to_string(1305031102.11 + 0.1 * i) + " " + std::to_string(i + 1) +
             " 2 3 0 0 0 1\n";
  }
  write_file(folder / "rgb.txt", rgb);
  write_file(folder / "depth.txt", depth);
  write_file(folder / "groundtruth.txt", "# timestamp tx ty tz qx qy qz qw\n" + poses);
  write_file(folder / "intrinsics.txt", "20 21 7.5 5.5\n");
}

/// Camera axes of OpenGL: looking along the world's +z means that the camera's z points to -z.
inline std::string opengl_matrix(int i) {
  return "[[1, 0, 0, " + std::to_string(i + 1) +
         "], [0, -1, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]]";
}

inline std::string transforms_json(const std::string& camera, bool depth) {
  std::string frames;
  for (int i = 0; i < 2; ++i) {
    const std::string n = std::to_string(i);
    frames += std::string(i == 0 ? "" : ",\n") + "{\"file_path\": \"images/" + n + ".png\", " +
              (depth ? "\"depth_file_path\": \"depth/" + n + ".png\", " : "") +
              "\"mask_path\": \"masks/" + n +
              ".png\", \"transform_matrix\": " + opengl_matrix(i) + "}";
  }
  return "{" + camera + ",\n\"applied_scale\": 0.5,\n\"frames\": [" + frames + "]}";
}

inline const std::string kPinholeJson =
    R"("w": 16, "h": 12, "fl_x": 20, "fl_y": 21, "cx": 8.25, "cy": 6.0)";

inline void write_nerfstudio(const fs::path& folder, bool depth = true) {
  for (int i = 0; i < 2; ++i) {
    const std::string n = std::to_string(i) + ".png";
    write_rgb(folder / "images" / n);
    write_ids(folder / "masks" / n, 0, 255, CV_8UC1);
    if (depth) write_depth(folder / "depth" / n, 1500);
  }
  write_file(folder / "transforms.json", transforms_json(kPinholeJson, depth));
}

/// World-to-camera of the camera at (i + 1, 2, 3) that looks along +z: t = -position.
inline std::string colmap_image(int id, int i, const std::string& name, int camera = 1) {
  return std::to_string(id) + " 1 0 0 0 " + std::to_string(-(i + 1)) + " -2 -3 " +
         std::to_string(camera) + " " + name + "\n10.5 3.25 -1 4 5 17\n";
}

inline void write_colmap_text(const fs::path& model, const std::string& cameras,
                              const std::string& images) {
  write_file(model / "cameras.txt", "# Camera list\n" + cameras);
  write_file(model / "images.txt", "# Image list\n" + images);
}

inline void write_colmap(const fs::path& folder) {
  write_rgb(folder / "images/a.png");
  write_rgb(folder / "images/b c.png");
  write_colmap_text(folder / "sparse/0", "1 PINHOLE 16 12 20 21 8.25 6\n",
                    colmap_image(7, 1, "b c.png") + colmap_image(9, 0, "a.png"));
}

}  // namespace segsim::reconstruction::testing
