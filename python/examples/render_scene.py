#!/usr/bin/env python3
"""Draws a scene from one point towards another, and says what is in view.

  render_scene.py SCENE [--from X Y Z] [--to X Y Z]

SCENE is the folder of a bundle, or surfels in the layout of the 2DGS code (.ply); points are in its world frame, in
metres. Writes view.ppm. Without points the camera stands in the middle of the scene.
"""

import argparse
import sys

import numpy as np

import fastsegsim

SIZE = (640, 480)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--from", dest="eye_m", nargs=3, type=float)
    parser.add_argument("--to", dest="target_m", nargs=3, type=float)
    arguments = parser.parse_args()

    scene = fastsegsim.Scene.load(arguments.scene)
    middle = np.median(scene.positions_m, axis=0)
    eye_m = middle if arguments.eye_m is None else np.array(arguments.eye_m)
    target_m = eye_m + [1.0, 0.0, 0.0] if arguments.target_m is None else np.array(arguments.target_m)

    renderer = fastsegsim.Renderer(scene)
    images = renderer.render(fastsegsim.look_at(eye_m, target_m), fastsegsim.pinhole(SIZE, np.radians(70)), SIZE,
                             ("rgb", "depth", "semantic"))

    with open("view.ppm", "wb") as file:
        file.write(b"P6\n%d %d\n255\n" % SIZE + images["rgb"].tobytes())
    print(f"{scene.name}: {scene.surfels} surfels, drawn by {renderer.backend} in {renderer.stats['render_ms']:.1f} ms")
    for scene_class in scene.classes:
        pixels = images["semantic"] == scene_class.id
        if pixels.any():
            nearest_m = np.nanmin(images["depth"][pixels])
            print(f"{scene_class.name:16} {pixels.mean():6.1%} of the image, nearest {nearest_m:.2f} m")


if __name__ == "__main__":
    try:
        main()
    except fastsegsim.InputError as error:
        sys.exit(f"render_scene.py: {error}")
