// From the box of a face to its maps, camera and landmarks, as pix2face/inference and pix2face/fitting do, in short:
// landmarks are read off the maps, and no coefficients are fitted.

import { overlap } from "./detector.js";
import { resampled } from "./picture.js";

const LEAST_PIXELS = 100; // with fewer, there is no face in the crop

// The faces of some boxes, without those in which the network finds no face. Each box is corrected by the landmarks of
// a first prediction. `report` is told the number of the face.
export async function readFaces(picture, boxes, predict, settings, report) {
  const faces = [];
  for (const [index, { box, score }] of boxes.entries()) {
    await report(index);
    const first = await readFace(picture, box, predict, settings);
    const better = first && boxAround(first.points);
    const isFace = first && isPlausible(first, settings) && overlap(better, box) >= settings.plausible_overlap;
    const knows = settings.planes > settings.seen_plane; // whether the network can tell that there is no face
    if (!first || (knows && !isFace)) continue;
    const face = isFace ? await readFace(picture, better, predict, settings) : first;
    const isDouble = face && faces.some((other) => overlap(other.box, face.box) > settings.plausible_overlap);
    if (face && !isDouble) faces.push({ ...face, score });
  }
  return faces.sort((a, b) => longerSide(b.box) - longerSide(a.box));
}

// What the network predicts for the face in a box; null where it finds too little of a face.
async function readFace(picture, box, predict, settings) {
  const size = settings.size_px;
  const side = settings.crop_scale * longerSide(box);
  const left = (box.left + box.right - side) / 2;
  const top = (box.top + box.bottom - side) / 2;
  const crop = { left, top, stepX: side / size, stepY: side / size };
  const outputs = await predict(resampled(picture, crop, size, size, 0), size, size);
  const maps = readMaps(outputs[settings.output].data, settings);
  if (maps.pixels.length < LEAST_PIXELS) return null;
  const camera = fitCamera(maps, crop, size);
  if (!camera) return null;
  const landmarks = landmarksOfMaps(maps, camera, crop, settings);
  const predicted = outputs[settings.landmarks_output]; // of a network that predicts them, too
  const points = predicted ? predictedPoints(predicted.data, crop, side) : landmarks;
  const expectedError = predicted ? (settings.error_of_scale * meanScale(predicted.data) * side) / sizeOf(points) : null;
  return { box, crop, maps, landmarks, points, expectedError, residualMm: residualMm(maps, camera, crop, size) };
}

// As pix2face/photographs/refined_detection.py decides.
const isPlausible = ({ expectedError, residualMm }, settings) =>
  expectedError === null ? residualMm <= settings.plausible_mm : expectedError <= settings.plausible_error;

// The landmarks that the network predicts itself: x and y from the middle of the crop, in units of its side, and a third
// number for each. Those of the maps are more exact, but these are enough for a box.
const predictedPoints = (values, crop, side) =>
  Array.from({ length: values.length / 3 }, (_, i) => ({
    x: crop.left + (values[3 * i] + 0.5) * side,
    y: crop.top + (values[3 * i + 1] + 0.5) * side,
  }));

// Mean scale of the errors that the network expects of its landmarks, in units of the crop's side: the third number of
// each is its logarithm.
function meanScale(values) {
  const scales = values.filter((_, i) => i % 3 === 2).map(Math.exp);
  return scales.reduce((sum, scale) => sum + scale, 0) / scales.length;
}

function sizeOf(landmarks) {
  const { left, top, right, bottom } = boxAround(landmarks);
  return Math.sqrt((right - left) * (bottom - top));
}

// PNCC and offset in mm (x, y, z of each pixel), the mask, its visible part, and the indices of the mask's pixels.
function readMaps(planes, settings) {
  const size = settings.size_px;
  const n = size * size;
  const plane = (index) => planes.subarray(index * n, (index + 1) * n);
  const interleaved = (start, scale) =>
    Float32Array.from({ length: 3 * n }, (_, i) => scale * planes[(start + (i % 3)) * n + Math.floor(i / 3)]);
  const pncc = interleaved(0, settings.pncc_scale_mm);
  const offset = interleaved(3, settings.offset_scale_mm);
  const isFace =
    settings.planes > settings.mask_plane
      ? Uint8Array.from(plane(settings.mask_plane), (logit) => logit > 0)
      : Uint8Array.from({ length: n }, (_, i) => length(pncc, i) > settings.smallest_radius_mm / 2);
  const mask = eroded(isFace, size).map((inside, i) => inside && Number.isFinite(length(pncc, i) + length(offset, i)));
  const knowsSeen = settings.planes > settings.seen_plane;
  const seen = knowsSeen ? mask.map((inside, i) => inside && planes[settings.seen_plane * n + i] > 0) : mask;
  const pixels = [];
  mask.forEach((inside, i) => inside && pixels.push(i));
  return { pncc, offset, mask, seen, pixels };
}

const length = (vectors, i) => Math.hypot(vectors[3 * i], vectors[3 * i + 1], vectors[3 * i + 2]);

// Removes the outermost pixels of a mask; the border of the picture is no border of the face.
function eroded(mask, size) {
  const at = (row, column) => mask[clamped(row, size) * size + clamped(column, size)];
  return mask.map((inside, i) => {
    const [row, column] = [Math.floor(i / size), i % size];
    return inside && [-1, 0, 1].every((down) => [-1, 0, 1].every((right) => at(row + down, column + right)));
  });
}

const clamped = (index, size) => Math.min(Math.max(index, 0), size - 1);

// The affine camera (two rows of four numbers, from mm to pixels of the picture) that projects the point of each pixel,
// PNCC plus offset, nearest to the pixel: linear least squares by normal equations (Eq. 1 of the paper).
function fitCamera(maps, crop, size) {
  const rows = [0, 1, 2, 3].map(() => new Float64Array(6)); // four unknowns, and two right-hand sides
  for (const i of maps.pixels) {
    const values = [...pointOf(maps, i), 1, ...centreOf(i, crop, size)];
    for (let r = 0; r < 4; r++) for (let c = 0; c < 6; c++) rows[r][c] += values[r] * values[c];
  }
  for (let pivot = 0; pivot < 4; pivot++) {
    rows.push(...rows.splice(pivot).sort((a, b) => Math.abs(b[pivot]) - Math.abs(a[pivot])));
    const divisor = rows[pivot][pivot];
    if (!(Math.abs(divisor) > 1e-6)) return null; // the points are in one plane
    rows[pivot] = rows[pivot].map((value) => value / divisor);
    for (let r = 0; r < 4; r++) {
      const share = rows[r][pivot];
      if (r !== pivot) rows[r] = rows[r].map((value, c) => value - share * rows[pivot][c]);
    }
  }
  return [4, 5].map((c) => rows.map((row) => row[c]));
}

const pointOf = ({ pncc, offset }, i) => [0, 1, 2].map((axis) => pncc[3 * i + axis] + offset[3 * i + axis]);

const centreOf = (i, crop, size) => [
  crop.left + ((i % size) + 0.5) * crop.stepX,
  crop.top + (Math.floor(i / size) + 0.5) * crop.stepY,
];

const projected = (camera, [x, y, z]) => camera.map(([a, b, c, d]) => a * x + b * y + c * z + d);

// The landmarks {x, y, isSeen}: for each vertex of the mean face, the pixel whose PNCC is nearest (Eq. 2), and from there
// the step to the vertex itself, which is short unless the vertex is hidden.
function landmarksOfMaps(maps, camera, crop, settings) {
  return settings.landmarks_mm.map((vertex) => {
    const { pixel, distanceMm } = nearestPixel(maps, vertex);
    const [u, v] = centreOf(pixel, crop, settings.size_px);
    const step = vertex.map((value, axis) => value - maps.pncc[3 * pixel + axis]);
    const [x, y] = camera.map((row) => row[0] * step[0] + row[1] * step[1] + row[2] * step[2]);
    return { x: u + x, y: v + y, isSeen: distanceMm <= settings.seen_mm && Boolean(maps.seen[pixel]) };
  });
}

function nearestPixel({ pncc, pixels }, [x, y, z]) {
  let [pixel, least] = [-1, Infinity];
  for (const i of pixels) {
    const squared = (pncc[3 * i] - x) ** 2 + (pncc[3 * i + 1] - y) ** 2 + (pncc[3 * i + 2] - z) ** 2;
    if (squared < least) [pixel, least] = [i, squared];
  }
  return { pixel, distanceMm: Math.sqrt(least) };
}

// How badly the maps fit a face: the median distance of the pixels from where the camera projects their points, in mm.
function residualMm(maps, camera, crop, size) {
  const distances = maps.pixels.map((i) => {
    const [x, y] = projected(camera, pointOf(maps, i));
    const [u, v] = centreOf(i, crop, size);
    return Math.hypot(x - u, y - v);
  });
  distances.sort((a, b) => a - b);
  const pxPerMm = Math.hypot(...camera[0].slice(0, 3), ...camera[1].slice(0, 3)) / Math.SQRT2;
  return distances[Math.floor(distances.length / 2)] / pxPerMm;
}

function boxAround(points) {
  const [xs, ys] = [points.map(({ x }) => x), points.map(({ y }) => y)];
  return { left: Math.min(...xs), top: Math.min(...ys), right: Math.max(...xs), bottom: Math.max(...ys) };
}

const longerSide = (box) => Math.max(box.right - box.left, box.bottom - box.top);
