#include "core/stages.h"

namespace segsim::core {

const char* to_string(PolicyMode mode) {
  switch (mode) {
    case PolicyMode::kInitialize:
      return "initialize";
    case PolicyMode::kExplore:
      return "explore";
    case PolicyMode::kNavigate:
      return "navigate";
    case PolicyMode::kRecover:
      return "recover";
    case PolicyMode::kStop:
      return "stop";
  }
  return "unknown";
}

}  // namespace segsim::core
