// Axes and lines of small charts in SVG, 640 x 260.

const [LEFT, RIGHT, TOP, BOTTOM] = [64, 628, 14, 218];

/** Adds an element. */
export function put(svg, name, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  Object.entries(attributes).forEach(([key, value]) => element.setAttribute(key, value));
  if (text !== undefined) element.textContent = text;
  svg.append(element);
  return element;
}

/** Returns the path through points. */
export function path(points) {
  return points.map(([x, y], i) => `${i ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
}

/** Returns four to eight round numbers of a range. */
export function ticks(low, high) {
  const rough = (high - low || 1) / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const first = Math.ceil(low / step);
  const count = Math.floor(high / step) - first + 1;
  const digits = Math.max(0, -Math.floor(Math.log10(step)));
  return Array.from({ length: Math.max(count, 0) }, (_, i) => [(first + i) * step, ((first + i) * step).toFixed(digits)]);
}

/** Draws axes with their titles; returns the function from values to places. */
export function axes(svg, [left, right], [low, high], across, up) {
  const room = (high - low || 1) * 0.06;
  const [bottom, top] = [low - room, high + room];
  const x = (v) => LEFT + ((RIGHT - LEFT) * (v - left)) / (right - left || 1);
  const y = (v) => BOTTOM - ((BOTTOM - TOP) * (v - bottom)) / (top - bottom);
  for (const [v, word] of ticks(left, right)) {
    put(svg, "text", { x: x(v), y: BOTTOM + 18, "text-anchor": "middle" }, word);
  }
  for (const [v, word] of ticks(bottom, top)) {
    put(svg, "line", { x1: LEFT, x2: RIGHT, y1: y(v), y2: y(v), stroke: "var(--line)" });
    put(svg, "text", { x: LEFT - 8, y: y(v) + 4, "text-anchor": "end" }, word);
  }
  put(svg, "text", { x: RIGHT, y: BOTTOM + 36, "text-anchor": "end" }, across);
  put(svg, "text", { class: "up", x: 14, y: (TOP + BOTTOM) / 2, "text-anchor": "middle", transform: `rotate(-90 14 ${(TOP + BOTTOM) / 2})` }, up);
  return (v, w) => [x(v), y(w)];
}
