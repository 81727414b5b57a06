"""How long it takes to develop a photograph, by preset: processor time of one core.

python -m tests.benchmarks.developing [--size 256] [--n 400]
"""

import time
from collections import defaultdict

import cv2
import numpy as np

from datagen.appearance.photograph.faults import draw_photograph
from datagen.appearance.photograph.photograph import develop, encode
from datagen.appearance.photograph.photograph_config import HARD_PHOTOGRAPH, PhotographConfig
from tests.benchmarks.measuring import options_parser, write_report


def main() -> None:
    parser = options_parser(__doc__)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--n", type=int, default=400)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    presets = {"default": PhotographConfig(), "hard": HARD_PHOTOGRAPH}
    report = {name: measure(config, options.size, options.n) for name, config in presets.items()}
    write_report({"size_px": options.size, "n": options.n, **report}, options.out)


def measure(config: PhotographConfig, size_px: int, n: int) -> dict[str, object]:
    """Milliseconds of developing and encoding, by what pictures are bad in, and bytes of a file."""
    rng = np.random.default_rng(0)
    coarse = rng.uniform(0, 1, (size_px // 16, size_px // 16, 3)).astype(np.float32)
    light = cv2.resize(coarse, (size_px, size_px), interpolation=cv2.INTER_LINEAR)
    face = np.zeros((size_px, size_px), dtype=bool)
    face[size_px // 4 : -size_px // 4, size_px // 4 : -size_px // 4] = True
    developing, encoding, n_bytes = defaultdict(list), [], []
    for _ in range(n):
        photograph = draw_photograph(rng, config)
        start = time.process_time()
        image = develop(light, photograph, face)
        middle = time.process_time()
        n_bytes.append(len(encode(image, photograph)))
        developing[photograph.faults or "decent"].append(1e3 * (middle - start))
        encoding.append(1e3 * (time.process_time() - middle))
    everything = np.concatenate(list(developing.values()))
    single = {name: round(float(np.mean(ms)), 2) for name, ms in sorted(developing.items()) if "+" not in name}
    return {
        "develop_ms": round(float(everything.mean()), 2),
        "develop_95_percent_ms": round(float(np.percentile(everything, 95)), 2),
        "encode_ms": round(float(np.mean(encoding)), 2),
        "file_bytes": round(float(np.mean(n_bytes))),
        "develop_ms_by_fault": single,
    }


if __name__ == "__main__":
    main()
