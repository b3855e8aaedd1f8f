"""Reference values of the Frechet distance and of KID, made with SciPy and NumPy.

    pip install scipy
    python distribution.py > distribution.json

The features follow an integer rule, so that `kid.rs` can make the same ones without storing them.
"""

import json

import numpy as np
from scipy.linalg import sqrtm

# n, m, dimension: full rank, rank deficient on either or both sides, and Inception's dimension.
CASES = [(40, 50, 6), (30, 4, 9), (5, 7, 12), (2, 2, 3), (25, 25, 2048)]


def features(which, n, dimension):
    i, j = np.mgrid[0:n, 0:dimension].astype(np.uint64)
    mixed = (i * np.uint64(7919) + j * np.uint64(104729) + np.uint64(31 * which)) % np.uint64(65521)
    mixed = (mixed * mixed + np.uint64(17) * mixed) % np.uint64(65521)
    noise = mixed.astype(np.float32) / np.float32(65521)
    return noise * np.float32(1 + which) + np.float32(0.25 * which)


def frechet(x, y):
    """As pytorch-fid defines it: a diagonal of 1e-6 only if the root is not finite, and the real part."""
    s, t = np.cov(x, rowvar=False), np.cov(y, rowvar=False)
    root = sqrtm(s @ t)
    if not np.isfinite(root).all():
        offset = 1e-6 * np.eye(len(s))
        root = sqrtm((s + offset) @ (t + offset))
    difference = x.mean(0) - y.mean(0)
    return difference @ difference + np.trace(s) + np.trace(t) - 2 * np.trace(root).real


def kernel(x, y):
    return (x @ y.T / x.shape[1] + 1) ** 3


def mmd(x, y):
    """Unbiased squared MMD of all samples, as in the definition: sums over pairs of different samples."""
    n, m = len(x), len(y)
    xx, yy = kernel(x, x), kernel(y, y)
    within = (xx.sum() - np.trace(xx)) / (n * (n - 1)) + (yy.sum() - np.trace(yy)) / (m * (m - 1))
    return within - 2 * kernel(x, y).mean()


def case(n, m, dimension):
    x, y = (features(which, rows, dimension).astype(np.float64) for which, rows in ((0, n), (1, m)))
    return {
        "n": n,
        "m": m,
        "dimension": dimension,
        "frechet": frechet(x, y),
        "mmd": mmd(x, y),
    }


if __name__ == "__main__":
    print(json.dumps([case(*sizes) for sizes in CASES], indent=1))
