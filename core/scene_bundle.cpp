#include "core/scene_bundle.h"

#include <cmath>
#include <cstdio>
#include <limits>
#include <set>
#include <utility>

#include <yaml-cpp/yaml.h>

#include "core/bundle_parts.h"
#include "core/check.h"
#include "core/config.h"
#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/input/bounds.h"

namespace segsim::core {
namespace {

/// A figure that a reconstruction left in its bundle; NaN where `.nan` stands for what could
/// not be measured, such as the height of a floor that was not found.
double measured_number(const ConfigNode& figures, const std::string& key) {
  const ConfigNode figure = figures.child(key);
  if (figure.as_text() == ".nan") return std::numeric_limits<double>::quiet_NaN();
  return figure.as_number();
}

namespace fs = std::filesystem;

constexpr const char* kSchema = "segsim.scene";

glm::dvec3 read_vec3(const ConfigNode& node, const std::string& key) {
  const std::vector<double> v = node.numbers(key);
  if (v.size() != 3) node.child(key).fail("3 numbers", std::to_string(v.size()));
  const glm::dvec3 value(v[0], v[1], v[2]);
  if (!within_world(value)) {
    node.child(key).fail(print("numbers within %g", kFarthest_m),
                         print("(%g, %g, %g)", value.x, value.y, value.z));
  }
  return value;
}

std::uint16_t read_id(const ConfigNode& node, const std::string& key) {
  const std::int64_t id = node.integer(key);
  if (id < 0 || id > 65535) node.child(key).fail("an id in [0, 65535]", std::to_string(id));
  return static_cast<std::uint16_t>(id);
}

BundleFile read_file_entry(const ConfigNode& files, const std::string& key,
                           const fs::path& folder) {
  const ConfigNode node = files.child(key);
  BundleFile file{node.text("name"), node.text("sha256")};
  node.finish();
  const fs::path path = folder / file.name;
  if (!fs::exists(path)) throw InputError::expected(path.string(), "a bundle file", "none");
  const std::string found = sha256_of_file(path);
  if (found != file.sha256) {
    throw InputError::expected(path.string(), "SHA-256 " + file.sha256, found);
  }
  return file;
}

int read_version(const ConfigNode& root) {
  const std::int64_t version = root.integer("version");
  if (version < 1 || version > kEditedLabelsVersion) {
    root.child("version").fail(
        "version 1 to " + std::to_string(kEditedLabelsVersion) +
            (version < 1 ? "" : " (a newer bundle needs a newer program)"),
        std::to_string(version));
  }
  return static_cast<int>(version);
}

SceneLevelling read_levelling(const ConfigNode& node) {
  SceneLevelling levelling;
  const std::vector<double> q = node.numbers("R_world_source_wxyz");
  if (q.size() != 4) {
    node.child("R_world_source_wxyz").fail("4 numbers", std::to_string(q.size()));
  }
  levelling.R_world_source = {q[0], q[1], q[2], q[3]};
  if (!(std::abs(glm::length(levelling.R_world_source) - 1.0) < 1e-6)) {
    node.child("R_world_source_wxyz").fail("a unit quaternion", "another length");
  }
  levelling.p_world_source_m = read_vec3(node, "p_world_source_m");
  node.finish();
  return levelling;
}

RenderingOnly read_rendering_only(const ConfigNode& node) {
  RenderingOnly only;
  only.reason = node.text("reason");
  only.robot = node.text("robot");
  if (const std::optional<ConfigNode> disc = node.optional_child("free_disc")) {
    const std::vector<double> center_m = disc->numbers("center_m");
    if (center_m.size() != 2) {
      disc->child("center_m").fail("2 numbers", std::to_string(center_m.size()));
    }
    only.free_disc = FreeDisc{{center_m[0], center_m[1]}, disc->number("radius_m")};
    disc->finish();
  }
  only.fitting = node.texts("robots_that_fit");
  node.finish();
  return only;
}

BundleParts read_parts(const ConfigNode& root, const fs::path& folder) {
  BundleParts parts;
  parts.version = read_version(root);
  if (parts.version < 2) return parts;
  parts.levelling = read_levelling(root.child("levelling"));
  parts.mesh_source = root.text("mesh_source");
  if (root.has("label_distributions")) {
    parts.labels = read_file_entry(root, "label_distributions", folder);
  }
  if (root.has("cameras")) parts.cameras = read_file_entry(root, "cameras", folder);
  const bool edited = parts.version >= kEditedLabelsVersion;
  if (edited) parts.label_edits = read_file_entry(root, "label_edits", folder);
  if (parts.version == kRenderingOnlyVersion || (edited && root.has("rendering_only"))) {
    parts.rendering_only = read_rendering_only(root.child("rendering_only"));
  }
  return parts;
}

ConfigNode open_manifest(const fs::path& folder) {
  const fs::path file = folder / "scene.yaml";
  if (!fs::exists(file)) {
    throw InputError::expected(folder.string(), "a scene bundle with scene.yaml", "none");
  }
  ConfigNode root = ConfigNode::load(file);
  if (root.text("schema") != kSchema) root.child("schema").fail(kSchema, root.text("schema"));
  return root;
}

YAML::Emitter& emit_vec3(YAML::Emitter& out, const glm::dvec3& v) {
  return out << YAML::Flow << YAML::BeginSeq << v.x << v.y << v.z << YAML::EndSeq;
}

void emit_file(YAML::Emitter& out, const char* key, const BundleFile& file) {
  out << YAML::Key << key << YAML::Value << YAML::BeginMap << YAML::Key << "name"
      << YAML::Value << file.name << YAML::Key << "sha256" << YAML::Value << file.sha256
      << YAML::EndMap;
}

void emit_rendering_only(YAML::Emitter& out, const RenderingOnly& only) {
  out << YAML::Key << "rendering_only" << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "reason" << YAML::Value << only.reason;
  out << YAML::Key << "robot" << YAML::Value << only.robot;
  if (only.free_disc) {
    const FreeDisc& disc = *only.free_disc;
    out << YAML::Key << "free_disc" << YAML::Value << YAML::BeginMap;
    out << YAML::Key << "center_m" << YAML::Value << YAML::Flow << YAML::BeginSeq
        << disc.center_m.x << disc.center_m.y << YAML::EndSeq;
    out << YAML::Key << "radius_m" << YAML::Value << disc.radius_m << YAML::EndMap;
  }
  out << YAML::Key << "robots_that_fit" << YAML::Value << YAML::Flow << only.fitting
      << YAML::EndMap;
}

}  // namespace

std::string RenderingOnly::text() const {
  if (!free_disc) return reason + "; no free disc on a floor";
  char disc[96];
  std::snprintf(disc, sizeof disc, "largest free disc: radius %.2f m at (%.2f, %.2f) m",
                free_disc->radius_m, free_disc->center_m.x, free_disc->center_m.y);
  std::string robots;
  for (const std::string& name : fitting) robots += (robots.empty() ? "" : ", ") + name;
  return reason + "; " + disc + "; robots that fit: " + (robots.empty() ? "none" : robots);
}

const SceneClass* SceneManifest::find_class(const std::string& class_name) const {
  for (const SceneClass& c : classes) {
    if (c.name == class_name) return &c;
  }
  return nullptr;
}

const SceneClass* SceneManifest::find_class(std::uint16_t class_id) const {
  for (const SceneClass& c : classes) {
    if (c.id == class_id) return &c;
  }
  return nullptr;
}

const SceneInstance* SceneManifest::find_instance(std::uint16_t instance_id) const {
  for (const SceneInstance& i : instances) {
    if (i.id == instance_id) return &i;
  }
  return nullptr;
}

std::string SceneManifest::class_name(std::uint16_t class_id) const {
  const SceneClass* found = find_class(class_id);
  return found == nullptr ? "void" : found->name;
}

SceneBundle load_bundle(const fs::path& folder) {
  const ConfigNode root = open_manifest(folder);
  const bool drivable = !read_parts(root, folder).rendering_only;
  SceneBundle bundle{
      .folder = folder, .manifest = {}, .scene_sha256 = sha256_of_file(folder / "scene.yaml")};
  SceneManifest& m = bundle.manifest;
  m.name = root.text("name");

  const ConfigNode world = root.child("world");
  if (world.text("up") != "z") world.child("up").fail("z", world.text("up"));
  if (world.text("unit") != "m") world.child("unit").fail("m", world.text("unit"));
  const glm::dvec3 gravity = read_vec3(world, "gravity_mps2");
  if (gravity.x != 0.0 || gravity.y != 0.0 || gravity.z >= 0.0) {
    world.child("gravity_mps2").fail("gravity along -z", "another direction");
  }
  world.finish();

  const ConfigNode origin = root.child("geodetic_origin");
  m.origin = {origin.number("latitude_deg"), origin.number("longitude_deg"),
              origin.number("height_m"), origin.number("yaw_rad")};
  if (std::abs(m.origin.latitude_deg) > 90.0) {
    origin.child("latitude_deg").fail("a latitude in [-90, 90]", origin.text("latitude_deg"));
  }
  origin.finish();

  const ConfigNode robot = root.child("robot");
  m.robot_radius_m = robot.number("radius_m");
  m.robot_height_m = robot.number("height_m");
  m.camera_height_m = robot.number("camera_height_m");
  robot.finish();

  const ConfigNode provenance = root.child("provenance");
  m.created_by = provenance.text("created_by");
  m.source = provenance.text("source");
  m.source_sha256 = provenance.text_or("source_sha256", "");
  provenance.finish();

  const ConfigNode statistics = root.child("statistics");
  for (const std::string& key : statistics.keys()) {
    m.statistics.emplace_back(key, measured_number(statistics, key));
  }

  std::set<std::uint16_t> class_ids, instance_ids;
  for (const ConfigNode& node : root.list("classes")) {
    m.classes.push_back(
        {read_id(node, "id"), node.text("name"), node.boolean_or("thing", false)});
    if (!class_ids.insert(m.classes.back().id).second || m.classes.back().id == 0) {
      node.fail("a new class id > 0", std::to_string(m.classes.back().id));
    }
    node.finish();
  }
  for (const ConfigNode& node : root.list("instances")) {
    SceneInstance instance;
    instance.id = read_id(node, "id");
    instance.class_id = read_id(node, "class");
    instance.name = node.text("name");
    instance.box_min_m = read_vec3(node, "box_min_m");
    instance.box_max_m = read_vec3(node, "box_max_m");
    node.finish();
    if (!class_ids.contains(instance.class_id)) {
      node.fail("a listed class", std::to_string(instance.class_id));
    }
    for (int axis = 0; axis < 3; ++axis) {
      if (instance.box_min_m[axis] <= instance.box_max_m[axis]) continue;
      node.fail("box_min_m up to box_max_m",
                print("%g and %g", instance.box_min_m[axis], instance.box_max_m[axis]));
    }
    if (instance.id == 0 || !instance_ids.insert(instance.id).second) {
      node.fail("a new instance id > 0", std::to_string(instance.id));
    }
    m.instances.push_back(std::move(instance));
  }

  const ConfigNode files = root.child("files");
  m.surfels = read_file_entry(files, "surfels", folder);
  if (drivable || files.has("collision_mesh")) {
    m.collision_mesh = read_file_entry(files, "collision_mesh", folder);
  }
  if (drivable) m.navmesh = read_file_entry(files, "navmesh", folder);
  files.finish();
  root.finish();
  return bundle;
}

BundleParts load_bundle_parts(const fs::path& folder) {
  return read_parts(open_manifest(folder), folder);
}

void require_drivable(const SceneBundle& bundle) {
  if (!bundle.manifest.navmesh.name.empty()) return;
  const RenderingOnly why =
      read_rendering_only(open_manifest(bundle.folder).child("rendering_only"));
  const char* advice = bundle.manifest.collision_mesh.name.empty()
                           ? "`segsim scene remesh --floor-height` takes another floor"
                           : "`segsim scene navmesh` tries another robot";
  throw InputError::expected(
      bundle.folder.string(), "a scene to drive in",
      "one for rendering and labels only (" + why.text() + "); " + advice);
}

void write_bundle_manifest(const fs::path& folder, SceneManifest m) {
  write_bundle_manifest(folder, std::move(m), BundleParts{});
}

void write_bundle_manifest(const fs::path& folder, SceneManifest m, BundleParts parts) {
  SEGSIM_CHECK(parts.rendering_only.has_value() == m.navmesh.name.empty(),
               "navmesh or reason");
  for (BundleFile* file : {&m.surfels, &m.collision_mesh, &m.navmesh, &parts.labels,
                           &parts.cameras, &parts.label_edits}) {
    if (!file->name.empty()) file->sha256 = sha256_of_file(folder / file->name);
  }

  YAML::Emitter out;
  out.SetDoublePrecision(12);
  out << YAML::BeginMap;
  out << YAML::Key << "schema" << YAML::Value << kSchema;
  out << YAML::Key << "version" << YAML::Value
      << (!parts.label_edits.name.empty() ? kEditedLabelsVersion
          : parts.rendering_only          ? kRenderingOnlyVersion
                                          : kBundleVersion);
  out << YAML::Key << "name" << YAML::Value << m.name;
  out << YAML::Key << "world" << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "up" << YAML::Value << "z" << YAML::Key << "unit" << YAML::Value << "m";
  out << YAML::Key << "gravity_mps2" << YAML::Value;
  emit_vec3(out, {0.0, 0.0, -9.80665}) << YAML::EndMap;
  const glm::dquat& R = parts.levelling.R_world_source;
  out << YAML::Key << "levelling" << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "R_world_source_wxyz" << YAML::Value << YAML::Flow << YAML::BeginSeq
      << R.w << R.x << R.y << R.z << YAML::EndSeq;
  out << YAML::Key << "p_world_source_m" << YAML::Value;
  emit_vec3(out, parts.levelling.p_world_source_m) << YAML::EndMap;
  out << YAML::Key << "mesh_source" << YAML::Value << parts.mesh_source;
  if (!parts.labels.name.empty()) emit_file(out, "label_distributions", parts.labels);
  if (!parts.cameras.name.empty()) emit_file(out, "cameras", parts.cameras);
  if (!parts.label_edits.name.empty()) emit_file(out, "label_edits", parts.label_edits);
  if (parts.rendering_only) emit_rendering_only(out, *parts.rendering_only);
  out << YAML::Key << "geodetic_origin" << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "latitude_deg" << YAML::Value << m.origin.latitude_deg;
  out << YAML::Key << "longitude_deg" << YAML::Value << m.origin.longitude_deg;
  out << YAML::Key << "height_m" << YAML::Value << m.origin.height_m;
  out << YAML::Key << "yaw_rad" << YAML::Value << m.origin.yaw_rad << YAML::EndMap;
  out << YAML::Key << "robot" << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "radius_m" << YAML::Value << m.robot_radius_m;
  out << YAML::Key << "height_m" << YAML::Value << m.robot_height_m;
  out << YAML::Key << "camera_height_m" << YAML::Value << m.camera_height_m << YAML::EndMap;
  out << YAML::Key << "provenance" << YAML::Value << YAML::BeginMap;
  out << YAML::Key << "created_by" << YAML::Value << m.created_by;
  out << YAML::Key << "source" << YAML::Value << m.source;
  out << YAML::Key << "source_sha256" << YAML::Value << m.source_sha256 << YAML::EndMap;
  out << YAML::Key << "statistics" << YAML::Value << YAML::BeginMap;
  for (const auto& [key, value] : m.statistics)
    out << YAML::Key << key << YAML::Value << value;
  out << YAML::EndMap;
  out << YAML::Key << "files" << YAML::Value << YAML::BeginMap;
  emit_file(out, "surfels", m.surfels);
  if (!m.collision_mesh.name.empty()) emit_file(out, "collision_mesh", m.collision_mesh);
  if (!m.navmesh.name.empty()) emit_file(out, "navmesh", m.navmesh);
  out << YAML::EndMap;
  out << YAML::Key << "classes" << YAML::Value << YAML::BeginSeq;
  for (const SceneClass& c : m.classes) {
    out << YAML::Flow << YAML::BeginMap << YAML::Key << "id" << YAML::Value << c.id
        << YAML::Key << "name" << YAML::Value << c.name << YAML::Key << "thing" << YAML::Value
        << c.thing << YAML::EndMap;
  }
  out << YAML::EndSeq << YAML::Key << "instances" << YAML::Value << YAML::BeginSeq;
  for (const SceneInstance& i : m.instances) {
    out << YAML::Flow << YAML::BeginMap << YAML::Key << "id" << YAML::Value << i.id
        << YAML::Key << "class" << YAML::Value << i.class_id << YAML::Key << "name"
        << YAML::Value << i.name << YAML::Key << "box_min_m" << YAML::Value;
    emit_vec3(out, i.box_min_m) << YAML::Key << "box_max_m" << YAML::Value;
    emit_vec3(out, i.box_max_m) << YAML::EndMap;
  }
  out << YAML::EndSeq << YAML::EndMap;
  write_file_atomically(folder / "scene.yaml",
                        [&](std::ostream& stream) { stream << out.c_str() << '\n'; });
}

}  // namespace segsim::core
