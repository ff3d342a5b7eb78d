// Gazebo worlds (worlds/mesh/gazebo/gazebo_import.h).
#include <functional>

#include <tinyxml2.h>

#include "tests/fuzz/fuzz_target.h"
#include "worlds/mesh/gazebo/gazebo_import.h"

namespace segsim::fuzz {
namespace {

/// For each file libsdformat first reads its own schema, which takes a fifth of a second here,
/// and then gives the file to tinyxml2. What that refuses need not wait for the schema every
/// time.
bool is_left_out(const std::string& bytes) {
  tinyxml2::XMLDocument document;
  const bool is_xml = document.Parse(bytes.data(), bytes.size()) == tinyxml2::XML_SUCCESS;
  return !is_xml && std::hash<std::string>()(bytes) % 16 != 0;
}

}  // namespace

void parse(const std::string& bytes) {
  if (is_left_out(bytes)) return;
  worlds::GazeboImportOptions options;
  (void)worlds::load_gazebo_world(in_file(bytes, "input.world"), options,
                                  worlds::blank_textures());
}

std::vector<std::string> seeds() {
  return {R"(<?xml version="1.0"?>
<sdf version="1.6"><world name="w"><include><uri>model://sun</uri></include>
<model name="Chair_01"><static>true</static><pose>1 1 0.4 0 0 0.5</pose><link name="l">
<visual name="v"><geometry><box><size>0.5 0.5 0.8</size></box></geometry>
<material><ambient>1 0 0 1</ambient><diffuse>1 0 0 1</diffuse></material></visual>
<visual name="c"><geometry><cylinder><radius>0.1</radius><length>1</length></cylinder>
</geometry></visual><visual name="s"><geometry><sphere><radius>0.2</radius></sphere></geometry>
</visual></link></model>
<model name="floor"><static>true</static><link name="l"><visual name="v"><geometry><plane>
<normal>0 0 1</normal><size>6 6</size></plane></geometry></visual></link></model>
<state world_name="w"><model name="Chair_01"><pose>2 1 0 0 0 0</pose></model></state>
</world></sdf>
)"};
}

}  // namespace segsim::fuzz
