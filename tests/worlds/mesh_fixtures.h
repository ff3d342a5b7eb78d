#pragma once

/// @file
/// Small scenes and files for the tests of mesh import, rendering and capture.

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <glm/geometric.hpp>

#include "sim/ground/mesh_scene.h"
#include "tests/temporary_folder.h"

namespace segsim::worlds {

using tests::TemporaryFolder;

/// 2 x 2 pixels: red, green / blue, white.
inline void write_png_2x2(const std::filesystem::path& file) {
  static constexpr unsigned char kBytes[] = {
      0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49,
      0x48, 0x44, 0x52, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x02, 0x08, 0x02,
      0x00, 0x00, 0x00, 0xfd, 0xd4, 0x9a, 0x73, 0x00, 0x00, 0x00, 0x12, 0x49, 0x44,
      0x41, 0x54, 0x78, 0x9c, 0x63, 0xf8, 0xcf, 0xc0, 0xc0, 0x00, 0xc2, 0x0c, 0xff,
      0x81, 0x00, 0x00, 0x1f, 0xee, 0x05, 0xfb, 0x0b, 0xd9, 0x68, 0x8b, 0x00, 0x00,
      0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(kBytes), sizeof kBytes);
}

/// A COLLADA file with one triangle (0,0,0), (100,0,0), (0,100,0), declared y-up, under one
/// node.
inline std::string collada_triangle(const std::string& metres_per_unit,
                                    const std::string& node_matrix) {
  return R"(<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter=")" +
         metres_per_unit + R"("/><up_axis>Y_UP</up_axis></asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="9">0 0 0 100 0 0 0 100 0</float_array>
<technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="Chair_1" name="Chair_1"><matrix>)" +
         node_matrix + R"(</matrix><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>)";
}

/// Adds a rectangle that faces along edge_u x edge_v.
inline void add_rectangle(sim::MeshScene& scene, const glm::vec3& corner,
                          const glm::vec3& edge_u, const glm::vec3& edge_v, int material,
                          std::uint16_t class_id, std::uint16_t instance_id) {
  sim::SubMesh mesh;
  mesh.positions_m = {corner, corner + edge_u, corner + edge_u + edge_v, corner + edge_v};
  mesh.normals.assign(4, glm::normalize(glm::cross(edge_u, edge_v)));
  mesh.uvs = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  mesh.material = material;
  mesh.class_id = class_id;
  mesh.instance_id = instance_id;
  scene.meshes.push_back(mesh);
}

/// A room of 4 m x 4 m x 2.5 m around the origin, seen from inside, with one lamp and a red
/// chair, a cube of 0.5 m at (1, 0, 0.25). Classes: wall 1, floor 2, ceiling 3, chair 4
/// (instance 1).
inline sim::MeshScene box_room() {
  sim::MeshScene scene;
  scene.name = "box room";
  scene.source = "test";
  scene.materials = {{glm::vec3(0.8F), -1, {}}, {glm::vec3(0.7F, 0.1F, 0.1F), -1, {}}};
  scene.classes = {
      {1, "wall", false}, {2, "floor", false}, {3, "ceiling", false}, {4, "chair", true}};
  scene.instances.resize(1);
  scene.instances[0].id = 1;
  scene.instances[0].class_id = 4;
  scene.instances[0].name = "chair \"one\"";
  add_rectangle(scene, {-2, -2, 0}, {4, 0, 0}, {0, 4, 0}, 0, 2, 0);
  add_rectangle(scene, {-2, -2, 2.5}, {0, 4, 0}, {4, 0, 0}, 0, 3, 0);
  add_rectangle(scene, {-2, -2, 0}, {0, 4, 0}, {0, 0, 2.5}, 0, 1, 0);
  add_rectangle(scene, {2, -2, 0}, {0, 0, 2.5}, {0, 4, 0}, 0, 1, 0);
  add_rectangle(scene, {-2, -2, 0}, {0, 0, 2.5}, {4, 0, 0}, 0, 1, 0);
  add_rectangle(scene, {-2, 2, 0}, {4, 0, 0}, {0, 0, 2.5}, 0, 1, 0);
  const glm::vec3 low(0.75F, -0.25F, 0.0F);
  const glm::vec3 x(0.5F, 0, 0);
  const glm::vec3 y(0, 0.5F, 0);
  const glm::vec3 z(0, 0, 0.5F);
  add_rectangle(scene, low + z, x, y, 1, 4, 1);
  add_rectangle(scene, low, z, y, 1, 4, 1);
  add_rectangle(scene, low + x, y, z, 1, 4, 1);
  add_rectangle(scene, low, x, z, 1, 4, 1);
  add_rectangle(scene, low + y, z, x, 1, 4, 1);
  scene.lights.push_back({{-0.5F, 0.3F, 2.2F}, glm::vec3(3.0F), 0.1F});
  return scene;
}

}  // namespace segsim::worlds
