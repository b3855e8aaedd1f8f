"""Features of a narrow Inception with weights by rule, in double precision by PyTorch.

    pip install torch
    python inception.py > inception.json
"""

import json

import torch
import torch.nn.functional as F
from rule import pictures, tensor

NARROWED = 16
# Pictures to enlarge and to shrink: height and width.
SIZES = [(40, 56), (400, 330)]


def unit(x, name, outputs, kernel, stride=1, padding=0):
    """Convolution, batch normalisation, rectifier."""
    kernel = kernel if isinstance(kernel, tuple) else (kernel, kernel)
    outputs //= NARROWED
    x = F.conv2d(x, tensor(f"{name}.conv.weight", (outputs, x.shape[1], *kernel)), None, stride, padding)
    gamma, beta, mean, variance = (
        tensor(f"{name}.bn.{part}", (outputs,)) for part in ("weight", "bias", "running_mean", "running_var")
    )
    return F.relu(F.batch_norm(x, mean, variance, gamma, beta, eps=1e-3))


def mean_pool(x):
    return F.avg_pool2d(x, 3, 1, 1, count_include_pad=False)


def row(x, name, outputs, width):
    return unit(x, name, outputs, (1, width), 1, (0, width // 2))


def column(x, name, outputs, height):
    return unit(x, name, outputs, (height, 1), 1, (height // 2, 0))


def block_a(x, at, pool):
    five = unit(unit(x, f"{at}.branch5x5_1", 48, 1), f"{at}.branch5x5_2", 64, 5, 1, 2)
    three = unit(unit(x, f"{at}.branch3x3dbl_1", 64, 1), f"{at}.branch3x3dbl_2", 96, 3, 1, 1)
    three = unit(three, f"{at}.branch3x3dbl_3", 96, 3, 1, 1)
    return torch.cat([unit(x, f"{at}.branch1x1", 64, 1), five, three, unit(mean_pool(x), f"{at}.branch_pool", pool, 1)], 1)


def block_b(x, at):
    long = unit(unit(x, f"{at}.branch3x3dbl_1", 64, 1), f"{at}.branch3x3dbl_2", 96, 3, 1, 1)
    long = unit(long, f"{at}.branch3x3dbl_3", 96, 3, 2)
    return torch.cat([unit(x, f"{at}.branch3x3", 384, 3, 2), long, F.max_pool2d(x, 3, 2)], 1)


def block_c(x, at, inner):
    short = row(unit(x, f"{at}.branch7x7_1", inner, 1), f"{at}.branch7x7_2", inner, 7)
    short = column(short, f"{at}.branch7x7_3", 192, 7)
    long = column(unit(x, f"{at}.branch7x7dbl_1", inner, 1), f"{at}.branch7x7dbl_2", inner, 7)
    long = column(row(long, f"{at}.branch7x7dbl_3", inner, 7), f"{at}.branch7x7dbl_4", inner, 7)
    long = row(long, f"{at}.branch7x7dbl_5", 192, 7)
    return torch.cat([unit(x, f"{at}.branch1x1", 192, 1), short, long, unit(mean_pool(x), f"{at}.branch_pool", 192, 1)], 1)


def block_d(x, at):
    short = unit(unit(x, f"{at}.branch3x3_1", 192, 1), f"{at}.branch3x3_2", 320, 3, 2)
    long = row(unit(x, f"{at}.branch7x7x3_1", 192, 1), f"{at}.branch7x7x3_2", 192, 7)
    long = unit(column(long, f"{at}.branch7x7x3_3", 192, 7), f"{at}.branch7x7x3_4", 192, 3, 2)
    return torch.cat([short, long, F.max_pool2d(x, 3, 2)], 1)


def block_e(x, at, pooled):
    short = unit(x, f"{at}.branch3x3_1", 384, 1)
    long = unit(unit(x, f"{at}.branch3x3dbl_1", 448, 1), f"{at}.branch3x3dbl_2", 384, 3, 1, 1)
    parts = [unit(x, f"{at}.branch1x1", 320, 1)]
    parts += [row(short, f"{at}.branch3x3_2a", 384, 3), column(short, f"{at}.branch3x3_2b", 384, 3)]
    parts += [row(long, f"{at}.branch3x3dbl_3a", 384, 3), column(long, f"{at}.branch3x3dbl_3b", 384, 3)]
    return torch.cat([*parts, unit(pooled, f"{at}.branch_pool", 192, 1)], 1)


def features(x):
    x = unit(unit(x, "Conv2d_1a_3x3", 32, 3, 2), "Conv2d_2a_3x3", 32, 3)
    x = F.max_pool2d(unit(x, "Conv2d_2b_3x3", 64, 3, 1, 1), 3, 2)
    x = F.max_pool2d(unit(unit(x, "Conv2d_3b_1x1", 80, 1), "Conv2d_4a_3x3", 192, 3), 3, 2)
    for at, pool in (("5b", 32), ("5c", 64), ("5d", 64)):
        x = block_a(x, f"Mixed_{at}", pool)
    x = block_b(x, "Mixed_6a")
    for at, inner in (("6b", 128), ("6c", 160), ("6d", 160), ("6e", 192)):
        x = block_c(x, f"Mixed_{at}", inner)
    x = block_d(x, "Mixed_7a")
    x = block_e(x, "Mixed_7b", mean_pool(x))
    x = block_e(x, "Mixed_7c", F.max_pool2d(x, 3, 1, 1))
    return x.mean((2, 3))[0]


def pytorch_fid(picture):
    return 2 * F.interpolate(picture, (299, 299), mode="bilinear", align_corners=False) - 1


def case(index, height, width):
    picture = pictures(2, height, width)[index : index + 1]
    return {
        "picture": index,
        "height": height,
        "width": width,
        "pytorch_fid": features(pytorch_fid(picture)).tolist(),
    }


if __name__ == "__main__":
    print(json.dumps([case(index, *size) for index, size in enumerate(SIZES)], indent=1))
