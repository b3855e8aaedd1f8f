"""Run InfoNeRF's program from Python, and read what it leaves.

The wheel has the program; this package calls it and reads its files, and needs nothing else. `results` returns a pandas
DataFrame and `load_npz` NumPy arrays, and each asks for its library only when it is called.
"""

from ._grid import Grid, grid, load_npz
from ._program import Event, ProgramError, program, run
from ._results import Row, results, rows

__all__ = ["Event", "Grid", "ProgramError", "Row", "grid", "load_npz", "program", "results", "rows", "run"]
