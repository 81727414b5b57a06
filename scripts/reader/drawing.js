// Draws what the networks found over the photograph.

import { newCanvas } from "./picture.js";

const SEEN = [60, 255, 60];
const HIDDEN = [255, 80, 80];
const FACE_PER_DOT = 110; // longer side of a face over the radius of a dot
// A small photograph is drawn enlarged, so that dots are round.
const DRAWN_PX = 1600;
const LARGEST_ENLARGEMENT = 4;
const PNCC_LIMIT_MM = 120;
const OFFSET_LIMIT_MM = 15;

// What each map looks like: red, green and blue (0 to 255) of a pixel.
const MAPS = {
  mask: (maps, i) => (maps.seen[i] ? SEEN : HIDDEN),
  pncc: (maps, i) => coloured(maps.pncc, i, PNCC_LIMIT_MM),
  offset: (maps, i) => coloured(maps.offset, i, OFFSET_LIMIT_MM),
};

export const LEGENDS = {
  none: "",
  mask: "Green: the face as far as it is visible. Red: what hides it.",
  pncc: `Red, green and blue: x, y and z of the matching point on the mean face, ±${PNCC_LIMIT_MM} mm.`,
  offset: `Red, green and blue: x, y and z from the mean face to this face, ±${OFFSET_LIMIT_MM} mm.`,
};

// Draws photograph and faces on a canvas. `shown` has `map` (a name of LEGENDS), `opacity` (0 to 1), and whether
// `landmarks` and `boxes` are drawn.
export function drawFaces(canvas, photograph, faces, shown) {
  const wanted = DRAWN_PX / Math.max(photograph.width, photograph.height);
  const zoom = Math.min(Math.max(wanted, 1), LARGEST_ENLARGEMENT);
  canvas.width = Math.round(zoom * photograph.width);
  canvas.height = Math.round(zoom * photograph.height);
  const context = canvas.getContext("2d");
  context.scale(zoom, zoom);
  context.drawImage(photograph, 0, 0);
  if (shown.map in MAPS) for (const face of faces) drawMap(context, face, shown);
  for (const face of faces) {
    const side = Math.max(face.box.right - face.box.left, face.box.bottom - face.box.top);
    const radius = Math.max(side / FACE_PER_DOT, 1 / zoom);
    if (shown.boxes) drawBox(context, face.box, radius);
    if (shown.landmarks) drawLandmarks(context, face.landmarks, radius);
  }
}

function drawMap(context, { crop, maps }, { map, opacity }) {
  const size = Math.sqrt(maps.mask.length);
  const small = newCanvas(size, size);
  const pixels = new ImageData(size, size);
  for (const i of maps.pixels) pixels.data.set([...MAPS[map](maps, i), 255], 4 * i);
  small.getContext("2d").putImageData(pixels, 0, 0);
  context.globalAlpha = opacity;
  context.drawImage(small, crop.left, crop.top, size * crop.stepX, size * crop.stepY);
  context.globalAlpha = 1;
}

const coloured = (vectors, i, limit) => [0, 1, 2].map((axis) => 255 * (vectors[3 * i + axis] / (2 * limit) + 0.5));

function drawBox(context, box, radius) {
  context.strokeStyle = "white";
  context.lineWidth = radius;
  context.strokeRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
}

function drawLandmarks(context, landmarks, radius) {
  for (const { x, y, isSeen } of landmarks) {
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = `rgb(${isSeen ? SEEN : HIDDEN})`;
    context.fill();
    context.lineWidth = radius / 3;
    context.strokeStyle = "rgb(0 0 0 / 60%)"; // so that dots stand out from light skin, too
    context.stroke();
  }
}
