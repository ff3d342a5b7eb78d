#include "perception/detector/library_versions.h"

#include <torch/version.h>
#include <opencv2/core/version.hpp>

namespace segsim::perception {

std::map<std::string, std::string> library_versions() {
  return {{"libtorch", TORCH_VERSION}, {"OpenCV", CV_VERSION}};
}

}  // namespace segsim::perception
