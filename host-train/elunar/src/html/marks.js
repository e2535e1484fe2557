// The cross and the ends of a profile over the relief, set by two clicks, or by arrow keys and Enter. Places are pixels of the grid.

import { put } from "./chart.js";

/** Watches the canvas; `drawn` is given both ends of a profile. `size` tells {rows, cols}. */
export function marks(canvas, svg, size, drawn) {
  let ends = [];
  let cross;
  const set = (place) => {
    ends = ends.length === 1 ? [ends[0], place] : [place];
    show();
    if (ends.length === 2) drawn(...ends);
  };
  canvas.addEventListener("click", (event) => {
    const [box, { rows, cols }] = [canvas.getBoundingClientRect(), size()];
    const at = (share, count) => Math.min(Math.max(share * count - 0.5, 0), count - 1);
    set({ col: at((event.clientX - box.left) / box.width, cols), row: at((event.clientY - box.top) / box.height, rows) });
  });
  canvas.addEventListener("keydown", (event) => {
    const { rows, cols } = size();
    const step = event.shiftKey ? 1 : Math.max(1, Math.round(cols / 64));
    const [dc, dr] = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key] ?? [];
    if (dc === undefined && event.key !== "Enter") return;
    event.preventDefault();
    cross ??= { col: Math.floor(cols / 2), row: Math.floor(rows / 2) };
    if (event.key === "Enter") return set({ ...cross });
    const within = (v, count) => Math.min(Math.max(v, 0), count - 1);
    cross = { col: within(cross.col + dc, cols), row: within(cross.row + dr, rows) };
    show();
  });
  function show() {
    const { rows, cols } = size();
    svg.setAttribute("viewBox", `0 0 ${cols} ${rows}`);
    svg.replaceChildren();
    const width = cols / (canvas.getBoundingClientRect().width || cols); // of a pixel of the screen
    const round = ({ col, row }) => put(svg, "circle", { cx: col + 0.5, cy: row + 0.5, r: 5 * width, fill: "#fff", stroke: "#000", "stroke-width": width });
    if (ends.length === 2) {
      const [a, b] = ends;
      const line = { x1: a.col + 0.5, y1: a.row + 0.5, x2: b.col + 0.5, y2: b.row + 0.5 };
      put(svg, "line", { ...line, stroke: "#000", "stroke-width": 4 * width });
      put(svg, "line", { ...line, stroke: "#fff", "stroke-width": 2 * width });
    }
    ends.forEach(round);
    if (cross) {
      const [x, y, arm] = [cross.col + 0.5, cross.row + 0.5, 12 * width];
      put(svg, "path", { d: `M${x - arm} ${y}H${x + arm}M${x} ${y - arm}V${y + arm}`, stroke: "#fff", "stroke-width": 2 * width });
    }
  }
  return {
    set: (from, to) => {
      ends = [from, to];
      show();
      drawn(from, to);
    },
    /** Hides the marks, where the relief is not seen from above. */
    hide: (hidden) => (svg.style.display = hidden ? "none" : ""),
  };
}
