#pragma once

/// @file
/// Triangle meshes of simple solids, collected part by part into one object.
///
/// A part is given in part coordinates; set_frame() says where they lie in the object, build()
/// where the object lies in the world. Texture coordinates are metres on the surface divided
/// by Surface::tile_m, so that a pattern keeps its size on every part; "stretched" faces cover
/// [0, 1].

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include <glm/mat4x4.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "sim/ground/mesh_scene.h"

namespace segsim::worlds {

/// What a part is made of.
struct Surface {
  int material = 0;     ///< Into MeshScene::materials.
  float tile_m = 1.0F;  ///< Length that one repeat of the texture covers.
};

/// Object coordinates: metres, z up. All triangles run counter-clockwise seen from outside,
/// none is degenerate, all normals are unit.
class MeshBuilder {
 public:
  /// Material of the parts that follow.
  void set_surface(const Surface& surface);
  /// Pose of the parts that follow; rigid. The default is the identity.
  void set_frame(const glm::mat4& T_object_part) { T_object_part_ = T_object_part; }
  void reset_frame() { T_object_part_ = glm::mat4(1.0F); }

  /// Parallelogram; it faces along edge_u x edge_v. @param stretched  One repeat covers the
  /// face.
  void add_quad(const glm::vec3& origin_m, const glm::vec3& edge_u_m,
                const glm::vec3& edge_v_m, bool stretched = false);
  void add_box(const glm::vec3& center_m, const glm::vec3& size_m);
  /// Box with round edges. @param radius_m  Cut to half the shortest side.
  void add_rounded_box(const glm::vec3& center_m, const glm::vec3& size_m, float radius_m,
                       int segments = 2);
  /// Cylinder, cone (one radius 0) or frustum with flat caps.
  void add_cylinder(const glm::vec3& from_m, const glm::vec3& to_m, float radius_from_m,
                    float radius_to_m, int segments = 16);
  void add_ellipsoid(const glm::vec3& center_m, const glm::vec3& radii_m, int segments = 12);
  /// Body of revolution about the vertical through `base_m`.
  /// @param profile_m  (radius, height above base) from the bottom up; edges sharper than 40
  /// degrees
  ///     stay sharp. Closed only where the profile reaches radius 0.
  /// @param scale_xy  Makes it elliptic.
  void add_lathe(const glm::vec3& base_m, std::span<const glm::vec2> profile_m,
                 int segments = 20, const glm::vec2& scale_xy = glm::vec2(1.0F));
  /// Prism over an outline in the part's xy-plane, counter-clockwise and star-shaped about its
  /// mean.
  void add_prism(std::span<const glm::vec2> outline_m, float z_from_m, float z_to_m);
  /// A leaf: closed, a few millimetres thick, bent downwards along its length.
  /// @param direction  Unit, from the base along the leaf. @param bend  0 = straight, 1 = a
  /// quarter
  ///     turn downwards.
  void add_leaf(const glm::vec3& base_m, const glm::vec3& direction, float length_m,
                float width_m, float bend, int segments = 4);

  /// Triangles made elsewhere, with the material set before and their own texture
  /// coordinates; those too thin to have a side are left out.
  void add_mesh(const sim::SubMesh& mesh);

  [[nodiscard]] bool empty() const { return groups_.empty(); }
  /// Box of everything so far, object coordinates. @pre Not empty.
  [[nodiscard]] glm::vec3 min_m() const { return low_m_; }
  [[nodiscard]] glm::vec3 max_m() const { return high_m_; }
  [[nodiscard]] std::size_t triangle_count() const;

  /// One SubMesh per material, in the order of first use. @param T_world_object  Rigid.
  [[nodiscard]] std::vector<sim::SubMesh> build(const glm::mat4& T_world_object,
                                                std::uint16_t class_id,
                                                std::uint16_t instance_id) const;

 private:
  struct Vertex {
    glm::vec3 position_m, normal;
    glm::vec2 uv;
  };
  std::uint32_t add_vertex(const Vertex& part_vertex);
  void add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c);
  void add_cell(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d);
  sim::SubMesh& group() { return groups_[current_]; }

  std::vector<sim::SubMesh> groups_;  ///< Object coordinates.
  std::size_t current_ = 0;
  float tile_m_ = 1.0F;
  glm::mat4 T_object_part_{1.0F};
  /// Kept up to date: furniture is measured at every place that it is tried at.
  glm::vec3 low_m_{std::numeric_limits<float>::max()};
  glm::vec3 high_m_{std::numeric_limits<float>::lowest()};
};

/// Rigid pose: turned by `yaw_rad` about +z, then moved to `position_m`.
[[nodiscard]] glm::mat4 pose_matrix(const glm::vec3& position_m, float yaw_rad);
/// Rigid pose: turned by `angle_rad` about `axis` (unit), then moved to `position_m`.
[[nodiscard]] glm::mat4 turned_matrix(const glm::vec3& position_m, const glm::vec3& axis,
                                      float angle_rad);

}  // namespace segsim::worlds
