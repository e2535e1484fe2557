// The terrain: the relief with its light, layers and hazards, the profile and the slopes.

import { colour } from "./colours.js";
import { dial } from "./dial.js";
import { hazards } from "./hazards.js";
import { drawSlopes } from "./histogram.js";
import { percentiles } from "./maps.js";
import { marks } from "./marks.js";
import { drawProfile, sample } from "./profile.js";
import { withCanvas } from "./relief-canvas.js";
import { withGl } from "./relief-gl.js";
import { surface } from "./shading.js";

const $ = (id) => document.getElementById(id);
const LAYERS = ["image", "coarse DTM", "result"];
const number = (id) => Number($(id).value);

/** Prepares the controls; returns what shows maps, with the light of the relief from an azimuth at first. */
export function terrain() {
  let maps, drawing, range, image_range;
  const turn = dial($("relief-sun"), (azimuth_deg) => {
    $("azimuth").value = azimuth_deg;
    draw();
  });
  const ends = marks($("relief"), $("marks"), () => maps ?? { rows: 1, cols: 1 }, (from, to) => {
    const points = sample(maps, from, to);
    $("profile").profile = points;
    drawProfile($("profile"), $("profile-text"), points);
  });
  for (const [select, chosen] of [["left", 0], ["right", 2]]) {
    $(select).append(...LAYERS.map((name, i) => new Option(name, i, false, i === chosen)));
  }
  const controls = ["divide", "left", "right", "tint", "azimuth", "elevation", "exaggeration", "tilt", "turn"];
  controls.forEach((id) => $(id).addEventListener("input", draw));
  ["hazards", "slope-limit", "roughness-limit"].forEach((id) => $(id).addEventListener("input", () => (lay(), draw())));

  /** Lays the hazards over the ground. */
  function lay() {
    const [slope_deg, roughness_m, shown] = [number("slope-limit"), number("roughness-limit"), $("hazards").checked];
    const { colours, safe } = hazards(maps, slope_deg, roughness_m, shown);
    drawing.lay(colours);
    drawSlopes($("slopes"), $("slopes-text"), maps.slope, slope_deg);
    $("hazard-text").textContent = `slope ${slope_deg}° (orange), roughness ${roughness_m.toFixed(1)} m (blue) of a footprint: `
      + `${(100 * safe).toFixed(1)} % without a hazard`;
  }

  function draw() {
    if (!drawing) return;
    const view = {
      left: number("left"), right: number("right"), divide: number("divide"), tint: $("tint").checked,
      azimuth_deg: number("azimuth"), elevation_deg: number("elevation"), exaggeration: number("exaggeration"),
      tilt_deg: number("tilt"), turn_deg: number("turn"), range, image_range,
    };
    drawing.draw(view);
    turn(view.azimuth_deg);
    ends.hide(view.tilt_deg !== 0 || view.turn_deg !== 0);
    $("left-tag").textContent = view.divide > 0 ? LAYERS[view.left] : "";
    $("right-tag").textContent = view.divide < 1 ? LAYERS[view.right] : "";
    $("light-text").textContent = `from ${view.azimuth_deg}°, ${view.elevation_deg}° high`;
    $("view-text").textContent = `heights times ${view.exaggeration}, tilt ${view.tilt_deg}°, turn ${view.turn_deg}°; drawn by ${drawing.name}`;
  }

  return (taken, azimuth_deg) => {
    maps = taken;
    const canvas = $("relief");
    const factor = Math.max(1, Math.min(4, Math.round(1280 / maps.cols)));
    canvas.parentElement.style.maxWidth = `calc(75vh * ${maps.cols / maps.rows})`;
    [canvas.width, canvas.height] = [maps.cols * factor, maps.rows * factor];
    const noGl = new URLSearchParams(location.search).has("canvas");
    drawing ??= (noGl ? undefined : withGl(canvas)) ?? withCanvas(canvas);
    drawing.take({ ...maps, result: surface(maps.heights, maps), coarse: surface(maps.coarse, maps) });
    [range, image_range] = [percentiles(maps.heights, 0.01, 0.99), percentiles(maps.image, 0.01, 0.99)];
    const stops = [0, 0.25, 0.5, 0.75, 1].map((share) => `rgb(${colour(share).map((part) => Math.round(255 * part)).join(" ")})`);
    $("scale").innerHTML = `<span style="background:linear-gradient(90deg,${stops})">&emsp;&emsp;&emsp;&emsp;</span> `
      + `${range[0].toFixed(0)} to ${range[1].toFixed(0)} m`;
    $("azimuth").value = Math.round(azimuth_deg + 360) % 360;
    lay();
    draw();
    ends.set({ col: maps.cols * 0.1, row: maps.rows / 2 }, { col: maps.cols * 0.9, row: maps.rows / 2 });
  };
}
