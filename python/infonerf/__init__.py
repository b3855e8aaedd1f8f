"""Run InfoNeRF's program from Python, and read what it leaves.

The wheel has the program; this package calls it and reads its files, and needs nothing else. `results` returns a pandas
DataFrame, and asks for pandas only when it is called.
"""

from ._program import Event, ProgramError, program, run
from ._results import Row, results, rows

__all__ = ["Event", "ProgramError", "Row", "program", "results", "rows", "run"]
