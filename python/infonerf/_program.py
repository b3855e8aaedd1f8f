"""The program as a child process."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import IO, Any, Union

from ._results import Row, located

Event = dict[str, Any]
"""A line of `infonerf exp --json`: its key `event` says which others there are."""

Scalar = Union[str, int, float, Path]
Option = Union[Scalar, Iterable[Scalar], Mapping[str, object], None]


class ProgramError(RuntimeError):
    """The program's message, and its exit code: 2 for anything that the caller can put right, 1 for a run that failed."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


def program() -> Path:
    """The program: what the variable `INFONERF_PROGRAM` names, else what was installed with this package, else what is on the PATH.

    Raises FileNotFoundError if there is none.
    """
    named = os.environ.get("INFONERF_PROGRAM")
    if named:
        return Path(named)
    try:
        files = metadata.files("infonerf") or []
    except metadata.PackageNotFoundError:
        files = []
    installed = [file.locate() for file in files if file.name in ("infonerf", "infonerf.exe")]
    found = installed[0] if installed else shutil.which("infonerf")
    if found is None:
        raise FileNotFoundError("infonerf: expected the program on the PATH, or named by INFONERF_PROGRAM")
    return Path(str(found)).resolve()


def run(experiment: str | Path, *, on_event: Callable[[Event], None] | None = None, **options: Option) -> list[Row]:
    """Runs an experiment, `infonerf exp EXPERIMENT`, and returns the records of its runs as `rows` does.

    `options` are those of the command line (`infonerf exp --help`) with `_` for `-`: a list repeats an option, a mapping
    writes `KEY=VALUE`, True gives it without a value, and None or False leaves it out. `on_event` is given each event as it
    comes; an exception that it raises, as Ctrl-C, stops the program, which saves its run first: the same call continues it,
    and returns the records of runs that are finished. `overwrite=True` starts them anew.

    >>> infonerf.run("fast-losses", scene=["crane", "knot"], variant="infonerf+", set={"train.iterations": 200})

    Raises ProgramError with the program's message if it fails.
    """
    command = [str(program()), "exp", str(experiment), "--json", *arguments(options)]
    records: list[Row] = []
    folder = Path()
    with tempfile.TemporaryFile() as errors:
        # A session of its own: the terminal's Ctrl-C reaches this process alone, which passes it on once. A second signal would
        # stop the program before it has saved.
        child = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=errors, encoding="utf-8", start_new_session=True
        )
        assert child.stdout is not None
        try:
            for line in child.stdout:
                event: Event = json.loads(line)
                if event["event"] == "record":
                    records.append(event["record"])
                if event["event"] == "finished":
                    folder = Path(event["results"]).parent
                if on_event is not None:
                    on_event(event)
        except BaseException:
            _stop(child)
            raise
        finally:
            child.stdout.close()
            child.wait()
        _check(child.returncode, errors)
    return [located(record, folder) for record in records]


def _stop(child: subprocess.Popen[str]) -> None:
    """Lets the program save and end; a second Ctrl-C in the meantime ends it at once."""
    child.send_signal(signal.SIGINT if sys.platform != "win32" else signal.SIGTERM)
    try:
        child.communicate()
    except KeyboardInterrupt:
        child.kill()


def arguments(options: Mapping[str, Option]) -> list[str]:
    """Options of the command line: `{"scene": ["a", "b"], "set": {"x": 1}, "overwrite": True}` as
    `--scene=a --scene=b --set=x=1 --overwrite`."""
    given = []
    for name, value in options.items():
        option = f"--{name.replace('_', '-')}"
        if value is True:
            given.append(option)
        elif value is None or value is False:
            continue
        elif isinstance(value, Mapping):
            given += [f"{option}={key}={item if isinstance(item, str) else _toml(item)}" for key, item in value.items()]
        elif isinstance(value, Iterable) and not isinstance(value, str):
            given += [f"{option}={item}" for item in value]
        else:
            given.append(f"{option}={value}")
    return given


def _toml(value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if value is None:
        raise ValueError("set: expected a value, found None: TOML has no null")
    return json.dumps(value, default=_plain)


def _plain(value: object) -> object:
    """A path as text; NumPy's numbers and arrays as Python's."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _check(code: int, errors: IO[bytes]) -> None:
    errors.seek(0)
    text = errors.read().decode("utf-8", "replace").strip()
    if code != 0:
        message = text.splitlines()[-1].removeprefix("error: ") if text else f"exit code {code}"
        raise ProgramError(message, code)
    if text:
        print(text, file=sys.stderr)
