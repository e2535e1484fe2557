// Colours of heights: from the map "cividis" (Nuñez, Anderton, Renslow 2018), made for colour-blind readers, a little brighter under the shade.
const STOPS = [[0, 34, 78], [26, 56, 111], [67, 78, 108], [98, 101, 111], [127, 125, 120], [158, 151, 115], [191, 178, 99], [226, 206, 76], [254, 232, 56]];

/** Returns the colour of a share, 0 to 1, as three numbers of 0 to 1. */
export function colour(share) {
  const at = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1);
  const i = Math.min(Math.floor(at), STOPS.length - 2);
  return STOPS[i].map((low, k) => (low + (STOPS[i + 1][k] - low) * (at - i)) / 255);
}

/** Returns a row of 256 colours, RGBA bytes. */
export function ramp() {
  return Uint8Array.from({ length: 1024 }, (_, i) => (i % 4 === 3 ? 255 : Math.round(255 * colour(Math.floor(i / 4) / 255)[i % 4])));
}
