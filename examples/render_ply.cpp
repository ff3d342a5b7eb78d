// Renders a surfel scene from a PLY file: the shortest program that makes a picture.
//
//     render_ply [SCENE.ply]
//
// SCENE.ply is any file in the layout of the 2DGS code, for example surfels.ply of a scene
// bundle. Without one the program writes a furnished room to room.ply and renders that. It
// writes two files into the current folder: view.ppm (colour) and view.exr (colour, depth,
// normals, labels).

#include <iostream>

#include "core/error.h"
#include "examples/picture.h"
#include "renderer/files/exr_io.h"
#include "renderer/files/ply_io.h"
#include "renderer/renderer_backend.h"
#include "renderer/scene/room_scene.h"

using namespace segsim;

int main(int argc, char** argv) try {
  const std::string file = argc > 1 ? argv[1] : "room.ply";
  if (argc < 2)
    renderer::write_surfels_ply(file, renderer::make_room_scene({.surfel_count = 300'000}));

  const auto surfels =
      std::make_shared<const renderer::SurfelCloud>(renderer::read_surfels_ply(file));
  const auto view = renderer::make_renderer(renderer::Backend::kCpu, surfels);
  const core::CameraPose T_world_camera =
      core::look_at({1.0, 1.0, 1.6}, {6.0, 4.0, 0.6});                      // [m]
  const auto intrinsics = core::CameraIntrinsics::from_fov(640, 480, 1.2);  // [rad]
  const core::Frame frame = view->render(T_world_camera, intrinsics, core::Channels::kAll);

  examples::write_ppm("view.ppm", frame.rgb);
  renderer::write_frame_exr("view.exr", frame);
  std::cout << "surfels " << surfels->size() << "\nsurfels_in_view "
            << frame.stats.surfels_projected << "\ndepth_in_the_middle_m "
            << frame.depth_m(320, 240) << '\n';
  return 0;
} catch (const core::InputError& error) {
  std::cerr << "error: " << error.what() << '\n';
  return 2;
}
