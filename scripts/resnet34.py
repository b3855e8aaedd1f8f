"""Writes torchvision's ResNet-34 with ImageNet weights as safetensors, for `field.encoder.weights`.

    pip install torchvision safetensors
    python scripts/resnet34.py resnet34.safetensors [resnet34-b627a593.pth]

Without a .pth file torchvision downloads the weights.
"""

import sys

import torch
import torchvision
from safetensors.torch import save_file

if len(sys.argv) > 2:
    weights = torch.load(sys.argv[2], map_location="cpu", weights_only=True)
else:
    weights = torchvision.models.resnet34(weights="IMAGENET1K_V1").state_dict()
save_file({name: tensor.contiguous() for name, tensor in weights.items()}, sys.argv[1])
