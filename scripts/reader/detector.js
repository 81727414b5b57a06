// Finds faces as pix2face/detectors does: the network answers for each cell of a small copy of the photograph how surely
// a face has its centre there, and where the face's box is.

import { resampled } from "./picture.js";

// The faces that the detector is sure of, surest first: {box: {left, top, right, bottom}, score}, pixels of the picture.
export async function findFaces(picture, find, settings) {
  for (const longestSide of settings.longest_sides_px) {
    const faces = await findFacesAt(picture, find, settings, longestSide);
    if (faces.length) return faces;
  }
  return [];
}

async function findFacesAt(picture, find, settings, longestSide) {
  const scale = Math.min(longestSide / Math.max(picture.width, picture.height), settings.largest_enlargement);
  const seen = (extent) => Math.max(Math.round(extent * scale), 1);
  const up = (extent) => Math.ceil(extent / settings.multiple) * settings.multiple;
  const step = { x: picture.width / seen(picture.width), y: picture.height / seen(picture.height) };
  const width = up(seen(picture.width));
  const height = up(seen(picture.height));
  const part = { left: 0, top: 0, stepX: step.x, stepY: step.y };
  const outputs = await find(resampled(picture, part, width, height, settings.grey), width, height);
  const { dims, data } = outputs[settings.output];
  const sure = decoded(data, dims[2], dims[3], settings).filter((face) => face.score >= 1);
  const [x, y] = [settings.stride_px * step.x, settings.stride_px * step.y];
  return sure.map(({ box, score }) => ({
    score,
    box: { left: box.left * x, top: box.top * y, right: box.right * x, bottom: box.bottom * y },
  }));
}

// Boxes in cells, one for each face, surest first.
function decoded(planes, rows, columns, settings) {
  const plane = (index, row, column) => planes[(index * rows + row) * columns + column];
  const scoreAt = (row, column) =>
    row < 0 || column < 0 || row >= rows || column >= columns ? 0 : 1 / (1 + Math.exp(-plane(0, row, column)));
  const peaks = [];
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const score = scoreAt(row, column);
      if (score < settings.least_score) continue;
      const around = neighbours(row, column);
      if (around.every(([r, c]) => scoreAt(r, c) <= score)) {
        peaks.push({ box: votedBox(around, plane, scoreAt), score: score / settings.sure_score });
      }
    }
  }
  return withoutDoubles(peaks.sort((a, b) => b.score - a.score), settings);
}

const neighbours = (row, column) =>
  [-1, 0, 1].flatMap((down) => [-1, 0, 1].map((right) => [row + down, column + right]));

// The mean of what a peak and its neighbours say, weighted by their squared scores.
function votedBox(around, plane, scoreAt) {
  const total = [0, 0, 0, 0];
  let weights = 0;
  for (const [row, column] of around) {
    const weight = scoreAt(row, column) ** 2;
    if (weight === 0) continue; // beyond the picture
    const x = column + 0.5 + plane(1, row, column);
    const y = row + 0.5 + plane(2, row, column);
    const half = (index) => Math.exp(Math.min(Math.max(plane(index, row, column), -5), 8)) / 2;
    const sides = [x - half(3), y - half(4), x + half(3), y + half(4)];
    sides.forEach((side, index) => (total[index] += weight * side));
    weights += weight;
  }
  const [left, top, right, bottom] = total.map((side) => side / weights);
  return { left, top, right, bottom };
}

// Leaves out every box that overlaps a surer one too much, or that lies inside it (or the other way round).
function withoutDoubles(faces, settings) {
  const kept = [];
  for (const face of faces) {
    const isDouble = kept.some((other) => {
      const common = commonArea(face.box, other.box);
      const [smaller, larger] = [area(face.box), area(other.box)].sort((a, b) => a - b);
      return common > settings.same_face_overlap * (smaller + larger - common) || common > settings.inside * smaller;
    });
    if (!isDouble) kept.push(face);
  }
  return kept;
}

const area = (box) => (box.right - box.left) * (box.bottom - box.top);

function commonArea(a, b) {
  const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
  const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
  return Math.max(width, 0) * Math.max(height, 0);
}

// Intersection over union of two boxes.
export function overlap(a, b) {
  const common = commonArea(a, b);
  return common / (area(a) + area(b) - common);
}
