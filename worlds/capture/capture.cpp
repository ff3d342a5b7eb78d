#include "worlds/capture/capture.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <sstream>

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfOutputFile.h>
#include <glm/gtc/quaternion.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/system/remakeable_file.h"

namespace segsim::worlds {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSettingsFile = "capture.txt";

std::string number(double value) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.17g", value);
  return text.data();
}

std::string pose_text(const core::CameraPose& T_world_camera) {
  const glm::dmat3 R = glm::mat3_cast(T_world_camera.rotation());
  const glm::dvec3& p_m = T_world_camera.translation_m();
  std::string text;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) text += number(R[column][row]) + "\t";
    text += number(p_m[row]) + "\n";
  }
  return text + "0\t0\t0\t1\n";
}

std::string intrinsics_text(const core::CameraIntrinsics& camera) {
  return number(camera.fx_px) + " 0 " + number(camera.cx_px) + "\n0 " + number(camera.fy_px) +
         " " + number(camera.cy_px) + "\n0 0 1\n";
}

/// A YAML string in double quotes.
std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20U) {
      std::array<char, 8> escape{};
      std::snprintf(escape.data(), escape.size(), "\\x%02x", static_cast<unsigned int>(c));
      result += escape.data();
      continue;
    }
    if (c == '"' || c == '\\') result += '\\';
    result += c;
  }
  return result + '"';
}

std::string labels_text(const std::vector<core::SceneClass>& classes,
                        const std::vector<core::SceneInstance>& instances,
                        const std::string& source) {
  std::ostringstream text;
  text << "schema: segsim.labels\nversion: 1\npixel_center: 0.5\nup: z\nsource: "
       << quoted(source) << "\nclasses:" << (classes.empty() ? " []\n" : "\n");
  for (const core::SceneClass& entry : classes) {
    text << "  - {id: " << entry.id << ", name: " << quoted(entry.name)
         << ", thing: " << (entry.thing ? "true" : "false") << "}\n";
  }
  text << "instances:" << (instances.empty() ? " []\n" : "\n");
  for (const core::SceneInstance& entry : instances) {
    text << "  - {id: " << entry.id << ", class: " << entry.class_id
         << ", name: " << quoted(entry.name) << "}\n";
  }
  return text.str();
}

void write_text(const fs::path& file, const std::string& text) {
  core::write_file_atomically(file, [&](std::ostream& stream) { stream << text; });
}

void write_png(const fs::path& file, const cv::Mat& image) {
  std::vector<unsigned char> bytes;
  SEGSIM_CHECK(cv::imencode(".png", image, bytes), file.string());
  core::write_remakeable_file(file, [&](std::ostream& stream) {
    stream.write(reinterpret_cast<const char*>(bytes.data()),
                 static_cast<std::streamsize>(bytes.size()));
  });
}

cv::Mat to_bgr(const core::Image<core::Rgb8>& rgb) {
  cv::Mat bgr(rgb.height_px(), rgb.width_px(), CV_8UC3);
  for (int y = 0; y < rgb.height_px(); ++y) {
    auto* row = bgr.ptr<cv::Vec3b>(y);
    for (int x = 0; x < rgb.width_px(); ++x) {
      const core::Rgb8& pixel = rgb(x, y);
      row[x] = cv::Vec3b(pixel.b, pixel.g, pixel.r);
    }
  }
  return bgr;
}

cv::Mat to_16_bit(const core::Image<std::uint16_t>& ids) {
  cv::Mat image(ids.height_px(), ids.width_px(), CV_16UC1);
  for (int y = 0; y < ids.height_px(); ++y) {
    std::copy_n(ids.row(y), ids.width_px(), image.ptr<std::uint16_t>(y));
  }
  return image;
}

cv::Mat to_millimetres(const core::Image<float>& depth_m) {
  cv::Mat image(depth_m.height_px(), depth_m.width_px(), CV_16UC1);
  for (int y = 0; y < depth_m.height_px(); ++y) {
    auto* row = image.ptr<std::uint16_t>(y);
    for (int x = 0; x < depth_m.width_px(); ++x) {
      const float d_m = depth_m(x, y);
      row[x] = std::isfinite(d_m) ? static_cast<std::uint16_t>(std::lround(d_m * 1000.0F)) : 0;
    }
  }
  return image;
}

void write_depth(const fs::path& file, const core::Image<float>& depth_m) {
  core::write_remakeable_via_temporary(file, [&](const fs::path& temporary) {
    Imf::Header header(depth_m.width_px(), depth_m.height_px());
    header.compression() = Imf::ZIP_COMPRESSION;
    header.channels().insert("Z", Imf::Channel(Imf::FLOAT));
    // OpenEXR takes a pointer to non-const but only reads from it.
    char* pixels = const_cast<char*>(reinterpret_cast<const char*>(depth_m.data()));
    Imf::FrameBuffer buffer;
    buffer.insert("Z",
                  Imf::Slice(Imf::FLOAT, pixels, sizeof(float),
                             sizeof(float) * static_cast<std::size_t>(depth_m.width_px())));
    try {
      Imf::OutputFile output(temporary.string().c_str(), header);
      output.setFrameBuffer(buffer);
      output.writePixels(depth_m.height_px());
    } catch (const std::exception& error) {
      throw core::InputError::expected(file.string(), "room to write", error.what());
    }
  });
}

class CaptureFolder {
 public:
  CaptureFolder(fs::path folder, const CaptureOptions& options)
      : folder_(std::move(folder)), options_(options) {}

  /// Makes the folder ready: keeps it, empties it or refuses it.
  void open(const std::string& settings) {
    const fs::path settings_file = folder_ / kSettingsFile;
    if (fs::exists(settings_file) && !options_.overwrite) {
      if (core::read_file(settings_file) != settings) {
        throw core::InputError::expected(
            settings_file.string(),
            "the settings of this capture (or permission to overwrite)",
            "those of another capture");
      }
      return;
    }
    // Frames without settings, or settings that are to go: nothing of it may be taken for
    // ours.
    std::vector<fs::path> old_files;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder_, error)) {
      if (entry.path().filename().string().starts_with("frame-")) {
        old_files.push_back(entry.path());
      }
    }
    if (!old_files.empty() && !options_.overwrite) {
      throw core::InputError::expected(
          folder_.string(), "an empty folder (or permission to overwrite)", "frames");
    }
    fs::remove(settings_file, error);
    for (const fs::path& file : old_files) fs::remove(file, error);
    write_text(settings_file, settings);
  }

  [[nodiscard]] bool is_complete(std::size_t index) const {
    for (const char* suffix :
         {"color.png", "depth.png", "semantic.png", "instance.png", "pose.txt"}) {
      if (!is_written(index, suffix)) return false;
    }
    return !options_.depth_exr || is_written(index, "depth.exr");
  }

  void write(std::size_t index, core::Frame& frame) const {
    const auto max_depth_m = static_cast<float>(options_.max_depth_m);
    for (float& depth_m : frame.depth_m.pixels()) {
      if (!(depth_m > 0.0F && depth_m <= max_depth_m)) {
        depth_m = std::numeric_limits<float>::quiet_NaN();
      }
    }
    write_png(file(index, "color.png"), to_bgr(frame.rgb));
    write_png(file(index, "depth.png"), to_millimetres(frame.depth_m));
    write_png(file(index, "semantic.png"), to_16_bit(frame.semantic));
    write_png(file(index, "instance.png"), to_16_bit(frame.instance));
    if (options_.depth_exr) write_depth(file(index, "depth.exr"), frame.depth_m);
    core::write_remakeable_file(file(index, "pose.txt"), [&](std::ostream& stream) {
      stream << pose_text(frame.T_world_camera);
    });
  }

 private:
  /// A power cut leaves names without what they stand for (core/system/remakeable_file.h).
  [[nodiscard]] bool is_written(std::size_t index, const std::string& suffix) const {
    std::error_code error;
    const std::uintmax_t bytes = fs::file_size(file(index, suffix), error);
    return !error && bytes > 0;
  }
  [[nodiscard]] fs::path file(std::size_t index, const std::string& suffix) const {
    std::array<char, 32> stem{};
    std::snprintf(stem.data(), stem.size(), "frame-%06zu.", index);
    return folder_ / (stem.data() + suffix);
  }

  fs::path folder_;
  const CaptureOptions& options_;
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

CaptureReport capture_sequence(core::Renderer& renderer,
                               std::span<const core::CameraPose> poses,
                               const core::CameraIntrinsics& intrinsics,
                               const fs::path& folder,
                               const std::vector<core::SceneClass>& classes,
                               const std::vector<core::SceneInstance>& instances,
                               const CaptureOptions& options) {
  SEGSIM_CHECK(options.max_depth_m > 0 && options.max_depth_m <= 65.535,
               number(options.max_depth_m));
  const std::string camera = intrinsics_text(intrinsics);
  const std::string labels = labels_text(classes, instances, options.source);
  std::string poses_text;
  for (const core::CameraPose& pose : poses) poses_text += pose_text(pose);
  const std::string settings =
      "capture 1\nframes " + std::to_string(poses.size()) + "\nimage_px " +
      std::to_string(intrinsics.width_px) + " " + std::to_string(intrinsics.height_px) +
      "\nmax_depth_m " + number(options.max_depth_m) + "\ndepth_exr " +
      (options.depth_exr ? "1" : "0") + "\nintrinsics_sha256 " + core::sha256_hex(camera) +
      "\nlabels_sha256 " + core::sha256_hex(labels) + "\nposes_sha256 " +
      core::sha256_hex(poses_text) + "\n";

  CaptureFolder output(folder, options);
  output.open(settings);
  write_text(folder / "intrinsics.txt", camera);
  write_text(folder / "labels.yaml", labels);

  CaptureReport report;
  core::Frame frame;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (output.is_complete(i)) {
      ++report.kept;
    } else {
      const auto start = std::chrono::steady_clock::now();
      renderer.render(poses[i], intrinsics, core::Channels::kRgbd | core::Channels::kLabels,
                      frame);
      report.render_s += seconds_since(start);
      const auto rendered = std::chrono::steady_clock::now();
      output.write(i, frame);
      report.write_s += seconds_since(rendered);
      ++report.written;
    }
    if (options.on_frame)
      options.on_frame(static_cast<int>(i) + 1, static_cast<int>(poses.size()));
  }
  return report;
}

}  // namespace segsim::worlds
