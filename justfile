# `just` without arguments lists these recipes. Each is a short name for a command.

set positional-arguments

# Cargo features of the program that `exp`, `sweep`, `reproduce` and `bench` run: just features=wgpu exp synthetic-4view
features := ""
run := "cargo run --release " + if features == "" { "--" } else { "--features " + features + " --" }

# Program that `test-gpu` builds in addition to the tests.
program := env_var_or_default("CARGO_TARGET_DIR", "target") + "/release/infonerf"

# Python environment into which `python` installs packages.
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

# Run the paper's tables at a small scale, and report the figures and which claims hold: just reproduce --jobs 2
reproduce *ARGS:
    {{ run }} reproduce "$@"

# Run all tests
test:
    cargo test --release --workspace

# Test sweeps on a Slurm of one node, which this recipe starts and stops: as root, with Slurm installed
test-slurm:
    #!/usr/bin/env bash
    set -euo pipefail
    export SLURM_CONF=/tmp/infonerf-slurm/slurm.conf
    scripts/slurm-node start
    trap 'scripts/slurm-node stop' EXIT
    cargo test --release --workspace --test all slurm:: -- --ignored

# Check formatting and lints
lint:
    cargo fmt --all --check
    cargo clippy --release --workspace --all-targets -- -D warnings

# Build the documentation of all crates
doc:
    RUSTDOCFLAGS='-D warnings' cargo doc --release --workspace --no-deps

# Build a searchable book of the documents and the crates' documentation: needs mdbook 0.5 (cargo install mdbook) and Python 3.11
book: doc
    scripts/book

# Check the Python package: its tests, notebook and types, in a separate environment with pandas
python:
    python3 -m venv {{ environment }}
    {{ environment }}/bin/pip install --quiet mypy pandas pandas-stubs
    {{ environment }}/bin/mypy
    PYTHON={{ environment }}/bin/python cargo test --release --workspace --test all python:: -- --nocapture

# Build a wheel with the program and the Python package in dist/: needs maturin (pip install maturin)
wheel *ARGS:
    maturin build --release --locked --out dist "$@"

# Run all checks that a change has to pass
ci:
    .ci/run

# Run a benchmark: just bench pareto, skip, step, render, agreement, stress or stress-training
bench NAME *ARGS:
    {{ run }} bench "$@"

# Benchmark a GPU (DEVICE: wgpu, vulkan or cuda): agreement with the CPU; a step of the authors' network, before and after kernels are compiled; time against error
bench-gpu DEVICE *ARGS: (test-gpu DEVICE)
    {{ program }} bench step --device {{ DEVICE }} --preset released
    {{ program }} bench step --device {{ DEVICE }} --preset released
    {{ program }} bench pareto --device {{ DEVICE }} {{ ARGS }}

# Test exported pages, the live viewer and the report's layout: needs Chromium (Debian: apt-get install chromium) on the PATH or named by CHROMIUM
test-view:
    cargo test --release --workspace --test all browser:: -- --ignored --test-threads 1 --nocapture

# Build an archive of at most 60 MiB with programs and a measuring script, for a GPU machine without network or compiler
gpu-bundle *FEATURES:
    scripts/gpu-bundle "$@"

# Test the agreement of a GPU, or of a software device such as lavapipe, with the CPU: operations, gradients, training, one run, hard inputs
test-wgpu: (test-gpu "wgpu")

[private]
test-gpu DEVICE:
    @command -v vulkaninfo >/dev/null && vulkaninfo --summary 2>/dev/null | grep deviceName || \
        echo "No Vulkan device seen. On Linux install a driver: mesa-vulkan-drivers (it has the software device lavapipe) or NVIDIA's; vulkan-tools shows what is there. macOS and Windows need nothing." >&2
    cargo test --release -p infonerf -p infonerf-tests --features infonerf/{{ DEVICE }},infonerf-tests/{{ DEVICE }} --test all -- gpu:: forward:: pixelnerf::
    {{ program }} bench stress --device {{ DEVICE }} --rays 5000
