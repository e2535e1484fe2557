// The maps that the command `view` writes: see host-train/web/src/view.rs.

import { percentiles } from "./samples.js";

/** Reads the file: its head, and every map by its name. */
export function parse(bytes) {
  const end = bytes.indexOf(10) + 1;
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
  const size = head.rows * head.cols;
  const at = (k) => new Float32Array(bytes.slice(end + 4 * size * k, end + 4 * size * (k + 1)).buffer);
  return { ...head, ...Object.fromEntries(head.maps.map((name, k) => [name, at(k)])) };
}

/** Returns the image as a canvas, grey between two percentiles. */
export function picture({ image, rows, cols }) {
  const canvas = Object.assign(document.createElement("canvas"), { width: cols, height: rows });
  const [low, high] = percentiles(image, 0.01, 0.99);
  const pixels = new ImageData(cols, rows);
  for (let i = 0; i < image.length; i++) pixels.data.fill((255 * (image[i] - low)) / (high - low), 4 * i, 4 * i + 3).fill(255, 4 * i + 3, 4 * i + 4);
  canvas.getContext("2d").putImageData(pixels, 0, 0);
  return canvas;
}
