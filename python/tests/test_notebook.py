"""The notebook runs from top to bottom, without Jupyter: its cells are Python."""

import json
import os
import sys
import tempfile
import types
import unittest
import unittest.mock
from pathlib import Path

from test_infonerf import needs

NOTEBOOK = Path(__file__).parents[1] / "notebooks" / "results.ipynb"


class Notebook(unittest.TestCase):
    @needs("pandas")
    def test_every_cell_runs(self) -> None:
        cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        pictures: list[bytes] = []
        display = types.ModuleType("IPython.display")
        vars(display)["Image"] = lambda filename: pictures.append(Path(filename).read_bytes())
        names = {"__name__": "__main__"}
        modules = {"IPython": types.ModuleType("IPython"), "IPython.display": display}
        before = os.getcwd()
        with tempfile.TemporaryDirectory() as folder, unittest.mock.patch.dict(sys.modules, modules):
            os.chdir(folder)
            try:
                for number, cell in enumerate(code, 1):
                    exec(compile(cell, f"cell {number} of {NOTEBOOK.name}", "exec"), names)
            finally:
                os.chdir(before)
        self.assertTrue(pictures[0].startswith(b"\x89PNG"))
