// The relief without WebGL: seen from above, pixel by pixel. Tilt and turn are not drawn.

import { colour } from "./colours.js";
import { shade, sunVector } from "./shading.js";

/** Returns something that draws, as relief-gl.js has it. */
export function withCanvas(canvas) {
  const context = canvas.getContext("2d");
  const small = document.createElement("canvas");
  let maps, hazards;
  return {
    name: "canvas",
    take(taken) {
      [maps, hazards] = [taken, undefined];
      [small.width, small.height] = [maps.cols, maps.rows];
    },
    lay(colours) {
      hazards = colours;
    },
    draw(view) {
      const { rows, cols } = maps;
      const picture = new ImageData(cols, rows);
      const sun = sunVector(view.azimuth_deg, view.elevation_deg);
      const shown = view.slots.map((layer) => maps.layers[layer].image ?? maps.layers[layer].surface());
      for (let i = 0; i < rows * cols; i++) {
        const u = (i % cols) / cols;
        const slot = u < view.divide[0] ? 0 : u < view.divide[1] ? 1 : 2;
        const over = hazards ? hazards[4 * i + 3] / 255 : 0;
        const found = maps.layers[view.slots[slot]].image ? grey(shown[slot][i], view) : ground(shown[slot], i, sun, view);
        for (let k = 0; k < 3; k++) {
          picture.data[4 * i + k] = Math.round(255 * found[k] * (1 - over) + (over ? hazards[4 * i + k] * over : 0));
        }
        picture.data[4 * i + 3] = 255;
      }
      small.getContext("2d").putImageData(picture, 0, 0);
      context.drawImage(small, 0, 0, canvas.width, canvas.height);
    },
  };

  function grey(sample, view) {
    const share = (sample - view.image_range[0]) / (view.image_range[1] - view.image_range[0]);
    return Array(3).fill(Number.isFinite(share) ? Math.min(Math.max(share, 0), 1) : 0);
  }

  function ground(surface, i, sun, view) {
    const [height, east, south, known] = surface.subarray(4 * i, 4 * i + 4);
    if (!known) return [0, 0, 0];
    const light = shade(east, south, sun, view.exaggeration);
    if (!view.tint) return [light, light, light];
    const tint = colour((height - view.range[0]) / (view.range[1] - view.range[0]));
    return tint.map((part) => Math.min((0.25 + 0.6 * part) * (light / sun[2]) ** 1.5, 1));
  }
}
