"""Small surfel scenes as PLY files in the layout of the 2DGS code."""

import pathlib

import numpy as np

SH_C0 = 0.28209479177387814
#: (w, x, y, z) that turns a disc's normal, its z, to the world's +x, and to +y.
FACES_X = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
FACES_Y = (np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0)


def write_surfels(file: pathlib.Path, positions_m, rotations, scales_m, opacities, colours, semantic=None,
                  instance=None, features=None) -> pathlib.Path:
    """colours in [0, 1]; semantic and instance ids, or none; features [surfels, 48], or none."""
    n = len(positions_m)
    opacity = np.asarray(opacities, np.float64)
    columns = [("xyz"[k], "f4", np.asarray(positions_m)[:, k]) for k in range(3)]
    columns += [(f"f_dc_{k}", "f4", (np.asarray(colours)[:, k] - 0.5) / SH_C0) for k in range(3)]
    columns += [("opacity", "f4", np.log(opacity / (1.0 - opacity)))]
    columns += [(f"scale_{k}", "f4", np.log(np.asarray(scales_m)[:, k])) for k in range(2)]
    columns += [(f"rot_{k}", "f4", np.asarray(rotations)[:, k]) for k in range(4)]
    if semantic is not None:
        columns += [("semantic_id", "u2", semantic), ("instance_id", "u2", instance)]
    if features is not None:
        columns += [(f"sem_f_{k}", "f4", features[:, k]) for k in range(16)]
        columns += [(f"ins_f_{k}", "f4", features[:, 16 + k]) for k in range(32)]
    rows = np.zeros(n, [(name, "<" + kind) for name, kind, _ in columns])
    for name, _, values in columns:
        rows[name] = values
    words = {"f4": "float", "u2": "ushort"}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    header += [f"property {words[kind]} {name}" for name, kind, _ in columns] + ["end_header", ""]
    file.write_bytes("\n".join(header).encode() + rows.tobytes())
    return file


def write_room(file: pathlib.Path, surfels: int = 4000, seed: int = 1, labelled: bool = True) -> pathlib.Path:
    """Discs of random place, tilt, size, opacity and colour in a room of 8 x 6 x 2.8 m; labels by metres of x."""
    random = np.random.default_rng(seed)
    positions = random.uniform((0, 0, 0), (8, 6, 2.8), (surfels, 3))
    metre = np.floor(positions[:, 0]).astype(np.int64)
    rotations = random.normal(size=(surfels, 4))
    rotations /= np.linalg.norm(rotations, axis=1, keepdims=True)
    return write_surfels(file, positions, rotations, np.exp(random.normal(-2.9, 0.5, (surfels, 2))),
                         random.uniform(0.3, 0.99, surfels), random.uniform(0, 1, (surfels, 3)),
                         metre + 1 if labelled else None, metre + 101 if labelled else None)


def write_one_disc(file: pathlib.Path, position_m, rotation, scale_m=0.15, colour=(1.0, 0.0, 0.0)) -> pathlib.Path:
    return write_surfels(file, [position_m], [rotation], [(scale_m, scale_m)], [0.95], [colour], [3], [7])
