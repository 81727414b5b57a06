"""Runs the networks of `pix2face export` with onnxruntime, NumPy and OpenCV alone: the surest face of a photograph.

python examples/run_onnx.py network.onnx detector.onnx PHOTO [PICTURE]

docs/reference/file_formats.md describes inputs and outputs. Nothing of pix2face is needed.
"""

import json
import sys

import cv2
import numpy as np
import onnxruntime

LONGEST_SIDE_PX, CELL_PX, MULTIPLE_PX = 240, 8, 32


def surest_face(session: onnxruntime.InferenceSession, rgb: np.ndarray) -> tuple[float, np.ndarray]:
    """The score of a face, sure from 1 on, and its box (left, top, right, bottom) in pixels of the picture."""
    scale = LONGEST_SIDE_PX / max(rgb.shape[:2])
    small = cv2.resize(rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    height, width = (-(-side // MULTIPLE_PX) * MULTIPLE_PX for side in small.shape[:2])
    padded = np.full((height, width, 3), 128, np.uint8)
    padded[: small.shape[0], : small.shape[1]] = small
    (cells,) = session.run(None, {"pictures": as_input(padded)})
    row, column = np.unravel_index(cells[0, 0].argmax(), cells.shape[2:])
    logit, right, down, log_width, log_height = cells[0, :, row, column]
    centre = CELL_PX * (np.array([column, row]) + 0.5 + (right, down))
    half = CELL_PX * np.exp([log_width, log_height]) / 2
    return 1 / (1 + np.exp(-logit)) / 0.4, np.hstack([centre - half, centre + half]) / scale


def read_face(session: onnxruntime.InferenceSession, rgb: np.ndarray, box: np.ndarray) -> dict[str, np.ndarray]:
    """PNCC and offset (mm), the mask, and landmarks in pixels of the picture (x right, y down) with their errors."""
    header = json.loads(session.get_modelmeta().custom_metadata_map["pix2face-checkpoint"])
    size_px = header["size_px"]
    # A square around the centre of the box, several times as large as its longer side.
    pixel = header["crop_scale"] * max(box[2] - box[0], box[3] - box[1]) / size_px
    corner = (box[:2] + box[2:]) / 2 - pixel * size_px / 2
    factor = max(1, int(pixel))  # large photographs are averaged first
    small = cv2.resize(rgb, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    step, start = pixel / factor, corner / factor
    # OpenCV puts the centres of pixels at integers; everywhere else, the first one is at (0.5, 0.5).
    from_crop = np.array([[step, 0, start[0] + step / 2 - 0.5], [0, step, start[1] + step / 2 - 0.5]])
    crop = cv2.warpAffine(small, from_crop, (size_px, size_px), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    maps, landmarks = session.run(["maps", "landmarks"], {"image": as_input(crop)})
    planes = maps[0].transpose(1, 2, 0)
    return {
        "crop": crop,
        "pncc_mm": planes[..., :3] * header["pncc_scale_mm"],
        "offset_mm": planes[..., 3:6] * header["offset_scale_mm"],
        "mask": cv2.erode(np.uint8(planes[..., 6] > 0), np.ones((3, 3)), borderType=cv2.BORDER_REPLICATE) > 0,
        "landmarks_px": corner + pixel * size_px * (landmarks[0, :, :2] + 0.5),
        "errors_px": 2 * pixel * size_px * np.exp(landmarks[0, :, 2]),
    }


def as_input(rgb: np.ndarray) -> np.ndarray:
    """A picture as both networks take it."""
    return np.float32(rgb.transpose(2, 0, 1)[None]) / 255 - np.float32(0.5)


if __name__ == "__main__":
    network, detector = (onnxruntime.InferenceSession(path) for path in sys.argv[1:3])
    picture = cv2.imread(sys.argv[3])
    photograph = np.ascontiguousarray(picture[..., ::-1])
    score, box = surest_face(detector, photograph)
    print("score", round(float(score), 2), "box", box.round(1).tolist())
    face = read_face(network, photograph, box)
    print("mean of PNCC in mm:", face["pncc_mm"][face["mask"]].mean(axis=0).round(1).tolist())
    print("expected error of a landmark:", round(float(face["errors_px"].mean()), 1), "px")
    for x, y in face["landmarks_px"]:
        cv2.circle(picture, (int(x), int(y)), 2, (60, 255, 60), -1)
    cv2.imwrite(sys.argv[4] if len(sys.argv) > 4 else "landmarks.png", picture)
