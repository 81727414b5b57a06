"""Trains a small network of your own on a folder of shards: `python examples/train_own_network.py SHARDS`."""

import sys

import torch
from torch import nn

from pix2face.shards import Sample, ShardDataset


def to_batch(samples: list[Sample]) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Pictures (b, 3, h, w) from 0 to 1, PNCC (b, 3, h, w) in mm, masks (b, 1, h, w)."""
    images = torch.stack([torch.from_numpy(sample.image) for sample in samples]).permute(0, 3, 1, 2)
    pncc_mm = torch.stack([torch.from_numpy(sample.layers["pncc"]) for sample in samples]).permute(0, 3, 1, 2)
    return images / 255, pncc_mm, torch.stack([torch.from_numpy(sample.layers["mask"]) for sample in samples])[:, None]


if __name__ == "__main__":
    torch.manual_seed(0)
    dataset = ShardDataset(sys.argv[1], layers=("image", "pncc", "mask"))
    loader = torch.utils.data.DataLoader(dataset, batch_size=8, shuffle=True, num_workers=2, collate_fn=to_batch)
    network = nn.Sequential(nn.Conv2d(3, 16, 5, padding=2), nn.ReLU(), nn.Conv2d(16, 3, 5, padding=2))
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    for epoch in range(10):
        for images, pncc_mm, mask in loader:
            error = ((network(images) - pncc_mm / 100).abs() * mask).sum() / mask.sum() / 3
            optimiser.zero_grad()
            error.backward()
            optimiser.step()
        print(f"epoch {epoch}: {100 * error.item():.1f} mm")
