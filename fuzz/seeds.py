"""Writes fuzz/seeds: small valid files from which fuzzing starts. Needs numpy and pillow."""

import json
import pickle
import struct
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).parent / "seeds"
rng = np.random.default_rng(0)


def place(target, name):
    folder = ROOT / target
    folder.mkdir(parents=True, exist_ok=True)
    return folder / name


def pose(i):
    """Returns the pose of camera `i`, which looks at the origin."""
    angle = 0.9 * i
    eye = np.array([3.2 * np.cos(angle), 3.2 * np.sin(angle), 2.4])
    back = eye / np.linalg.norm(eye)
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    return matrix.round(6).tolist()


blender = {
    "camera_angle_x": 0.6911112,
    "frames": [{"file_path": f"./train/r_{i}", "transform_matrix": pose(i)} for i in range(2)],
}
nerfstudio = {
    "w": 8, "h": 6, "fl_x": 10.0, "fl_y": 11.0, "cx": 4.5, "cy": 3.5, "k1": 0.0,
    "near": 1.0, "far": 6.0, "aabb": [[-1, -1, -1], [1, 1, 1]],
    "train_filenames": ["f_0.png"], "test_filenames": ["f_1.png"],
    "frames": [
        {"file_path": f"f_{i}.png", "ray_depth_file_path": "d.npy", "transform_matrix": pose(i)} for i in range(2)
    ],
}
place("transforms", "blender.json").write_text(json.dumps(blender))
place("transforms", "nerfstudio.json").write_text(json.dumps(nerfstudio))

rows = []
for i in range(2):
    matrix = [[0, 1, 0, 0.3 * i, 16], [-1, 0, 0, 0, 16], [0, 0, 1, 0, 20]]
    rows.append(np.array(matrix, float).ravel().tolist() + [2.0, 10.0])
np.save(place("poses_bounds", "f8.npy"), np.array(rows))
np.save(place("poses_bounds", "f4.npy"), np.array(rows, dtype=np.float32))

np.save(place("depth", "f4.npy"), np.arange(6, dtype=np.float32).reshape(2, 3))
np.save(place("depth", "f8.npy"), np.arange(4, dtype=np.float64))
np.save(place("depth", "fortran.npy"), np.asfortranarray(np.ones((2, 2))))

parameters = {2: [20.0, 4.0, 3.0, 0.1], 5: [20.0, 21.0, 4.0, 3.0, 0.1, 0.0, 0.0, 0.0],
              6: [20.0, 21.0, 4.0, 3.0, 0.1, 0.02, 0.001, 0.0, 0.0, 0.05, 0.0, 0.0]}
binary = struct.pack("<Q", len(parameters))
for model, values in parameters.items():
    binary += struct.pack(f"<IiQQ{len(values)}d", model, model, 8, 6, *values)
place("colmap", "cameras.bin").write_bytes(binary)
place("colmap", "images.bin").write_bytes(
    struct.pack("<QI7dI", 1, 5, 1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 3.0, 2) + b"a.png\0" + struct.pack("<Q2dQ", 1, 3.0, 2.0, 9)
)
place("colmap", "points3D.bin").write_bytes(struct.pack("<QQ3d3BdQ2I", 1, 9, 0.0, 0.1, 3.0, 1, 2, 3, 0.5, 1, 5, 0))
place("colmap", "cameras.txt").write_text("# cameras\n1 OPENCV 8 6 20 21 4 3 0.1 0.01 0 0\n")
place("colmap", "images.txt").write_text("5 1 0 0 0 0.1 0.2 3 1 a.png\n3 2 9 4 4 -1\n")
place("colmap", "points3D.txt").write_text("9 0 0.1 3 1 2 3 0.5 5 0\n")

matrices = {}
for i in range(2):
    axes = np.array(pose(i))
    rotation = np.diag([1.0, -1.0, -1.0]) @ axes[:3, :3].T
    camera = np.array([[20.0, 0, 3.5], [0, 20.0, 2.5], [0, 0, 1]])
    world = np.eye(4)
    world[:3] = camera @ np.hstack([rotation, -rotation @ axes[:3, 3:]])
    matrices |= {f"world_mat_{i}": world, f"scale_mat_{i}": np.diag([2.0, 2, 2, 1]).astype(np.float32)}
np.savez(place("cameras_npz", "stored.npz"), **matrices)
np.savez_compressed(place("cameras_npz", "deflated.npz"), **matrices)

cams = {"K": [], "D": [], "R": [], "T": []}
for i in range(2):
    axes = np.array(pose(i))
    rotation = np.diag([1.0, -1.0, -1.0]) @ axes[:3, :3].T
    cams["K"].append(camera)
    cams["D"].append(np.array([[-0.1], [0.05], [0.001], [0.0], [0.01]]))
    cams["R"].append(rotation.tolist())
    cams["T"].append(-1000 * rotation @ axes[:3, 3:])
annots = {"cams": cams, "ims": [{"ims": ["Camera_B1/0.jpg", "Camera_B2/0.jpg"]}]}
np.save(place("annots", "lists.npy"), annots)
arrays = {"cams": {k: np.array(v) for k, v in cams.items()}, "ims": [{"ims": np.array(["a.jpg", "b.jpg"])}]}
np.save(place("annots", "arrays.npy"), arrays)
with open(place("annots", "protocol2.npy"), "wb") as file:
    np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": ()})
    pickle.dump(np.array(annots, dtype=object), file, protocol=2)

for mode, shape in [("L", (5, 7)), ("RGB", (5, 7, 3)), ("RGBA", (5, 7, 4))]:
    Image.fromarray(rng.integers(0, 256, shape, dtype=np.uint8), mode).save(place("image", f"{mode}.png"))
Image.fromarray(rng.integers(0, 256, (8, 8, 3), dtype=np.uint8)).save(place("image", "rgb.jpg"), quality=50)
Image.fromarray(rng.integers(0, 65536, (4, 4)).astype(np.uint16)).save(place("image", "grey16.png"))
palette = Image.fromarray(rng.integers(0, 4, (4, 4), dtype=np.uint8), "P")
palette.putpalette([value for _ in range(4) for value in (10, 200, 90)])
palette.save(place("image", "palette.png"))
