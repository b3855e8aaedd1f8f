"""The package against the program: `just python`, or `cargo test --release --workspace --test all python::`."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import unittest
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import infonerf
from infonerf._program import Event, Option, arguments

Test = TypeVar("Test", bound=Callable[..., None])

TINY: dict[str, object] = {
    "train.iterations": 40,
    "train.rays": 64,
    "train.target_samples": 1000,
    "scene.size": 24,
    "eval.test": "first-2",
    "eval.information_rays": 0,
    "field.resolutions": [4, 8, 16],
    "field.width": 16,
    "field.layers": 1,
    "render.occupancy.resolution": 16,
    "render.samples": {"from": 12, "to": 24, "end": 0.5, "curve": "exponential"},
}


def needs(*modules: str) -> Callable[[Test], Test]:
    missing = [module for module in modules if find_spec(module) is None]
    return unittest.skipIf(bool(missing), f"{' and '.join(missing)} not installed")


class Runs(unittest.TestCase):
    out: Path
    events: list[Event]
    records: list[infonerf.Row]

    @classmethod
    def setUpClass(cls) -> None:
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.out = Path(folder.name)
        cls.events = []
        cls.records = infonerf.run(
            "fast-losses", scene="crane", variant=["factored", "infonerf+"], set=TINY, out=cls.out, on_event=cls.events.append
        )

    def test_a_run_reports_events_and_returns_records(self) -> None:
        self.assertEqual([record["variant"] for record in self.records], ["factored", "infonerf+"])
        self.assertEqual({record["iterations"] for record in self.records}, {40})
        kinds = [event["event"] for event in self.events]
        self.assertEqual((kinds[0], kinds[-1], kinds.count("record")), ("loading", "finished", 2))
        self.assertIn("step", kinds)

    def test_rows_are_the_records_with_their_folders(self) -> None:
        self.assertEqual(infonerf.rows(self.out), self.records)
        self.assertEqual(infonerf.rows(self.out / "fast-losses" / "results.json"), self.records)
        for record in self.records:
            self.assertTrue(Path(record["folder"], "config.toml").is_file())

    @needs("pandas")
    def test_results_are_a_data_frame(self) -> None:
        frame = infonerf.results(self.out)
        self.assertEqual(list(frame["psnr"]), [record["psnr"] for record in self.records])
        self.assertEqual(list(frame["test_views.count"]), [2, 2])

    @unittest.skipUnless(find_spec("pandas") is None, "pandas is installed")
    def test_results_ask_for_pandas(self) -> None:
        with self.assertRaisesRegex(ImportError, "pip install pandas"):
            infonerf.results(self.out)

    def test_refusals_are_the_programs_message(self) -> None:
        with self.assertRaisesRegex(infonerf.ProgramError, "^nothing: expected an experiment file or one of") as raised:
            infonerf.run("nothing", out=self.out)
        self.assertEqual(raised.exception.code, 2)
        with self.assertRaisesRegex(infonerf.ProgramError, "unexpected argument '--scenes'"):
            infonerf.run("fast-losses", scenes="crane", out=self.out)
        with self.assertRaisesRegex(FileNotFoundError, "expected a results.json"):
            infonerf.rows(self.out / "fast-losses" / "crane")

    def test_stopped_runs_are_continued_by_the_same_call(self) -> None:
        def stop(event: Event) -> None:
            if event["event"] == "step":
                raise KeyboardInterrupt

        longer = {**TINY, "train.iterations": 500}
        options: dict[str, Any] = {"scene": "crane", "variant": "factored", "out": self.out / "stopped", "set": longer}
        with self.assertRaises(KeyboardInterrupt):
            infonerf.run("fast-losses", on_event=stop, **options)
        if sys.platform != "win32":
            (record,) = infonerf.run("fast-losses", **options)
            self.assertEqual(record["iterations"], 500)
            self.assertEqual(infonerf.run("fast-losses", **options), [record])

    @unittest.skipIf(sys.platform == "win32", "signals of process groups are POSIX's")
    def test_ctrl_c_of_a_terminal_saves_the_run(self) -> None:
        """A terminal signals every process of the group: the program must be told to stop once, not twice."""
        script = "import infonerf, json, sys; infonerf.run('fast-losses', on_event=print, **json.loads(sys.argv[1]))"
        # The program saves when it is told to stop, and at no other time.
        endless = {**TINY, "train.iterations": 10_000_000, "train.checkpoint_every": 0}
        for attempt in range(3):
            out = self.out / f"signalled-{attempt}"
            options = {"scene": "crane", "variant": "factored", "out": str(out), "set": endless}
            caller = subprocess.Popen(
                [sys.executable, "-u", "-c", script, json.dumps(options)],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                start_new_session=True,
                # A shell starts its background jobs, such as this test may be, with the signal ignored.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            )
            assert caller.stdout is not None
            with caller.stdout:
                next(line for line in caller.stdout if "'step'" in line)
                os.killpg(caller.pid, signal.SIGINT)
                caller.wait(timeout=60)
            run = out / "fast-losses" / "crane" / "factored" / "seed0"
            self.assertTrue((run / "checkpoint" / "manifest.json").is_file(), f"attempt {attempt}")


class Files(unittest.TestCase):
    def test_broken_results_are_named(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "results.json")
            path.write_text('[{"scene": ', encoding="utf-8")
            with self.assertRaisesRegex(ValueError, "results.json: expected the records of runs in JSON: .* line 1"):
                infonerf.rows(folder)


class Options(unittest.TestCase):
    def test_options_are_those_of_the_command_line(self) -> None:
        options: dict[str, Option] = {
            "scene": ["a", "b"],
            "seed": range(2),
            "overwrite": True,
            "quiet": False,
            "data": None,
            "submit_option": Path("x"),
            "set": {"eval.test": "all", "a.b": True, "c": {"from": 1e-3, "curve": "linear"}, "d": [1, 2]},
        }
        expected = (
            "--scene=a --scene=b --seed=0 --seed=1 --overwrite --submit-option=x --set=eval.test=all --set=a.b=true"
        ).split() + ['--set=c={ from = 0.001, curve = "linear" }', "--set=d=[1, 2]"]
        self.assertEqual(arguments(options), expected)
        with self.assertRaisesRegex(ValueError, "found None"):
            arguments({"set": {"train.lr": None}})

    def test_numbers_and_arrays_of_numpy_and_paths_are_values(self) -> None:
        class Zero:
            def tolist(self) -> int:
                return 0

            def __str__(self) -> str:
                return "0"

        given: dict[str, Any] = {"seed": Zero(), "set": {"seed": Zero(), "scene.path": Path("a/b")}}
        self.assertEqual(arguments(given), ["--seed=0", "--set=seed=0", '--set=scene.path="a/b"'])


if __name__ == "__main__":
    unittest.main()
