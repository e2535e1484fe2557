// A profile between two points: heights of the result with one standard deviation, and of the coarse DTM.

import { axes, path, put } from "./chart.js";
import { between } from "./maps.js";

/** Samples maps along a line between two points of the grid, each {col, row}; about one sample a pixel. */
export function sample(maps, from, to) {
  const { rows, cols, row_m, col_m } = maps;
  const count = Math.min(600, Math.max(2, Math.ceil(Math.hypot(to.col - from.col, to.row - from.row)) + 1));
  const length_m = Math.hypot((to.col - from.col) * col_m, (to.row - from.row) * row_m);
  return Array.from({ length: count }, (_, i) => {
    const t = i / (count - 1);
    const [col, row] = [from.col + (to.col - from.col) * t, from.row + (to.row - from.row) * t];
    const of = (samples) => (samples ? between(samples, cols, rows, col, row) : NaN);
    return { at_m: length_m * t, col, row, height: of(maps.heights), coarse: of(maps.coarse), sigma: of(maps.sigma) };
  });
}

/** Draws a profile into an SVG of 640 x 260, and says it in words. */
export function drawProfile(svg, words, points) {
  const known = points.filter(({ height }) => Number.isFinite(height));
  svg.replaceChildren();
  if (known.length < 2) {
    words.textContent = "Profile: no heights there.";
    return;
  }
  const spread = ({ sigma }) => (Number.isFinite(sigma) ? sigma : 0);
  const all = known.flatMap((p) => [p.height - spread(p), p.height + spread(p), p.coarse]).filter(Number.isFinite);
  const [low, high] = all.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
  const to = axes(svg, [0, points.at(-1).at_m], [low, high], "m along the profile", "height, m");
  const upper = known.map((p) => to(p.at_m, p.height + spread(p)));
  const lower = known.map((p) => to(p.at_m, p.height - spread(p))).reverse();
  put(svg, "path", { d: path([...upper, ...lower]) + "Z", fill: "var(--band)" });
  const coarse = known.filter((p) => Number.isFinite(p.coarse)).map((p) => to(p.at_m, p.coarse));
  put(svg, "path", { d: path(coarse), fill: "none", stroke: "var(--line-b)", "stroke-dasharray": "6 4", "stroke-width": 2 });
  put(svg, "path", { d: path(known.map((p) => to(p.at_m, p.height))), fill: "none", stroke: "var(--line-a)", "stroke-width": 2 });
  const [first, last] = [known[0].height, known.at(-1).height];
  words.innerHTML = `Profile of ${points.at(-1).at_m.toFixed(0)} m, ${(last - first).toFixed(1)} m from end to end: `
    + `<b style="color:var(--line-a)">result</b> with one standard deviation, <b style="color:var(--line-b)">coarse DTM</b> dashed.`;
}
