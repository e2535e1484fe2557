// A profile between two points: heights of the result with one standard deviation, of the coarse DTM, and of the truth.

import { axes, path, put } from "./chart.js";
import { between } from "./samples.js";

/** Samples maps (heights, coarse, truth, sigma, or none of them) along a line between two points of the grid, each {col, row}; about one sample a pixel. */
export function sample(maps, from, to) {
  const { rows, cols, row_m, col_m } = maps;
  const count = Math.min(600, Math.max(2, Math.ceil(Math.hypot(to.col - from.col, to.row - from.row)) + 1));
  const length_m = Math.hypot((to.col - from.col) * col_m, (to.row - from.row) * row_m);
  return Array.from({ length: count }, (_, i) => {
    const t = i / (count - 1);
    const [col, row] = [from.col + (to.col - from.col) * t, from.row + (to.row - from.row) * t];
    const of = (samples) => (samples ? between(samples, cols, rows, col, row) : NaN);
    return { at_m: length_m * t, col, row, height: of(maps.heights), coarse: of(maps.coarse), truth: of(maps.truth), sigma: of(maps.sigma) };
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
  const all = known.flatMap((p) => [p.height - spread(p), p.height + spread(p), p.coarse, p.truth]).filter(Number.isFinite);
  const [low, high] = all.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
  const to = axes(svg, [0, points.at(-1).at_m], [low, high], "m along the profile", "height, m");
  const upper = known.map((p) => to(p.at_m, p.height + spread(p)));
  const lower = known.map((p) => to(p.at_m, p.height - spread(p))).reverse();
  put(svg, "path", { d: path([...upper, ...lower]) + "Z", fill: "var(--band)" });
  const others = [["coarse", "coarse DTM", "dashed", "--line-b", "6 4"], ["truth", "truth", "dotted", "--text", "1 4"]]
    .filter(([name]) => known.some((p) => Number.isFinite(p[name])));
  for (const [name, , , colour, dashes] of others) {
    const line = known.filter((p) => Number.isFinite(p[name])).map((p) => to(p.at_m, p[name]));
    put(svg, "path", { d: path(line), fill: "none", stroke: `var(${colour})`, "stroke-dasharray": dashes, "stroke-width": 2 });
  }
  put(svg, "path", { d: path(known.map((p) => to(p.at_m, p.height))), fill: "none", stroke: "var(--line-a)", "stroke-width": 2 });
  const [first, last] = [known[0].height, known.at(-1).height];
  const band = known.some((p) => Number.isFinite(p.sigma)) ? " with one standard deviation" : "";
  words.innerHTML = [`Profile of ${points.at(-1).at_m.toFixed(0)} m, ${(last - first).toFixed(1)} m from end to end: `
    + `<b style="color:var(--line-a)">result</b>${band}`, ...others.map(([, what, how, colour]) => `<b style="color:var(${colour})">${what}</b> ${how}`)].join(", ") + ".";
}
