// Per-view masks in the segsim layout (reconstruction/datasets/mask_files.h): masks.yaml and
// the list of a view's masks; its pictures stay whole.
#include "core/file_io.h"
#include "reconstruction/datasets/mask_files.h"
#include "tests/fuzz/fuzz_target.h"

namespace segsim::fuzz {
namespace {

constexpr const char* kView = "frame-000001";

const std::vector<core::SceneClass>& classes() {
  static const std::vector<core::SceneClass> all{{1, "chair", true}, {2, "wall", false}};
  return all;
}

void write_whole_set() {
  core::FrameMasks masks;
  masks.semantic = core::Image<std::uint16_t>(4, 3, 2);
  masks.instance = core::Image<std::uint16_t>(4, 3, 0);
  masks.confidence = core::Image<std::uint8_t>(4, 3, 200);
  masks.semantic(1, 1) = 1;
  masks.instance(1, 1) = 5;
  masks.segments = core::segments_of(masks);
  reconstruction::write_masks(work_folder(), kView, masks, classes());
  reconstruction::MaskSetInfo info;
  info.source = "simulated";
  info.classes = classes();
  info.prompts = {"chair"};
  info.settings = {{"rate", 0.5}};
  reconstruction::write_mask_set_info(work_folder(), info);
}

std::string list_name() { return std::string(kView) + ".json"; }

}  // namespace

void parse(const std::string& bytes) {
  static const bool made = (write_whole_set(), true);
  (void)made;
  const std::vector<std::string> parts = split_parts(bytes, 2);
  (void)in_file(parts[0], "masks.yaml");
  (void)in_file(parts[1], list_name());
  const auto set = reconstruction::open_masks(work_folder(), classes());
  for (const std::string& name : set->names()) (void)set->read(name, 4, 3);
}

std::vector<std::string> seeds() {
  write_whole_set();
  return {join_parts({core::read_file(work_folder() / "masks.yaml"),
                      core::read_file(work_folder() / list_name())})};
}

}  // namespace segsim::fuzz
