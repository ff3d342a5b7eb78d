// Data sets and results in COCO's format (perception/data/dataset.h,
// perception/evaluation/coco_evaluation.h).
#include "perception/data/dataset.h"
#include "perception/evaluation/coco_evaluation.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {

void parse(const std::string& bytes) {
  const std::vector<std::string> parts = split_parts(bytes, 2);
  const std::filesystem::path truth = in_file(parts[0], "instances.json");
  const perception::CocoDataset dataset = perception::read_coco(truth);
  (void)perception::views_near(dataset, "flat", {{1.0, 1.0}}, 0.5);
  (void)perception::read_coco_results(truth, in_file(parts[1], "results.json"));
}

std::vector<std::string> seeds() {
  return {join_parts(
      {R"({"images":[{"id":1,"file_name":"a.png","width":64,"height":48,"scene":"flat",
"view":[1,2,0.5]}],"annotations":[{"id":1,"image_id":1,"category_id":2,"bbox":[1,2,10,12],
"area":120,"iscrowd":0,"visible_fraction":0.5,"ignore":0,"truncated":1,"occluded":0,
"distance_m":2.5,"instance_id":3}],"categories":[{"id":2,"name":"chair"}],
"segsim_scenes":[{"name":"flat","surfels_sha256":")" +
           std::string(64, 'a') + R"("}]})",
       R"([{"image_id":1,"category_id":2,"bbox":[1,2,10,12],"score":0.9}])"})};
}

}  // namespace segsim::fuzz
