#include "worlds/mesh/library_versions.h"

#include <GeographicLib/Config.h>
#include <embree3/rtcore_config.h>

namespace segsim::worlds {

std::map<std::string, std::string> library_versions() {
  return {{"Embree", RTC_VERSION_STRING}, {"GeographicLib", GEOGRAPHICLIB_VERSION_STRING}};
}

}  // namespace segsim::worlds
