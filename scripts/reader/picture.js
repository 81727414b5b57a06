// Photographs as pixels. A picture has `width`, `height` and `data` (red, green, blue, alpha of each pixel). Positions
// are in pixels: x to the right, y down, the centre of the first pixel at (0.5, 0.5).

// A photograph is worked on and shown at this size at most. Detector and network see far less of it.
const LONGEST_SIDE_PX = 2048;

// A message for the user, in contrast to a fault of the page.
export class Problem extends Error {}

// Draws a picture file on a new canvas, turned upright by its orientation tag.
export async function openPhotograph(file) {
  let bitmap;
  try {
    bitmap = await createImageBitmap(file, { imageOrientation: "from-image" });
  } catch {
    throw new Problem(
      `${file.name || "This"} could not be opened as a picture: this browser does not know its format, or it is ` +
        "damaged or too large. JPEG, PNG and WebP work in every browser.",
    );
  }
  const { width, height } = bitmap;
  const scale = Math.min(LONGEST_SIDE_PX / Math.max(width, height), 1);
  const canvas = newCanvas(Math.max(Math.round(width * scale), 1), Math.max(Math.round(height * scale), 1));
  const context = contextOf(canvas);
  context.fillStyle = "white"; // behind transparent pixels
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.imageSmoothingQuality = "high";
  context.drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  bitmap.close();
  return { name: file.name || "photograph", canvas, scale };
}

// The photograph turned clockwise by a quarter.
export function turned({ name, canvas, scale }) {
  const result = newCanvas(canvas.height, canvas.width);
  const context = contextOf(result);
  context.translate(result.width, 0);
  context.rotate(Math.PI / 2);
  context.drawImage(canvas, 0, 0);
  return { name, canvas: result, scale };
}

export function newCanvas(width, height) {
  return Object.assign(document.createElement("canvas"), { width, height });
}

export function pixelsOf(canvas) {
  return contextOf(canvas).getImageData(0, 0, canvas.width, canvas.height);
}

// Canvases whose pixels are read are best kept where the processor is, and not on a graphics card.
const contextOf = (canvas) => canvas.getContext("2d", { willReadFrequently: true });

// Resamples a part of a picture for a network: the planes of red, green and blue, from -0.5 to 0.5.
//
// The part begins at `left` and `top`, and a pixel of the result is `stepX` by `stepY` pixels of the picture. Where the
// picture is much finer, whole pixels are averaged first. Beyond the picture, each channel is `empty`.
export function resampled(picture, part, width, height, empty) {
  const factor = Math.floor(Math.min(part.stepX, part.stepY, Math.max(picture.width, picture.height)));
  const source = factor > 1 ? averaged(picture, factor) : picture;
  const finer = Math.max(factor, 1);
  const planes = new Float32Array(3 * width * height);
  const valueAt = (x, y, channel) =>
    x >= 0 && y >= 0 && x < source.width && y < source.height ? source.data[4 * (y * source.width + x) + channel] : empty;
  for (let row = 0; row < height; row++) {
    const y = (part.top + (row + 0.5) * part.stepY) / finer - 0.5;
    const above = Math.floor(y);
    for (let column = 0; column < width; column++) {
      const x = (part.left + (column + 0.5) * part.stepX) / finer - 0.5;
      const before = Math.floor(x);
      for (let channel = 0; channel < 3; channel++) {
        const upper = mix(valueAt(before, above, channel), valueAt(before + 1, above, channel), x - before);
        const lower = mix(valueAt(before, above + 1, channel), valueAt(before + 1, above + 1, channel), x - before);
        planes[(channel * height + row) * width + column] = mix(upper, lower, y - above) / 255 - 0.5;
      }
    }
  }
  return planes;
}

const mix = (a, b, share) => a + (b - a) * share;

// The means of blocks of pixels. Blocks at the right and lower border repeat the last pixels.
function averaged(picture, factor) {
  const width = Math.ceil(picture.width / factor);
  const height = Math.ceil(picture.height / factor);
  const data = new Float32Array(4 * width * height);
  for (let y = 0; y < height * factor; y++) {
    const row = Math.min(y, picture.height - 1) * picture.width;
    for (let x = 0; x < width * factor; x++) {
      const from = 4 * (row + Math.min(x, picture.width - 1));
      const to = 4 * (Math.floor(y / factor) * width + Math.floor(x / factor));
      for (let channel = 0; channel < 3; channel++) data[to + channel] += picture.data[from + channel];
    }
  }
  return { width, height, data: data.map((sum) => sum / (factor * factor)) };
}
