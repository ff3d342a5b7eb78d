#include "experiments/bags/unpack_recording.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/input/bounds.h"
#include "core/stages.h"
#include "experiments/bags/bag_file.h"
#include "experiments/bags/transform_tree.h"
#include "ros/mcap/topic.h"
#include "ros/messages/sensor_msgs.h"
#include "ros/messages/tf2_msgs.h"

namespace segsim::experiments::bags {
namespace {

namespace fs = std::filesystem;
using core::InputError;
using ros::mcap::StoredMessage;
using ros::sensor_msgs::CameraInfo;
using ros::sensor_msgs::CompressedImage;
using ros::sensor_msgs::Image;

/// Counts a metre of the layout's depth images.
constexpr double kCountsPerMetre = 5000.0;
constexpr const char* kMark = "unpacked_from.txt";  // Made by us, so that it may be replaced.

struct Encoding {
  const char* name;
  int type;    // Of OpenCV.
  int to_bgr;  // cv::ColorConversionCodes; -1: it is.
};
constexpr Encoding kColors[] = {{"rgb8", CV_8UC3, cv::COLOR_RGB2BGR},
                                {"bgr8", CV_8UC3, -1},
                                {"rgba8", CV_8UC4, cv::COLOR_RGBA2BGR},
                                {"bgra8", CV_8UC4, cv::COLOR_BGRA2BGR},
                                {"mono8", CV_8UC1, cv::COLOR_GRAY2BGR}};
constexpr Encoding kDepths[] = {{"16UC1", CV_16UC1, -1}, {"32FC1", CV_32FC1, -1}};

template <std::size_t n>
const Encoding& encoding_of(const Image& image, const Encoding (&known)[n],
                            const std::string& place) {
  std::string words;
  for (const Encoding& one : known) {
    if (image.encoding == one.name) return one;
    words += (words.empty() ? "" : ", ") + std::string(one.name);
  }
  throw InputError::expected(place, "an image with encoding " + words, image.encoding);
}

/// The pixels where they lie in the message.
cv::Mat pixels_of(const Image& image, int type, const std::string& place) {
  const std::uint64_t row_bytes = std::uint64_t{image.width} * CV_ELEM_SIZE(type);
  const std::uint64_t pixels = std::uint64_t{image.width} * image.height;
  const bool fits = pixels > 0 && pixels <= static_cast<std::uint64_t>(core::kMostPixels) &&
                    image.step >= row_bytes &&
                    image.data.size() >= std::uint64_t{image.step} * image.height;
  if (!fits || image.is_bigendian != 0) {
    throw InputError::expected(
        place, "little-endian rows of its width and height",
        std::to_string(image.width) + "x" + std::to_string(image.height) + ", rows of " +
            std::to_string(image.step) + ", " + std::to_string(image.data.size()) + " bytes");
  }
  // OpenCV has no view of what must not be changed; nothing changes it.
  return {static_cast<int>(image.height), static_cast<int>(image.width), type,
          const_cast<std::uint8_t*>(image.data.data()), image.step};
}

cv::Mat decoded(std::span<const std::uint8_t> bytes, int flags, const std::string& place) {
  cv::Mat picture;
  if (!bytes.empty()) {
    const cv::Mat input(1, static_cast<int>(bytes.size()), CV_8UC1,
                        const_cast<std::uint8_t*>(bytes.data()));
    try {
      picture = cv::imdecode(input, flags);
    } catch (const cv::Exception&) {
      picture.release();
    }
  }
  if (picture.empty()) throw InputError::expected(place, "a JPEG or PNG picture", "another");
  return picture;
}

/// A picture and when and by which camera it was taken.
struct Picture {
  std::int64_t time_ns = 0;
  std::string frame;
  cv::Mat pixels;
};

bool is_compressed(const StoredMessage& message) {
  return message.channel->schema.name.ends_with("CompressedImage");
}

/// BGR.
Picture color_of(const StoredMessage& message) {
  const std::string place = message.place();
  if (is_compressed(message)) {
    const auto image = ros::mcap::decode<CompressedImage>(message);
    return {nanoseconds(image.header.stamp), image.header.frame_id,
            decoded(image.data, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION, place)};
  }
  const auto image = ros::mcap::decode<Image>(message);
  const Encoding& encoding = encoding_of(image, kColors, place);
  const cv::Mat pixels = pixels_of(image, encoding.type, place);
  Picture picture{nanoseconds(image.header.stamp), image.header.frame_id, {}};
  if (encoding.to_bgr < 0) {
    picture.pixels = pixels.clone();
  } else {
    cv::cvtColor(pixels, picture.pixels, encoding.to_bgr);
  }
  return picture;
}

/// Counts of kCountsPerMetre; 0 where nothing was measured or the count does not fit (65535
/// means none, too).
cv::Mat depth_counts(const cv::Mat& depth) {
  cv::Mat counts(depth.size(), CV_16UC1);
  const bool millimetres = depth.type() == CV_16UC1;
  for (int y = 0; y < depth.rows; ++y) {
    auto* to = counts.ptr<std::uint16_t>(y);
    for (int x = 0; x < depth.cols; ++x) {
      const double depth_m = millimetres ? 1e-3 * depth.at<std::uint16_t>(y, x)
                                         : static_cast<double>(depth.at<float>(y, x));
      const double count = std::round(depth_m * kCountsPerMetre);
      const bool fits = count > 0.0 && count < std::numeric_limits<std::uint16_t>::max();
      to[x] = fits ? static_cast<std::uint16_t>(count) : std::uint16_t{0};
    }
  }
  return counts;
}

Picture depth_of(const StoredMessage& message) {
  const std::string place = message.place();
  if (!is_compressed(message)) {
    const auto image = ros::mcap::decode<Image>(message);
    const Encoding& encoding = encoding_of(image, kDepths, place);
    return {nanoseconds(image.header.stamp), image.header.frame_id,
            depth_counts(pixels_of(image, encoding.type, place))};
  }
  const auto image = ros::mcap::decode<CompressedImage>(message);
  // compressed_depth_image_transport: 12 bytes that only inverse depth needs, then the PNG.
  constexpr std::size_t kHeadBytes = 12;
  const bool with_head = image.format.find("compressedDepth") != std::string::npos;
  std::span<const std::uint8_t> bytes = image.data;
  bytes = bytes.subspan(with_head ? std::min(kHeadBytes, bytes.size()) : 0);
  const bool is_float = image.format.starts_with("32FC1");
  const cv::Mat pixels = decoded(bytes, cv::IMREAD_UNCHANGED, place);
  if (is_float || pixels.type() != CV_16UC1) {
    throw InputError::expected(place, "16UC1 depth in a PNG", image.format);
  }
  return {nanoseconds(image.header.stamp), image.header.frame_id, depth_counts(pixels)};
}

/// Seconds, with zeros in front: names sort by time, and numbers keep their nanoseconds.
std::string name_of(std::int64_t time_ns) {
  return core::print("%010lld.%09lld", static_cast<long long>(time_ns / core::kNsPerSecond),
                     static_cast<long long>(time_ns % core::kNsPerSecond));
}

/// The lists come last: without them the folder is none of the layout.
void write_picture(const fs::path& file, const cv::Mat& pixels) {
  // The least that PNG can: the files are read once or twice.
  if (!cv::imwrite(file.string(), pixels, {cv::IMWRITE_PNG_COMPRESSION, 1})) {
    throw InputError::expected(file.string(), "a place where pictures can be written", "none");
  }
}

class Unpacking {
 public:
  Unpacking(const fs::path& bag, fs::path folder, const UnpackOptions& options)
      : bag_file_(bag), bag_(bag.string()), folder_(std::move(folder)), options_(options) {}

  UnpackSummary run() {
    check_topics();
    read_camera();
    read_transforms();
    write_images();
    write_lists();
    summary_.truncation = bag_file_.truncation();
    return summary_;
  }

 private:
  void check_topic(const std::string& topic, const std::string& type, bool or_compressed) {
    std::string others;
    for (const ros::mcap::Channel* channel : bag_file_.channels()) {
      const std::string& name = channel->schema.name;
      const bool fits =
          name.ends_with("/" + type) || (or_compressed && name.ends_with("/CompressedImage"));
      if (fits && channel->topic == topic) return;
      if (fits) others += (others.empty() ? "" : ", ") + channel->topic;
    }
    throw InputError::expected(bag_, "the topic " + topic + " (" + type + ")",
                               others.empty() ? "none of that type" : others);
  }
  void check_topics() {
    check_topic(options_.color_topic, "Image", true);
    check_topic(options_.depth_topic, "Image", true);
    check_topic(options_.info_topic, "CameraInfo", false);
  }

  void read(const std::vector<std::string>& topics,
            const std::function<void(const StoredMessage&)>& receive) {
    bag_file_.read(receive, topics);
  }

  void read_camera() {
    read({options_.info_topic}, [&](const StoredMessage& message) {
      const auto info = ros::mcap::decode<CameraInfo>(message);
      if (!info_) info_ = info;
      if (info.k != info_->k || info.d != info_->d) {
        throw InputError::expected(message.place(), "one camera for all images", "another");
      }
    });
    const auto found = [&](const std::string& what) {
      return InputError::expected(bag_ + ": " + options_.info_topic,
                                  "a camera with distortion plumb_bob or none", what);
    };
    if (!info_) throw found("no message");
    const std::vector<double>& d = info_->d;
    const bool bends = std::any_of(d.begin(), d.end(), [](double k) { return k != 0.0; });
    if (bends && (info_->distortion_model != "plumb_bob" || d.size() > 5)) {
      throw found(info_->distortion_model);
    }
    if (!(info_->k[0] > 0.0) || !(info_->k[4] > 0.0))
      throw found("one that is not calibrated");
    info_->d.resize(5, 0.0);
  }

  void read_transforms() {
    read({"/tf", "/tf_static"}, [&](const StoredMessage& message) {
      const bool is_static = message.channel->topic == "/tf_static";
      const auto tf = ros::mcap::decode<ros::tf2_msgs::TFMessage>(message);
      for (const auto& transform : tf.transforms) {
        tree_.add(transform, is_static, message.place());
      }
    });
  }

  void choose_frames(const std::string& camera_frame) {
    summary_.camera_frame = camera_frame;
    const std::vector<std::string> chain = tree_.ancestors(camera_frame);
    const auto has = [&](const std::string& frame) {
      return std::find(chain.begin(), chain.end(), frame) != chain.end();
    };
    summary_.fixed_frame = options_.fixed_frame;
    for (const char* usual : {"map", "odom"}) {
      if (summary_.fixed_frame.empty() && has(usual)) summary_.fixed_frame = usual;
    }
    if (summary_.fixed_frame.empty()) summary_.fixed_frame = chain.back();
    if (has(summary_.fixed_frame) && chain.size() > 1) return;
    std::string found;
    for (const std::string& frame : chain) found += (found.empty() ? "" : " in ") + frame;
    throw InputError::expected(bag_,
                               "transforms from " + summary_.fixed_frame + " to " +
                                   camera_frame + ", where images were taken",
                               found);
  }

  void write_images() {
    fs::create_directories(folder_ / "rgb");
    fs::create_directories(folder_ / "depth");
    read({options_.color_topic, options_.depth_topic}, [&](const StoredMessage& message) {
      const bool is_color = message.channel->topic == options_.color_topic;
      const Picture picture = is_color ? color_of(message) : depth_of(message);
      const std::string frame =
          picture.frame.starts_with('/') ? picture.frame.substr(1) : picture.frame;
      if (summary_.camera_frame.empty()) choose_frames(frame);
      if (frame != summary_.camera_frame) {
        throw InputError::expected(
            message.place(),
            "colour and depth of one view (frame " + summary_.camera_frame + ")",
            "frame " + frame);
      }
      const std::string name = name_of(picture.time_ns);
      if (is_color) {
        write_color(picture, name);
      } else {
        write_picture(folder_ / "depth" / (name + ".png"), picture.pixels);
        depths_ += name + " depth/" + name + ".png\n";
        ++summary_.depth_images;
      }
    });
    if (summary_.color_images > 0) return;
    throw InputError::expected(bag_,
                               "images whose pose in " + summary_.fixed_frame + " is known",
                               std::to_string(summary_.without_pose) + " without");
  }

  void write_color(const Picture& picture, const std::string& name) {
    const auto T_fixed_camera =
        tree_.find(summary_.fixed_frame, summary_.camera_frame, picture.time_ns);
    if (!T_fixed_camera) {
      ++summary_.without_pose;
      return;
    }
    write_picture(folder_ / "rgb" / (name + ".png"), picture.pixels);
    colors_ += name + " rgb/" + name + ".png\n";
    const glm::dvec3& p_m = T_fixed_camera->p_m;
    const glm::dquat& R = T_fixed_camera->rotation;
    poses_ += core::print("%s %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n", name.c_str(), p_m.x,
                          p_m.y, p_m.z, R.x, R.y, R.z, R.w);
    ++summary_.color_images;
  }

  void write_lists() const {
    const auto write = [&](const char* name, const std::string& text) {
      core::write_file_atomically(folder_ / name, [&](std::ostream& out) { out << text; });
    };
    write("rgb.txt", colors_);
    write("depth.txt", depths_);
    write("groundtruth.txt", poses_);
    std::string numbers =
        core::print("%.9g %.9g %.9g %.9g", info_->k[0], info_->k[4], info_->k[2], info_->k[5]);
    for (const double k : info_->d) numbers += core::print(" %.9g", k);
    write("intrinsics.txt", numbers + "\n");
  }

  BagFile bag_file_;
  std::string bag_;
  fs::path folder_;
  const UnpackOptions& options_;
  std::optional<CameraInfo> info_;
  TransformTree tree_;
  std::string colors_, depths_, poses_;  ///< Of the lists.
  UnpackSummary summary_;
};

}  // namespace

UnpackSummary unpack_recording(const fs::path& bag, const fs::path& folder,
                               const UnpackOptions& options) {
  if (fs::exists(folder) && !fs::exists(folder / kMark)) {
    throw InputError::expected(folder.string(), "no folder, or one that was unpacked",
                               "another");
  }
  fs::remove_all(folder);
  core::write_file_atomically(folder / kMark,
                              [&](std::ostream& out) { out << bag.string() << "\n"; });
  return Unpacking(bag, folder, options).run();
}

}  // namespace segsim::experiments::bags
