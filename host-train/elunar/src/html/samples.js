// Samples of maps: their percentiles, and values between pixels.

/** Returns the two percentiles, 0 to 1, of the finite samples. */
export function percentiles(samples, low, high) {
  const step = Math.max(1, Math.floor(samples.length / 100000));
  const finite = Float32Array.from(samples.filter((v, i) => i % step === 0 && Number.isFinite(v))).sort();
  const at = (p) => finite[Math.min(finite.length - 1, Math.floor(p * finite.length))] ?? 0;
  return [at(low), at(high)];
}

/** Returns the value between pixels, by the four around it; NaN where one is void. Places count from the first pixel's centre. */
export function between(samples, cols, rows, col, row) {
  const [c, r] = [Math.min(Math.max(col, 0), cols - 1), Math.min(Math.max(row, 0), rows - 1)];
  const [c0, r0] = [Math.min(Math.floor(c), Math.max(cols - 2, 0)), Math.min(Math.floor(r), Math.max(rows - 2, 0))];
  const [dc, dr, i] = [c - c0, r - r0, r0 * cols + c0];
  const line = (i) => (dc === 0 ? samples[i] : samples[i] * (1 - dc) + samples[i + 1] * dc);
  return dr === 0 ? line(i) : line(i) * (1 - dr) + line(i + cols) * dr;
}
