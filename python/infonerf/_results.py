"""Records of runs: `results.json`."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas

Row = dict[str, Any]
"""One run, with the keys of `results.schema.json`."""


def rows(path: str | os.PathLike[str]) -> list[Row]:
    """The records of all runs in `path`: a `results.json`, or a folder with some anywhere below it.

    Each has one key in addition to those of `results.schema.json`: `folder`, where the run's pictures, curves and weights are.
    Raises FileNotFoundError if there is no `results.json`, and ValueError if one is broken.
    """
    path = Path(path)
    files = sorted(path.rglob("results.json")) if path.is_dir() else [path]
    if not files:
        raise FileNotFoundError(f"{path}: expected a results.json in it or below it")
    return [located(record, file.parent) for file in files for record in _records(file)]


def _records(file: Path) -> list[Row]:
    try:
        records: list[Row] = json.loads(file.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise ValueError(f"{file}: expected the records of runs in JSON: {error}") from error
    return records


def results(path: str | os.PathLike[str]) -> pandas.DataFrame:
    """The records of all runs in `path` as a DataFrame, a row for each; nested keys are joined by dots, such as
    `test_views.count`.

    Raises ImportError if pandas is not installed, and as `rows`.
    """
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise ImportError("infonerf.results needs pandas, which is not installed: pip install pandas") from error

    return pandas.json_normalize(rows(path))


def located(record: Row, experiment: Path) -> Row:
    """`record` with the folder of its run below that of its experiment."""
    return {**record, "folder": str(experiment / record["scene"] / record["variant"] / f"seed{record['seed']}")}
