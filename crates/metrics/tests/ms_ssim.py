"""Reference values of MS-SSIM, made with SciPy and NumPy.

    pip install scikit-image
    python ms_ssim.py > ms_ssim.json
"""

import json

import numpy as np
from reference import images
from scipy.ndimage import correlate1d

SIZES = [(161, 176), (230, 173)]
WEIGHTS = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333]


def filtered(image):
    """Gaussian, 11 x 11, sigma 1.5, only where the window is inside."""
    taps = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    taps /= taps.sum()
    return correlate1d(correlate1d(image, taps, axis=0), taps, axis=1)[5:-5, 5:-5]


def terms(x, y):
    """Mean of SSIM, and of its factor of contrast and structure."""
    c1, c2 = 0.01**2, 0.03**2
    mx, my = filtered(x), filtered(y)
    vx, vy, cov = filtered(x * x) - mx * mx, filtered(y * y) - my * my, filtered(x * y) - mx * my
    contrast = (2 * cov + c2) / (vx + vy + c2)
    return np.mean(contrast * (2 * mx * my + c1) / (mx**2 + my**2 + c1)), np.mean(contrast)


def halved(image):
    height, width = image.shape
    even = np.pad(image, ((0, height % 2), (0, width % 2)), mode="edge")
    return (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]) / 4


def ms_ssim(x, y):
    factors = []
    for _ in WEIGHTS:
        factors.append(terms(x, y))
        x, y = halved(x), halved(y)
    chosen = [contrast for _, contrast in factors[:-1]] + [factors[-1][0]]
    return np.prod([max(factor, 0) ** weight for factor, weight in zip(chosen, WEIGHTS)])


def case(width, height):
    render, truth = images(width, height)
    values = [ms_ssim(render[..., channel], truth[..., channel]) for channel in range(3)]
    return {"width": width, "height": height, "ms_ssim": np.mean(values)}


if __name__ == "__main__":
    print(json.dumps([case(*size) for size in SIZES], indent=1))
