// 3-D boxes drawn by hand (reconstruction/datasets/box_annotation.h).
#include "reconstruction/datasets/box_annotation.h"

#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const reconstruction::BoxAnnotation annotation =
      reconstruction::read_box_annotation(in_file(bytes, "boxes.json"));
  for (const reconstruction::AnnotatedBox& box : annotation.boxes) {
    (void)box.box.world_min_m();
    (void)box.box.contains({1.0, 2.0, 0.5});
  }
}

std::vector<std::string> seeds() {
  return {R"({"objects":[{"id":1,"class":"chair","center":[1,2,0.5],"size":[0.5,0.5,1],
"yaw_rad":0.3,"core":true,"note":"by hand","parts":[{"center":[1,2,0.2],"size":[0.4,0.4,0.4],
"yaw_rad":0}]},{"id":2,"class":"couch","center":[3,2,0.5],"size":[2,1,1],"yaw_rad":0}],
"planes":{"list":[{"id":9,"class":"floor","center":[2,2,-0.05],"size":[4,4,0.1],
"yaw_rad":0}]}})"};
}

}  // namespace segsim::fuzz
