// Masks in COCO's panoptic format (reconstruction/datasets/coco_panoptic.h).
#include "reconstruction/datasets/coco_panoptic.h"

#include <opencv2/imgcodecs.hpp>

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

void write_picture() {
  const std::filesystem::path folder = work_folder() / "panoptic";
  std::filesystem::create_directories(folder);
  cv::imwrite((folder / "a.png").string(), cv::Mat(3, 4, CV_8UC3, cv::Scalar(0, 0, 7)));
}

}  // namespace

void parse(const std::string& bytes) {
  static const bool made = (write_picture(), true);
  (void)made;
  const std::filesystem::path file = in_file(bytes, "panoptic.json");
  for (const auto scope : {reconstruction::IdScope::kView, reconstruction::IdScope::kScene}) {
    const auto set = reconstruction::open_coco_panoptic(file, {}, scope);
    for (const std::string& name : set->names()) (void)set->read(name, 4, 3);
  }
}

std::vector<std::string> seeds() {
  return {R"({"images":[{"id":1,"file_name":"a.jpg","width":4,"height":3}],
"annotations":[{"image_id":1,"file_name":"a.png","segments_info":[{"id":7,"category_id":3,
"area":12,"bbox":[0,0,4,3],"iscrowd":0}]}],
"categories":[{"id":3,"name":"chair","isthing":1},{"id":5,"name":"wall","isthing":0}]})"};
}

}  // namespace segsim::fuzz
