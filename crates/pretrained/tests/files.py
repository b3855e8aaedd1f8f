"""PyTorch files of LPIPS heads by rule: as PyTorch saves them now, and as it did before 1.6.

    pip install torch
    python files.py
"""

import torch
from rule import tensor

CHANNELS = [64, 192, 384, 256, 256]

state = {f"lin{i}.model.1.weight": tensor(f"lin{i}.model.1.weight", (1, c, 1, 1)).float() for i, c in enumerate(CHANNELS)}
torch.save(state, "heads.pth")
torch.save(state, "heads_legacy.pth", _use_new_zipfile_serialization=False)
