"""Reference values of the image metrics, made with scikit-image and NumPy.

    pip install scikit-image
    python reference.py > reference.json

The images follow an integer rule, so that `reference.rs` can make the same ones without storing them.
"""

import json

import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

SIZES = [(11, 11), (16, 13), (37, 24), (48, 64)]


def images(width, height):
    y, x, c = np.mgrid[0:height, 0:width, 0:3]
    truth = (3 * x * x + 5 * y * y + x * y * (c + 1)) // 4 % 256
    render = 3 * truth // 4 + (5 * x + 3 * y + 11 * c) % 64
    return render / 255.0, truth / 255.0


def luma(image):
    return image @ np.array([0.299, 0.587, 0.114])


def mean_gradient(image):
    return np.mean(np.hypot(*np.gradient(luma(image))))


def mask(width, height):
    y, x = np.mgrid[0:height, 0:width]
    return (3 * x + 2 * y) % 7 < 3


def gaussian_ssim(render, truth):
    return structural_similarity(
        truth,
        render,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        channel_axis=-1,
        data_range=1,
    )


def case(width, height):
    render, truth = images(width, height)
    inside = mask(width, height)
    white = [np.where(inside[..., None], image, 1.0) for image in (render, truth)]
    return {
        "width": width,
        "height": height,
        "psnr": peak_signal_noise_ratio(truth, render, data_range=1),
        "psnr_masked": peak_signal_noise_ratio(truth[inside], render[inside], data_range=1),
        "ssim": gaussian_ssim(render, truth),
        "ssim_masked": gaussian_ssim(*white),
        "ssim_uniform": structural_similarity(truth, render, channel_axis=-1, data_range=1),
        "ssim_uniform_range_2": structural_similarity(truth, render, channel_axis=-1, data_range=2),
        "sharpness": mean_gradient(render) / mean_gradient(truth),
    }


if __name__ == "__main__":
    print(json.dumps([case(*size) for size in SIZES], indent=1))
