// The relief of a ground: its layers side by side under a light that is turned by hand, and a profile between two points.

import { colour } from "./colours.js";
import { dial } from "./dial.js";
import { marks } from "./marks.js";
import { drawProfile, sample } from "./profile.js";
import { withCanvas } from "./relief-canvas.js";
import { withGl } from "./relief-gl.js";
import { percentiles } from "./samples.js";
import { surface } from "./shading.js";

const MARKUP = `
<div class="stage">
  <canvas id="relief" tabindex="0" aria-label="Relief. Two clicks draw a profile; arrow keys move the cross, Enter sets an end."></canvas>
  <svg id="marks" aria-hidden="true"></svg>
  <span class="tag" id="tag-0"></span><span class="tag" id="tag-1"></span><span class="tag" id="tag-2"></span>
</div>
<p class="divide"><label>Divide <input id="divide" type="range" min="0" max="1" step="0.005" value="0.333"></label>
  <label>and <input id="divide-2" type="range" min="0" max="1" step="0.005" value="0.667"></label></p>
<div class="controls">
  <fieldset>
    <legend>Layers</legend>
    <label>Left <select id="slot-0"></select></label>
    <label>Middle <select id="slot-1"></select></label>
    <label>Right <select id="slot-2"></select></label>
    <label><input id="tint" type="checkbox" checked> heights in colour</label>
    <p id="scale" class="faint"></p>
  </fieldset>
  <fieldset>
    <legend>Light of the relief</legend>
    <div class="dialled">
      <canvas id="relief-sun" class="dial" width="160" height="160" tabindex="0" role="slider" aria-label="Azimuth of the relief's light"></canvas>
      <div>
        <label>Azimuth <input id="azimuth" type="range" min="0" max="360" step="1" value="315"></label>
        <label>Elevation <input id="elevation" type="range" min="5" max="90" step="1" value="25"></label>
        <p class="faint" id="light-text"></p>
      </div>
    </div>
  </fieldset>
  <fieldset>
    <legend>View</legend>
    <label>Heights times <input id="exaggeration" type="range" min="1" max="6" step="0.25" value="1"></label>
    <label>Tilt <input id="tilt" type="range" min="0" max="75" step="1" value="0"></label>
    <label>Turn <input id="turn" type="range" min="-180" max="180" step="1" value="0"></label>
    <p class="faint" id="view-text"></p>
  </fieldset>
</div>
<div class="grid">
  <figure><svg id="profile" class="chart" viewBox="0 0 640 260" role="img" aria-label="Profile"></svg>
    <figcaption id="profile-text">Profile: click two points of the relief.</figcaption></figure>
</div>`;

/** Returns an element of the page. */
export const $ = (id) => document.getElementById(id);
/** Returns the number of a control. */
export const number = (id) => Number($(id).value);

/**
 * Builds the relief into an element. Returns {show, lay, draw}.
 *
 * show(scene): {rows, cols, row_m, col_m, azimuth_deg, layers: [{name, image}, {name, heights}, ...], slots, profile}: `slots` are the layers on
 * the left, in the middle and on the right, `profile` the samples {heights, coarse, truth, sigma}. The image lies on `profile.heights`.
 * lay(colours): RGBA bytes over the ground.
 */
export function relief(root) {
  root.innerHTML = MARKUP;
  let scene, drawing, range, image_range;
  const dialled = dial($("relief-sun"), (azimuth_deg) => {
    $("azimuth").value = azimuth_deg;
    draw();
  });
  const ends = marks($("relief"), $("marks"), () => scene ?? { rows: 1, cols: 1 }, (from, to) => {
    const points = sample({ ...scene, ...scene.profile }, from, to);
    $("profile").profile = points;
    drawProfile($("profile"), $("profile-text"), points);
  });
  const slots = [0, 1, 2].map((k) => $(`slot-${k}`));
  const ranges = ["divide", "divide-2", "tint", "azimuth", "elevation", "exaggeration", "tilt", "turn"].map($);
  [...slots, ...ranges].forEach((control) => control.addEventListener("input", draw));

  function draw() {
    if (!scene) return;
    const divide = [number("divide"), Math.max(number("divide"), number("divide-2"))];
    const view = {
      slots: slots.map(({ value }) => Number(value)), divide, tint: $("tint").checked,
      azimuth_deg: number("azimuth"), elevation_deg: number("elevation"), exaggeration: number("exaggeration"),
      tilt_deg: number("tilt"), turn_deg: number("turn"), range, image_range,
    };
    drawing.draw(view);
    dialled(view.azimuth_deg);
    ends.hide(view.tilt_deg !== 0 || view.turn_deg !== 0);
    [[0, divide[0]], divide, [divide[1], 1]].forEach(([from, to], k) => {
      $(`tag-${k}`).textContent = to - from > 0.02 ? scene.layers[view.slots[k]].name : "";
      [$(`tag-${k}`).style.left, $(`tag-${k}`).style.maxWidth] = [`${100 * from}%`, `${100 * (to - from)}%`];
    });
    $("light-text").textContent = `from ${view.azimuth_deg}°, ${view.elevation_deg}° high`;
    $("view-text").textContent = `heights times ${view.exaggeration}, tilt ${view.tilt_deg}°, turn ${view.turn_deg}°; drawn by ${drawing.name}`;
  }

  function show(shown) {
    scene = shown;
    const { rows, cols, layers, profile } = scene;
    const canvas = $("relief");
    const factor = Math.max(1, Math.min(4, Math.round(1280 / cols)));
    canvas.parentElement.style.maxWidth = `calc(75vh * ${cols / rows})`;
    [canvas.width, canvas.height] = [cols * factor, rows * factor];
    const noGl = new URLSearchParams(location.search).has("canvas");
    drawing ??= (noGl ? undefined : withGl(canvas)) ?? withCanvas(canvas);
    const once = (heights) => {
      let made;
      return () => (made ??= surface(heights, scene));
    };
    const main = layers.findIndex(({ heights }) => heights === profile.heights);
    drawing.take({ ...scene, main, layers: layers.map(({ image, heights }) => (image ? { image } : { surface: once(heights) })) });
    range = percentiles(profile.heights, 0.01, 0.99);
    image_range = percentiles(layers.find(({ image }) => image)?.image ?? [], 0.01, 0.99);
    slots.forEach((slot, k) => slot.replaceChildren(...layers.map(({ name }, i) => new Option(name, i, false, i === scene.slots[k]))));
    const stops = [0, 0.25, 0.5, 0.75, 1].map((share) => `rgb(${colour(share).map((part) => Math.round(255 * part)).join(" ")})`);
    $("scale").innerHTML = `<span style="background:linear-gradient(90deg,${stops})">&emsp;&emsp;&emsp;&emsp;</span> `
      + `${range[0].toFixed(0)} to ${range[1].toFixed(0)} m`;
    $("azimuth").value = Math.round(scene.azimuth_deg + 360) % 360;
    draw();
    ends.set({ col: cols * 0.1, row: rows / 2 }, { col: cols * 0.9, row: rows / 2 });
  }
  return { show, draw, lay: (colours) => drawing.lay(colours) };
}
