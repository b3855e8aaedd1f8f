"""Weights and pictures by a rule, the same in Python and in Rust (`common/mod.rs`), so that neither is stored."""

import numpy as np
import torch


def hashed(name, count):
    """`count` numbers in [-1, 1) that look random, different for each name."""
    seed = 0x811C9DC5
    for byte in name.encode():
        seed = (seed ^ byte) * 0x01000193 & 0xFFFFFFFF
    x = (np.arange(count, dtype=np.uint64) * np.uint64(0x9E3779B1) + np.uint64(seed)) & np.uint64(0xFFFFFFFF)
    for shift, factor in ((15, 0x2C1B3C6D), (12, 0x297A2D39)):
        x = ((x ^ (x >> np.uint64(shift))) * np.uint64(factor)) & np.uint64(0xFFFFFFFF)
    x ^= x >> np.uint64(15)
    return (x >> np.uint64(8)).astype(np.float64) / 2**23 - 1


def tensor(name, shape):
    """The tensor of a network that is called so."""
    u = hashed(name, int(np.prod(shape)))
    if name.startswith("lin"):
        values = np.abs(u) / shape[1]
    elif len(shape) > 1:
        values = u * np.sqrt(6 / np.prod(shape[1:]))
    elif name.endswith(("bn.weight", "running_var")):
        values = 1 + 0.2 * u
    else:
        values = 0.1 * u
    return torch.tensor(values.astype(np.float32).reshape(shape)).double()


def pictures(n, height, width):
    """8-bit pictures of a few waves and some noise, [n, 3, height, width] in [0, 1]."""
    i, c, y, x = np.meshgrid(*(np.arange(k) for k in (n, 3, height, width)), indexing="ij")
    waves = (x * (i + 2) * 3 + y * (c + 1) * 5) % 128 + (x * y // (3 + i) + 40 * c) % 64
    noise = ((x * 7919 + y * 104729 + c * 31 + i * 17) % 64).astype(np.int64)
    return torch.tensor((waves + noise).clip(0, 255) / 255.0)
