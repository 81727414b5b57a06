// From the box of a face to its maps, camera and landmarks, as pix2face/inference and pix2face/fitting do, in short: no
// coefficients are fitted.

import { overlap } from "./detector.js";
import { resampled } from "./picture.js";

const LEAST_PIXELS = 100; // with fewer, there is no face in the crop

// The faces of some boxes, without those in which the network finds no face. Each box is corrected by the landmarks of
// a first look, as pix2face/photographs/refined_detection.py does. `report` is told the number of the face.
export async function readFaces(picture, boxes, halves, settings, report) {
  const faces = [];
  for (const [index, { box, score }] of boxes.entries()) {
    await report(index);
    const first = await firstLook(picture, box, halves, settings);
    const isFace = first && first.isPlausible && overlap(first.better, box) >= settings.plausible_overlap;
    if (!first || (first.canRefute && !isFace)) continue;
    const look = await encoded(picture, isFace ? first.better : box, halves, settings);
    const face = await readFace(look, halves, settings);
    const isDouble = face && faces.some((other) => overlap(other.box, face.box) > settings.plausible_overlap);
    if (face && !isDouble) faces.push({ ...face, score });
  }
  return faces.sort((a, b) => longerSide(b.box) - longerSide(a.box));
}

// The better box, around the landmarks that the network predicts itself, for which its first half is enough, or around
// those of its maps; whether it is that of a face; and whether the network can tell that it is not.
async function firstLook(picture, box, halves, settings) {
  const look = await encoded(picture, box, halves, settings);
  if (!look.outputs[settings.landmarks_output]) {
    const face = await readFace(look, halves, settings);
    if (!face) return null;
    const isPlausible = residualMm(face, settings.size_px) <= settings.plausible_mm;
    return { better: boxAround(face.landmarks), isPlausible, canRefute: settings.planes > settings.seen_plane };
  }
  const landmarks = predictedLandmarks(look, settings);
  const better = boxAround(landmarks);
  const meanScale = landmarks.reduce((sum, { scale }) => sum + scale, 0) / landmarks.length;
  const size = Math.sqrt((better.right - better.left) * (better.bottom - better.top));
  const expectedError = (settings.error_of_scale * meanScale) / size;
  return { better, isPlausible: expectedError <= settings.plausible_error, canRefute: true };
}

// What the whole network predicts for the face in a box that its first half has seen; null where it finds too little of
// a face.
async function readFace(look, halves, settings) {
  const { box, crop, outputs } = look;
  const maps = readMaps((await halves.decode(outputs))[settings.output].data, settings);
  if (maps.pixels.length < LEAST_PIXELS) return null;
  const camera = fitCamera(maps, crop, settings.size_px);
  if (!camera) return null;
  const landmarks = landmarksOfMaps(maps, camera, crop, settings);
  if (settings.mixes_predicted_landmarks) {
    // The errors of the two differ, so the middle is more exact than either (docs/how_to/browser_page.md).
    const predicted = predictedLandmarks(look, settings);
    for (const [i, landmark] of landmarks.entries()) {
      landmark.x = (landmark.x + predicted[i].x) / 2;
      landmark.y = (landmark.y + predicted[i].y) / 2;
    }
  }
  return { box, crop, maps, camera, landmarks };
}

// A box, the part of the picture that the network is shown for it, and what its first half says of that.
async function encoded(picture, box, { encode }, { size_px: size, crop_scale: scale }) {
  const side = scale * longerSide(box);
  const left = (box.left + box.right - side) / 2;
  const top = (box.top + box.bottom - side) / 2;
  const crop = { left, top, stepX: side / size, stepY: side / size };
  return { box, crop, outputs: await encode(resampled(picture, crop, size, size, 0), size, size) };
}

// The landmarks that the network predicts itself, and the scales of the errors that it expects of them, pixels of the
// picture. It answers x and y from the middle of the crop and the logarithm of the scale, in units of the crop's side.
function predictedLandmarks({ crop, outputs }, settings) {
  const { data } = outputs[settings.landmarks_output];
  const side = settings.size_px * crop.stepX;
  return Array.from({ length: data.length / 3 }, (_, i) => ({
    x: crop.left + (data[3 * i] + 0.5) * side,
    y: crop.top + (data[3 * i + 1] + 0.5) * side,
    scale: Math.exp(data[3 * i + 2]) * side,
  }));
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
function residualMm({ maps, camera, crop }, size) {
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
