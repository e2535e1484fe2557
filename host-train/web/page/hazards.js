// Ground that is too steep or too rough for a vehicle, as colours over the relief.

const COLOURS = [[0, 0, 0, 0], [217, 95, 2, 150], [59, 111, 212, 150], [138, 103, 107, 190]];

/** Returns RGBA bytes, and the share of known pixels without a hazard. */
export function hazards({ slope, roughness }, slope_deg, roughness_m, shown) {
  const colours = new Uint8Array(4 * slope.length);
  let [known, safe] = [0, 0];
  for (let i = 0; i < slope.length; i++) {
    if (!Number.isFinite(slope[i])) continue;
    const code = (slope[i] > slope_deg ? 1 : 0) + (roughness[i] > roughness_m ? 2 : 0);
    known++;
    if (code === 0) safe++;
    else if (shown) colours.set(COLOURS[code], 4 * i);
  }
  return { colours, safe: known ? safe / known : 0 };
}
