# `just` alone lists these. Each is a thin name for a cargo command.

set positional-arguments

# Cargo features of what `exp`, `sweep`, `reproduce` and `bench` run: just features=wgpu exp synthetic-4view
features := ""
run := "cargo run --release " + if features == "" { "--" } else { "--features " + features + " --" }

# What `test-gpu` builds in addition to the tests.
program := env_var_or_default("CARGO_TARGET_DIR", "target") + "/release/infonerf"

# What `python` installs into.
environment := env_var_or_default("CARGO_TARGET_DIR", justfile_directory() + "/target") + "/python"

[private]
default:
    @just --list

# Run an experiment: just exp synthetic-4view --scene castle
exp NAME *ARGS:
    {{ run }} exp "$@"

# Run an experiment for every combination of some values: just sweep synthetic-4view --grid loss.entropy.weight=0,1e-3
sweep NAME *ARGS:
    {{ run }} sweep "$@"

# Every table of the paper at a small scale into one report, and whether what it says holds: just reproduce --jobs 2
reproduce *ARGS:
    {{ run }} reproduce "$@"

# Run all tests
test:
    cargo test --release --workspace

# Sweeps through a Slurm of one node, which this starts and stops: as root, with Slurm installed
test-slurm:
    #!/usr/bin/env bash
    set -euo pipefail
    export SLURM_CONF=/tmp/infonerf-slurm/slurm.conf
    scripts/slurm-node start
    trap 'scripts/slurm-node stop' EXIT
    cargo test --release --workspace --test all slurm:: -- --ignored

# Formatting and lints
lint:
    cargo fmt --all --check
    cargo clippy --release --workspace --all-targets -- -D warnings

# Documentation of all crates
doc:
    RUSTDOCFLAGS='-D warnings' cargo doc --release --workspace --no-deps

# The documents as a book with search, the crates' documentation in it: needs mdbook 0.5 (cargo install mdbook) and Python 3.11
book: doc
    scripts/book

# The Python package: its tests, notebook and types, with pandas in an environment of their own
python:
    python3 -m venv {{ environment }}
    {{ environment }}/bin/pip install --quiet mypy pandas pandas-stubs
    {{ environment }}/bin/mypy
    PYTHON={{ environment }}/bin/python cargo test --release --workspace --test all python:: -- --nocapture

# A wheel with the program and the Python package, in dist/: needs maturin (pip install maturin)
wheel *ARGS:
    maturin build --release --locked --out dist "$@"

# Everything that a change has to pass
ci:
    .ci/run

# Measure: just bench pareto, skip, step, render, agreement, stress or stress-training
bench NAME *ARGS:
    {{ run }} bench "$@"

# A GPU, DEVICE being wgpu, vulkan or cuda: agreement with the CPU; a step of the authors' network, kernels compiled and tuned, then kept; time against error
bench-gpu DEVICE *ARGS: (test-gpu DEVICE)
    {{ program }} bench step --device {{ DEVICE }} --preset released
    {{ program }} bench step --device {{ DEVICE }} --preset released
    {{ program }} bench pareto --device {{ DEVICE }} {{ ARGS }}

# Exported pages, the live viewer and the report's layout in headless Chromium: needs it (Debian: apt-get install chromium), on the PATH or named by CHROMIUM
test-view:
    cargo test --release --workspace --test all browser:: -- --ignored --test-threads 1 --nocapture

# For a GPU machine without network or compiler: programs and a script that measures, in one archive of at most 60 MiB
gpu-bundle *FEATURES:
    scripts/gpu-bundle "$@"

# Agreement with the CPU on a GPU, or on a software device such as lavapipe: operations, gradients, training, one run, hard inputs
test-wgpu: (test-gpu "wgpu")

[private]
test-gpu DEVICE:
    @command -v vulkaninfo >/dev/null && vulkaninfo --summary 2>/dev/null | grep deviceName || \
        echo "No Vulkan device seen. On Linux install a driver: mesa-vulkan-drivers (it has the software device lavapipe) or NVIDIA's; vulkan-tools shows what is there. macOS and Windows need nothing." >&2
    cargo test --release -p infonerf -p infonerf-tests --features infonerf/{{ DEVICE }},infonerf-tests/{{ DEVICE }} --test all -- gpu:: forward:: pixelnerf::
    {{ program }} bench stress --device {{ DEVICE }} --rays 5000
