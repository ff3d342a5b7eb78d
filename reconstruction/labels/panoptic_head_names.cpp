// Apart from what makes heads: who reads a spec needs no libtorch.
#include "reconstruction/labels/panoptic_head.h"

namespace segsim::reconstruction {

std::vector<std::string> panoptic_head_names() {
  return {"query",
          "panoptic-splatting",
          "panoptic-lifting",
          "contrastive-lift",
          "gaussian-grouping",
          "open-gaussian",
          "panoptic-recon",
          "panoptic-recon++",
          "pvlff"};
}

std::vector<std::string> joint_head_names() {
  return {"query", "panoptic-splatting", "panoptic-recon++"};
}

std::string panoptic_head_list(const std::string& between) {
  std::string list;
  for (const std::string& name : panoptic_head_names()) {
    list += (list.empty() ? "" : between) + name;
  }
  return list;
}

}  // namespace segsim::reconstruction
