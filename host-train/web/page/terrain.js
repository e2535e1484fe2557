// The terrain of the page: the relief, with hazards over it and the slopes beside it.

import { hazards } from "./hazards.js";
import { drawSlopes } from "./histogram.js";
import { $, number, relief } from "./relief.js";

/** Prepares the controls; returns what shows maps, with the light of the relief from an azimuth at first. */
export function terrain() {
  const view = relief($("terrain"));
  document.querySelector(".controls").append($("of-hazards"));
  document.querySelector(".grid").append($("of-slopes"));
  let maps;
  ["hazards", "slope-limit", "roughness-limit"].forEach((id) => $(id).addEventListener("input", () => (lay(), view.draw())));

  /** Lays the hazards over the ground. */
  function lay() {
    if (!maps) return;
    const [slope_deg, roughness_m, shown] = [number("slope-limit"), number("roughness-limit"), $("hazards").checked];
    const { colours, safe } = hazards(maps, slope_deg, roughness_m, shown);
    view.lay(colours);
    drawSlopes($("slopes"), $("slopes-text"), maps.slope, slope_deg);
    $("hazard-text").textContent = `slope ${slope_deg}° (orange), roughness ${roughness_m.toFixed(1)} m (blue) of a footprint: `
      + `${(100 * safe).toFixed(1)} % without a hazard`;
  }

  return (taken, azimuth_deg) => {
    maps = taken;
    const layers = [["coarse DTM", maps.coarse], ["result", maps.heights], ["truth", maps.truth]]
      .filter(([, heights]) => heights).map(([name, heights]) => ({ name, heights }));
    view.show({ ...maps, azimuth_deg, layers: [{ name: "image", image: maps.image }, ...layers], slots: [0, 1, 2], profile: maps });
    lay();
    view.draw();
  };
}
