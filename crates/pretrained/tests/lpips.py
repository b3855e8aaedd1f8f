"""Distances of LPIPS with narrow backbones and weights by rule, in double precision by PyTorch.

    pip install torch
    python lpips.py > lpips.json
"""

import json

import torch
import torch.nn.functional as F
from rule import pictures, tensor

NARROWED = 8
# Pairs of pictures: height and width.
SIZES = [(64, 64), (50, 71), (33, 95)]
SHIFT, SCALE = [-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]

# Convolutions as (kernel, stride, padding, channels, whether its output is compared), None where pictures are pooled.
ALEX = [
    (11, 4, 2, 64, True), None, (5, 1, 2, 192, True), None,
    (3, 1, 1, 384, True), (3, 1, 1, 256, True), (3, 1, 1, 256, True),
]
VGG = [
    (3, 1, 1, channels, compared) if channels else None
    for channels, compared in [
        (64, False), (64, True), (None, None), (128, False), (128, True), (None, None),
        (256, False), (256, False), (256, True), (None, None),
        (512, False), (512, False), (512, True), (None, None),
        (512, False), (512, False), (512, True),
    ]
]


def features(x, layers, pool):
    place, inputs, compared = 0, 3, []
    for layer in layers:
        if layer is None:
            x, place = F.max_pool2d(x, pool, 2), place + 1
            continue
        kernel, stride, padding, channels, is_compared = layer
        channels //= NARROWED
        weight = tensor(f"features.{place}.weight", (channels, inputs, kernel, kernel))
        bias = tensor(f"features.{place}.bias", (channels,))
        x, place, inputs = F.relu(F.conv2d(x, weight, bias, stride, padding)), place + 2, channels
        if is_compared:
            compared.append(x)
    return compared


def lpips(x, y, layers, pool):
    def unit(maps):
        return maps / (maps.square().sum(1, keepdim=True).sqrt() + 1e-10)

    def scaled(image):
        return (image - torch.tensor(SHIFT).double().view(1, 3, 1, 1)) / torch.tensor(SCALE).double().view(1, 3, 1, 1)

    total = 0
    pairs = zip(features(scaled(x), layers, pool), features(scaled(y), layers, pool))
    for head, (a, b) in enumerate(pairs):
        weight = tensor(f"lin{head}.model.1.weight", (1, a.shape[1], 1, 1))
        total = total + ((unit(a) - unit(b)).square() * weight).sum(1).mean((1, 2))
    return total.item()


def case(height, width):
    x, y = pictures(2, height, width).split(1)
    values = {"height": height, "width": width}
    for name, layers, pool in (("alex", ALEX, 3), ("vgg", VGG, 2)):
        values[name] = lpips(2 * x - 1, 2 * y - 1, layers, pool)
        values[f"{name}_unsigned"] = lpips(x, y, layers, pool)
    return values


if __name__ == "__main__":
    print(json.dumps([case(*size) for size in SIZES], indent=1))
