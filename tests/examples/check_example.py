#!/usr/bin/env python3
"""Runs an example in an empty folder and checks what it printed and drew.

  check_example.py NAME PROGRAM
"""
import collections
import pathlib
import subprocess
import sys
import tempfile

Picture = collections.namedtuple("Picture", "width height pixels")


def read_ppm(file):
    """A binary PPM file of 8 bits per channel; pixels are (r, g, b), row by row."""
    magic, size, largest, data = file.read_bytes().split(b"\n", 3)
    width, height = map(int, size.split())
    assert (magic, largest, len(data)) == (b"P6", b"255", 3 * width * height), f"{file.name} is no PPM picture"
    return Picture(width, height, list(zip(data[0::3], data[1::3], data[2::3])))


def share(picture, is_wanted):
    return sum(map(is_wanted, picture.pixels)) / len(picture.pixels)


def is_red(pixel):
    return pixel[0] > 200 and max(pixel[1:]) < 60


def is_blue(pixel):
    return pixel[2] > 1.4 * pixel[0]


def check_not_blank(picture, least_colours):
    colours = collections.Counter(picture.pixels)
    assert len(colours) >= least_colours, f"only {len(colours)} colours"
    assert colours.most_common(1)[0][1] < 0.95 * len(picture.pixels), "nearly all of the picture has one colour"


def check_render_ply(folder, printed):
    assert printed["surfels"] == "300000"
    assert 50_000 < int(printed["surfels_in_view"]) < 300_000
    assert 1.0 < float(printed["depth_in_the_middle_m"]) < 10.0
    view = read_ppm(folder / "view.ppm")
    assert (view.width, view.height) == (640, 480)
    check_not_blank(view, 10_000)
    assert (folder / "view.exr").read_bytes()[:4] == b"\x76\x2f\x31\x01", "view.exr is no EXR file"


def check_lift_recording(folder, printed):
    assert printed["frames"] == "150"
    assert int(printed["surfels"]) > 50_000
    assert int(printed["instances"]) > 20
    assert float(printed["median_depth_difference_m"]) < 0.01
    assert float(printed["right_class_share"]) > 0.7
    photo, rendered = read_ppm(folder / "photo.ppm"), read_ppm(folder / "rendered.ppm")
    check_not_blank(rendered, 1_000)
    differences = [abs(a[1] - b[1]) for a, b in zip(photo.pixels, rendered.pixels)]
    median = sorted(differences)[len(differences) // 2]
    assert median < 16, f"the median pixel differs by {median} of 255 from the photo"
    header = (folder / "lifted.ply").read_bytes()[:200].decode("latin-1")
    assert f"element vertex {printed['surfels']}\n" in header


def check_plan_on_map(folder, printed):
    straight, planned, driven = (float(printed[key]) for key in ("straight_m", "planned_m", "driven_m"))
    assert 1.5 * straight < planned < 2.5 * straight, "the way leads through the doorway and around the wall"
    assert abs(driven - planned) < 0.1 * planned
    assert float(printed["nearest_wall_m"]) >= 0.30
    assert printed["arrived"] == "1"
    drawn = read_ppm(folder / "map.ppm")
    assert (drawn.width, drawn.height) == (160, 70)
    assert share(drawn, is_red) > 0.005 and share(drawn, is_blue) > 0.02
    assert share(drawn, lambda pixel: pixel == (0, 0, 0)) > 0.1, "walls"


def check_own_policy(folder, printed):
    assert printed["outcome"] == "success"
    assert 0.3 < float(printed["spl"]) <= 1.0
    assert float(printed["path_m"]) > 2.0
    assert int(printed["goal_pixels"]) > 1_000
    view = read_ppm(folder / "last_view.ppm")
    check_not_blank(view, 100)
    assert share(view, is_blue) > 0.2, "the couch, which is blue, is in view"


def check_trial(folder, printed):
    assert printed["outcome"] == "success"
    assert printed["stop_reason"] == "goal_reached"
    assert float(printed["path_m"]) >= 0.95 * (float(printed["shortest_path_m"]) - 1.0)
    assert 0.2 < float(printed["spl"]) <= 1.0
    assert printed["contacts"] == "0"
    drawn = read_ppm(folder / "trial.ppm")
    assert share(drawn, is_red) > 0.005, "the track"
    assert share(drawn, lambda pixel: pixel == (255, 255, 255)) > 0.1, "free floor"
    assert share(drawn, lambda pixel: pixel == (0, 0, 0)) > 0.01, "obstacles"


CHECKS = {
    "render_ply": check_render_ply,
    "lift_recording": check_lift_recording,
    "plan_on_map": check_plan_on_map,
    "own_policy": check_own_policy,
    "trial": check_trial,
}


def main(name, program):
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.run([pathlib.Path(program).resolve()], cwd=folder, capture_output=True, text=True, check=False)
        print(run.stdout, run.stderr, sep="", end="")
        assert run.returncode == 0, f"exit code {run.returncode}"
        printed = dict(line.split(" ", 1) for line in run.stdout.splitlines())
        CHECKS[name](pathlib.Path(folder), printed)


if __name__ == "__main__":
    main(*sys.argv[1:])
