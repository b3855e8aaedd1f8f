#!/usr/bin/env python3
"""Measures a training step of the authors' network in PyTorch, for comparison with `infonerf bench step --preset released`.

The step trains two NeRF networks (8 layers of 256, Mildenhall et al. 2020, Fig. 7) by Adam on 1,024 rays of training images and 1,024
unseen rays, with 64 coarse and 64 + 128 fine samples each. The loss is the squared error of the seen rays and the entropy of the
unseen ones. The script prints the median time over the steps, with float32 and with TF32 products.

    scripts/peer-step.py [STEPS]
"""

import statistics
import sys
import time

import torch
from torch import nn

RAYS, COARSE, FINE = 1024, 64, 128
NEAR, FAR = 2.0, 6.0


def encode(x, frequencies):
    scaled = x[..., None] * 2.0 ** torch.arange(frequencies, device=x.device)
    return torch.cat([x, torch.sin(scaled).flatten(-2), torch.cos(scaled).flatten(-2)], -1)


class Nerf(nn.Module):
    def __init__(self, width=256):
        super().__init__()
        inputs = [63] + [width] * 4 + [width + 63] + [width] * 2
        self.layers = nn.ModuleList(nn.Linear(i, width) for i in inputs)
        self.sigma, self.feature = nn.Linear(width, 1), nn.Linear(width, width)
        self.view, self.color = nn.Linear(width + 27, width // 2), nn.Linear(width // 2, 3)

    def forward(self, points, directions):
        encoded = encode(points, 10)
        h = encoded
        for index, layer in enumerate(self.layers):
            h = torch.relu(layer(torch.cat([encoded, h], -1) if index == 5 else h))
        view = encode(directions, 4)[:, None].expand(*points.shape[:2], -1)
        color = self.color(torch.relu(self.view(torch.cat([self.feature(h), view], -1))))
        return torch.relu(self.sigma(h))[..., 0], torch.sigmoid(color)


def composite(sigma, color, t):
    delta = torch.cat([t[:, 1:] - t[:, :-1], torch.full_like(t[:, :1], 1e10)], 1)
    alpha = 1 - torch.exp(-sigma * delta)
    trans = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1 - alpha + 1e-10], 1), 1)[:, :-1]
    weights = alpha * trans
    return (weights[..., None] * color).sum(1) + 1 - weights.sum(1, keepdim=True), weights, alpha


def importance(t, weights):
    middle = 0.5 * (t[:, 1:] + t[:, :-1])
    pdf = weights[:, 1:-1] + 1e-5
    cdf = torch.cumsum(pdf / pdf.sum(1, keepdim=True), 1)
    cdf = torch.cat([torch.zeros_like(cdf[:, :1]), cdf], 1)
    u = torch.rand(t.shape[0], FINE, device=t.device)
    above = torch.searchsorted(cdf, u, right=True).clamp(max=cdf.shape[1] - 1)
    below = (above - 1).clamp(min=0)
    low, high = cdf.gather(1, below), cdf.gather(1, above)
    share = (u - low) / torch.where(high - low < 1e-5, torch.ones_like(low), high - low)
    drawn = middle.gather(1, below) + share * (middle.gather(1, above) - middle.gather(1, below))
    return torch.cat([t, drawn], 1).sort(1).values


def entropy(alpha):
    total = alpha.sum(1, keepdim=True)
    p = alpha / (total + 1e-10)
    return ((total[:, 0] > 0.1) * -(p * torch.log2(p + 1e-10)).sum(1)).mean()


def step(networks, optimizer):
    device = next(networks.parameters()).device
    origins = nn.functional.normalize(torch.randn(2 * RAYS, 3, device=device), dim=1) * 4
    directions = nn.functional.normalize(torch.randn(2 * RAYS, 3, device=device) * 0.3 - origins / 4, dim=1)
    target = torch.rand(RAYS, 3, device=device)
    even = torch.linspace(NEAR, FAR, COARSE, device=device)
    t = even + torch.rand(2 * RAYS, COARSE, device=device) * (FAR - NEAR) / COARSE
    loss = 0.0
    for index, network in enumerate(networks):
        sigma, color = network(origins[:, None] + directions[:, None] * t[..., None], directions)
        rgb, weights, alpha = composite(sigma, color, t)
        loss = loss + ((rgb[:RAYS] - target) ** 2).mean() + 1e-3 * entropy(alpha[RAYS:])
        if index == 0:
            t = importance(t, weights.detach())
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    return loss


def main():
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    name = torch.cuda.get_device_name()
    for precision in ["highest", "high"]:
        torch.set_float32_matmul_precision(precision)
        networks = nn.ModuleList([Nerf(), Nerf()]).cuda()
        optimizer = torch.optim.Adam(networks.parameters(), lr=5e-4)
        seconds = []
        for _ in range(10 + steps):
            torch.cuda.synchronize()
            start = time.perf_counter()
            step(networks, optimizer)
            torch.cuda.synchronize()
            seconds.append(time.perf_counter() - start)
        product = "float32" if precision == "highest" else "TF32"
        print(f"PyTorch {torch.__version__} on {name}, {product} products: {1e3 * statistics.median(seconds[10:]):.2f} ms a step")


main()
