# `just` alone lists these. Each is a thin name for a cargo command.

set positional-arguments

[private]
default:
    @just --list

# Run an experiment: just exp synthetic-4view --scene castle
exp NAME *ARGS:
    cargo run --release -- exp "$@"

# Every synthetic table of the paper into one report, and whether what it says holds: just reproduce --jobs 2
reproduce *ARGS:
    cargo run --release -- reproduce "$@"

# Run all tests
test:
    cargo test --release --workspace

# Formatting and lints
lint:
    cargo fmt --all --check
    cargo clippy --release --workspace --all-targets -- -D warnings

# Documentation of all crates
doc:
    RUSTDOCFLAGS='-D warnings' cargo doc --release --workspace --no-deps

# Everything that a change has to pass
ci:
    .ci/run

# Measure speed: just bench pareto, skip, step, scale or render
bench NAME *ARGS:
    cargo run --release -- bench "$@"

# What a test on a GPU through wgpu needs; it tests nothing yet
test-wgpu:
    @echo "There is no automatic test on wgpu yet: the feature compiles, and we have not run it on a GPU."
    @echo "To try it by hand, install a driver for your GPU:"
    @echo "  Linux    Vulkan, e.g. mesa-vulkan-drivers (has a software device too) or NVIDIA's driver; vulkan-tools to look"
    @echo "  macOS    nothing: Metal is part of the system"
    @echo "  Windows  nothing: Direct3D 12 is part of the system"
    @echo "then run:"
    @echo "  cargo run --release --features wgpu -- exp synthetic-4view --device wgpu --scene knot --set train.iterations=20"
    @echo "nothing was tested" >&2; exit 1
