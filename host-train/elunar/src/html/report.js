// The scenes that a report holds (html/relief.rs), shown as a relief.

import { $, relief } from "./relief.js";

/** Unpacks samples: 16-bit codes, low bytes then high ones, each the zigzag difference to what the pixels left and above say. */
async function samples({ low, step, codes }, rows, cols) {
  const packed = Uint8Array.from(atob(codes), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = rows * cols;
  const [found, out] = [new Uint16Array(size), new Float32Array(size)];
  for (let i = 0; i < size; i++) {
    const folded = bytes[i] + 256 * bytes[size + i];
    const [left, up] = [i % cols !== 0, i >= cols];
    const said = (left ? found[i - 1] : 0) + (up ? found[i - cols] : 0) - (left && up ? found[i - cols - 1] : 0);
    found[i] = said + ((folded >>> 1) ^ -(folded & 1));
    out[i] = found[i] === 65535 ? NaN : low + step * found[i];
  }
  return out;
}

async function opened({ rows, cols, layers, sigma, slots, main, coarse, truth, ...rest }) {
  const all = await Promise.all(layers.map(async ({ name, is_image, map }) => {
    const found = await samples(map, rows, cols);
    return is_image ? { name, image: found } : { name, heights: found };
  }));
  const of = (layer) => (layer === null ? undefined : all[layer].heights);
  const profile = { heights: of(main), coarse: of(coarse), truth: of(truth), sigma: sigma ? await samples(sigma, rows, cols) : undefined };
  return { ...rest, rows, cols, layers: all, slots, profile };
}

const scenes = JSON.parse($("relief-data").textContent);
const view = relief($("terrain"));
const choose = async (k) => {
  view.show(await opened(scenes[k]));
  $("terrain").dataset.shown = k;
};
if (scenes.length > 1) {
  const select = document.createElement("select");
  select.id = "scene";
  select.append(...scenes.map(({ title }, k) => new Option(title, k)));
  select.addEventListener("input", () => choose(Number(select.value)));
  const label = document.createElement("label");
  label.append("Scene ", select);
  $("terrain").before(label);
}
choose(0);
