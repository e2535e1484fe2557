// The histogram of the slopes of footprints.

import { axes, put } from "./chart.js";

const BINS = 40;

/** Draws it into an SVG of 640 x 260 with the limit, and says it in words. */
export function drawSlopes(svg, words, slopes, limit_deg) {
  const known = slopes.filter(Number.isFinite).sort();
  svg.replaceChildren();
  if (known.length === 0) return;
  const at = (p) => known[Math.min(known.length - 1, Math.floor(p * known.length))];
  const highest = Math.max(1, at(0.999));
  const counts = new Array(BINS).fill(0);
  known.forEach((slope) => (counts[Math.min(BINS - 1, Math.floor((slope / highest) * BINS))] += 100 / known.length));
  const to = axes(svg, [0, highest], [0, Math.max(...counts)], "slope of a footprint, degrees", "% of pixels");
  counts.forEach((count, bin) => {
    const [[x, y], [right, bottom]] = [to((bin * highest) / BINS, count), to(((bin + 1) * highest) / BINS, 0)];
    const steep = (bin + 0.5) * highest > limit_deg * BINS;
    put(svg, "rect", { x, y, width: right - x - 1, height: bottom - y, fill: steep ? "var(--steep)" : "var(--line-b)" });
  });
  const beyond = (100 * known.filter((slope) => slope > limit_deg).length) / known.length;
  words.textContent = `Slopes: median ${at(0.5).toFixed(1)}°, nine tenths below ${at(0.9).toFixed(1)}°; `
    + `${beyond.toFixed(1)} % steeper than ${limit_deg}° (orange).`;
}
