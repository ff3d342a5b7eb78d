// nerfstudio's transforms.json (reconstruction/datasets/nerfstudio.cpp).
#include <opencv2/imgcodecs.hpp>

#include "reconstruction/datasets/rgbd_sequence.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

void write_pictures() {
  std::filesystem::create_directories(work_folder() / "recording");
  for (const char* name : {"a.png", "b.png"}) {
    cv::imwrite((work_folder() / "recording" / name).string(),
                cv::Mat(12, 16, CV_8UC3, cv::Scalar(1, 2, 3)));
  }
  cv::imwrite((work_folder() / "recording/d.png").string(),
              cv::Mat(12, 16, CV_16UC1, cv::Scalar(1500)));
}

}  // namespace

void parse(const std::string& bytes) {
  static const bool made = (write_pictures(), true);
  (void)made;
  (void)in_file(bytes, "recording/transforms.json");
  reconstruction::SequenceOptions options;
  options.layout = reconstruction::SequenceLayout::kNerfstudio;
  const auto sequence = reconstruction::open_sequence(work_folder() / "recording", options);
  for (std::size_t i = 0; i < sequence->frame_count(); ++i) (void)sequence->load(i);
}

std::vector<std::string> seeds() {
  return {
      R"({"w":16,"h":12,"fl_x":20,"fl_y":20,"cx":8,"cy":6,"k1":0.01,"camera_model":"OPENCV",
"frames":[{"file_path":"a.png","depth_file_path":"d.png",
"transform_matrix":[[1,0,0,1],[0,0,-1,2],[0,1,0,1.5],[0,0,0,1]]},
{"file_path":"b.png","depth_file_path":"d.png",
"transform_matrix":[[1,0,0,1.2],[0,0,-1,2],[0,1,0,1.5],[0,0,0,1]]}]})"};
}

}  // namespace segsim::fuzz
