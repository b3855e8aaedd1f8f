"""Voxel grids: `infonerf export RUN --format npz`."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ._program import call

if TYPE_CHECKING:
    import numpy
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Grid:
    """Density and colour of every voxel."""

    density: NDArray[numpy.float32]
    """σ in 1/scene unit, `[z, y, x]`."""
    color: NDArray[numpy.uint8]
    """Display-encoded RGB, the mean over six directions of view, `[z, y, x, 3]`; 0 where the voxel is practically empty."""
    origin: NDArray[numpy.float32]
    """Centre of voxel (0, 0, 0) as x, y, z in scene units."""
    voxel: float
    """Edge of a voxel in scene units."""

    def opacity(self) -> NDArray[numpy.float32]:
        """α = 1 − exp(−σ·voxel) of light through one voxel, `[z, y, x]`."""
        import numpy

        opacity: NDArray[numpy.float32] = -numpy.expm1(-self.density * numpy.float32(self.voxel))
        return opacity

    def points(self, opacity: float = 0.5) -> NDArray[numpy.float32]:
        """Centres of the voxels of at least this opacity as x, y, z in scene units, `[N, 3]`."""
        import numpy

        cells = numpy.argwhere(self.opacity() >= opacity)[:, ::-1]
        points: NDArray[numpy.float32] = self.origin + numpy.float32(self.voxel) * cells.astype(numpy.float32)
        return points


def load_npz(path: str | os.PathLike[str]) -> Grid:
    """Reads what `infonerf export RUN --format npz` wrote.

    Raises ImportError if NumPy is not installed (`pip install 'infonerf[numpy]'`).
    """
    import numpy

    with numpy.load(path) as file:
        return Grid(file["density"], file["color"], file["origin"], float(file["voxel"][0]))


def grid(run: str | os.PathLike[str], resolution: int | None = None) -> Grid:
    """Exports a finished run, a `folder` of `infonerf.rows`, as a grid of `resolution` voxels along its longest side.

    Raises ProgramError with the program's message if it fails, and as `load_npz`.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "grid.npz")
        size = [] if resolution is None else [f"--resolution={resolution}"]
        call("export", os.fspath(run), "--format=npz", f"--out={file}", *size)
        return load_npz(file)
