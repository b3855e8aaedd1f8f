"""Reads event files with TensorBoard's own reader and compares them with the logs beside them.

    pip install tensorboard
    python check.py [FOLDER ...]

Without a folder: the file beside this script, whose bytes crates/report/tests/tensorboard.rs compares with what is written.
With folders: every event file below them, as `infonerf tensorboard FOLDER` wrote it.
"""

import json
import pathlib
import struct
import sys

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator


def scalars(value, name):
    if isinstance(value, dict):
        for key, inner in value.items():
            if key != "step":
                yield from scalars(inner, f"{name}/{key}")
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield name, struct.unpack("f", struct.pack("f", value))[0]


def logged(path):
    expected = {}
    for line in path.read_text().splitlines():
        try:
            event = json.loads(line)
        except json.JSONDecodeError:
            continue
        name = "train" if event["event"] == "step" else event["event"]
        for tag, value in scalars(event, name):
            expected.setdefault(tag, []).append((event["step"], value))
    return expected


def check(events):
    reader = EventAccumulator(str(events), size_guidance={"scalars": 0}, purge_orphaned_data=False)
    reader.Reload()
    found = {tag: [(e.step, e.value) for e in reader.Scalars(tag)] for tag in reader.Tags()["scalars"]}
    expected = logged(events.parent / "metrics.jsonl")
    assert found == expected, (events, set(expected) ^ set(found))
    seconds = [e.wall_time for e in reader.Scalars("train/seconds")]
    for e in reader.Scalars("train/seconds"):
        relative, training = e.wall_time - seconds[0], e.value - reader.Scalars("train/seconds")[0].value
        assert abs(relative - training) < 1e-3 + 1e-6 * training, (relative, training)
    return len(found), sum(map(len, found.values()))


folders = [pathlib.Path(folder) for folder in sys.argv[1:]] or [pathlib.Path(__file__).parent]
files = sorted(file for folder in folders for file in folder.rglob("events.out.tfevents.infonerf"))
assert files, f"no event files in {folders}"
for file in files:
    tags, values = check(file)
    print(f"{file}: {tags} tags, {values} values, all as logged")
