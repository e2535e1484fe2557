// Slopes and light, as elunar_core::terrain has them (Horn; the hillshade of gdaldem).

/** Returns height, gradient to the east, gradient to the south, and 1 where all three are known, for every pixel. */
export function surface(heights, { rows, cols, row_m, col_m }) {
  const out = new Float32Array(4 * rows * cols);
  for (let row = 0; row < rows; row++) {
    for (let col = 0; col < cols; col++) {
      const i = row * cols + col;
      out[4 * i] = heights[i];
      if (row === 0 || col === 0 || row === rows - 1 || col === cols - 1) continue;
      const w = (r, c) => heights[i + r * cols + c];
      const east = (w(-1, 1) + 2 * w(0, 1) + w(1, 1) - (w(-1, -1) + 2 * w(0, -1) + w(1, -1))) / (8 * col_m);
      const south = (w(1, -1) + 2 * w(1, 0) + w(1, 1) - (w(-1, -1) + 2 * w(-1, 0) + w(-1, 1))) / (8 * row_m);
      if (Number.isFinite(east) && Number.isFinite(south) && Number.isFinite(heights[i])) {
        out.set([east, south, 1], 4 * i + 1);
      }
    }
  }
  return out;
}

/** Returns the unit vector to the Sun: east, north, up. */
export function sunVector(azimuth_deg, elevation_deg) {
  const [a, e] = [(azimuth_deg * Math.PI) / 180, (elevation_deg * Math.PI) / 180];
  return [Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), Math.sin(e)];
}

/** Returns the shade of a gradient, 0 to 1. */
export function shade(east, south, [x, y, z], exaggeration) {
  const [e, s] = [east * exaggeration, south * exaggeration];
  return (1 + 254 * Math.max(0, (-e * x + s * y + z) / Math.sqrt(e * e + s * s + 1))) / 255;
}
