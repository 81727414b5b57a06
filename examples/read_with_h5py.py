"""Reads one sample of a shard with h5py and NumPy alone: `python examples/read_with_h5py.py SHARD [INDEX]`.

docs/reference/file_formats.md lists the datasets. Nothing of pix2face is needed.
"""

import json
import sys

import h5py
import numpy as np


def read_layer(file: h5py.File, name: str, index: int) -> np.ndarray:
    """A layer in its unit (mm for pncc, offset and depth)."""
    dataset = file[f"{name}_coded" if f"{name}_coded" in file else name]
    steps = dataset[index]
    if dataset.attrs["predictor"] == b"planar":  # each value is stored less its neighbours, its sign in the lowest bit
        kind = f"i{steps.itemsize}"
        signed = ((steps >> 1) ^ -(steps & 1)).view(kind)
        steps = signed.cumsum(0, dtype=kind).cumsum(1, dtype=kind)
    return steps / dataset.attrs["steps_per_unit"]


if __name__ == "__main__":
    index = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    with h5py.File(sys.argv[1]) as file:
        height, width = file["size_px"][index]  # layers are padded to the largest picture of the shard
        pncc_mm = read_layer(file, "pncc", index)[:height, :width]
        mask = read_layer(file, "mask", index)[:height, :width] > 0
        jpeg_or_png = file["image"][index, : file["image_length"][index]].tobytes()
        print(file["sample_id"][index].decode(), json.loads(file["attributes"][index])["picture"])
    print(f"{width} x {height} px, a picture of {len(jpeg_or_png)} bytes, a face of {mask.sum()} pixels")
    print("mean of PNCC in mm:", pncc_mm[mask].mean(axis=0).round(3).tolist())
