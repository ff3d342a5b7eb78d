"""Scenes and programs that several tests use."""

import hashlib
import json
import os
import pathlib
import shutil
import subprocess

import pytest

import fastsegsim
from surfel_files import write_room

SCENE_YAML = """schema: segsim.scene
version: 3
name: room
world: {{up: z, unit: m, gravity_mps2: [0, 0, -9.80665]}}
levelling: {{R_world_source_wxyz: [1, 0, 0, 0], p_world_source_m: [0, 0, 0]}}
mesh_source: ""
cameras: {{name: cameras.txt, sha256: {cameras}}}
rendering_only: {{reason: it has no floor, robot: jackal, robots_that_fit: []}}
geodetic_origin: {{latitude_deg: 49.9, longitude_deg: 8.9, height_m: 0, yaw_rad: 0}}
robot: {{radius_m: 0.33, height_m: 1.25, camera_height_m: 1}}
provenance: {{created_by: test, source: random discs, source_sha256: ""}}
statistics: {{}}
files:
  surfels: {{name: surfels.ply, sha256: {surfels}}}
classes:
  - {{id: 1, name: floor, thing: false}}
  - {{id: 3, name: couch, thing: true}}
instances:
  - {{id: 103, class: 3, name: couch_1, box_min_m: [2, 0, 0], box_max_m: [3, 6, 2.8]}}
"""

CAMERAS = """segsim cameras 1
intrinsics 64 48 50 51 32 24
1 3 1.2 0.5 -0.5 0.5 -0.5 first
2 2 1.4 0.5 -0.5 0.5 -0.5 second
"""


def program_of(variable: str) -> pathlib.Path:
    """A program that the environment names; a test that needs it is skipped where no name is given."""
    name = os.environ.get(variable)
    if not name:
        pytest.skip(f"{variable} does not name a program")
    assert pathlib.Path(name).is_file(), f"{variable}: expected a program, found none at {name}"
    return pathlib.Path(name)


@pytest.fixture(scope="session")
def segsim():
    """Runs `segsim` with arguments, and returns what it prints."""
    program = program_of("SEGSIM_PROGRAM")

    def run(*arguments) -> str:
        ran = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    return run


class Tiny:
    """Two rooms with a couch and a chair: a bundle to drive in, its episodes, and trials in it."""

    def __init__(self, program: pathlib.Path, folder: pathlib.Path):
        self.program, self.folder = program, folder
        self.bundle, self.episodes = folder / "bundle", folder / "episodes.jsonl"
        subprocess.run([program, "scene", folder], check=True)
        self.listed = [json.loads(line) for line in self.episodes.read_text().splitlines()][1:]

    def trial(self, episode: int, commands, robot: str = "jackal", period_s: float = 0.1) -> dict:
        """What a trial in C++ makes of (v, w) for each tick and STOP."""
        text = "".join(f"{float(v)!r} {float(w)!r}\n" for v, w in commands)
        ran = subprocess.run([self.program, "run", self.folder, str(episode), robot, str(period_s)], input=text,
                             capture_output=True, text=True, check=True)
        return json.loads(ran.stdout)


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> Tiny:
    return Tiny(program_of("SEGSIM_TINY_TRIAL"), tmp_path_factory.mktemp("tiny"))


@pytest.fixture(scope="session")
def room_file(tmp_path_factory) -> pathlib.Path:
    return write_room(tmp_path_factory.mktemp("room") / "room.ply")


@pytest.fixture(scope="session")
def room(room_file) -> fastsegsim.Scene:
    return fastsegsim.Scene.load(room_file)


@pytest.fixture
def bundle(tmp_path, room_file) -> pathlib.Path:
    """A bundle for rendering only."""
    folder = tmp_path / "bundle"
    folder.mkdir()
    shutil.copy(room_file, folder / "surfels.ply")
    sha256 = hashlib.sha256((folder / "surfels.ply").read_bytes()).hexdigest()
    (folder / "cameras.txt").write_text(CAMERAS)
    cameras = hashlib.sha256(CAMERAS.encode()).hexdigest()
    (folder / "scene.yaml").write_text(SCENE_YAML.format(surfels=sha256, cameras=cameras))
    return folder


RUN_SPEC = """schema: segsim.experiment/1
name: small
seed: 3
scenes:
  - {{name: tiny, title: Two rooms, bundle: {bundle}, goals: [couch, chair], episodes: 4, camera_height_m: 1.0}}
arms:
  - {{name: before, detector: oracle, policy: frontier}}
  - {{name: after, detector: oracle, policy: oracle-path}}
robot: jackal-gentle
control_period_s: 0.25
time_limit_s: 12
camera: {{width: 96, height: 72, hfov_deg: 70, pitch_down_deg: 10, depth_range_m: 6}}
frames: {{of: all, every_s: 0.25}}
"""


@pytest.fixture(scope="session")
def small_run(tiny, segsim, tmp_path_factory) -> pathlib.Path:
    """The work folder of a finished run of two arms, with logs and the image of every tick. To be read only."""
    folder = tmp_path_factory.mktemp("small_run")
    (folder / "small.yaml").write_text(RUN_SPEC.format(bundle=tiny.bundle))
    segsim("run", folder / "small.yaml", "--work", folder / "work", "--workers", 2)
    return folder / "work"
