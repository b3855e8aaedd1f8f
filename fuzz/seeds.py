"""Writes fuzz/seeds: small valid files that fuzzing starts from. Needs numpy and pillow."""

import json
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
    """A camera that looks at the origin."""
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

for mode, shape in [("L", (5, 7)), ("RGB", (5, 7, 3)), ("RGBA", (5, 7, 4))]:
    Image.fromarray(rng.integers(0, 256, shape, dtype=np.uint8), mode).save(place("image", f"{mode}.png"))
Image.fromarray(rng.integers(0, 256, (8, 8, 3), dtype=np.uint8)).save(place("image", "rgb.jpg"), quality=50)
Image.fromarray(rng.integers(0, 65536, (4, 4)).astype(np.uint16)).save(place("image", "grey16.png"))
palette = Image.fromarray(rng.integers(0, 4, (4, 4), dtype=np.uint8), "P")
palette.putpalette([value for _ in range(4) for value in (10, 200, 90)])
palette.save(place("image", "palette.png"))
