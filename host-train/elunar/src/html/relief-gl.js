// The relief by WebGL 2: a grid of triangles from textures of heights and gradients.

import { ramp } from "./colours.js";
import { sunVector } from "./shading.js";

const COMMON = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D;
uniform sampler2D u_ground[3]; // of the three slots: height, gradient east, gradient south, whether known
uniform bool u_grey[3];        // whether the slot shows the image
uniform vec2 u_divide;
int slot(float u) { return u < u_divide.x ? 0 : u < u_divide.y ? 1 : 2; }
vec4 ground(int slot, ivec2 pixel) {
  return slot == 0 ? texelFetch(u_ground[0], pixel, 0) : slot == 1 ? texelFetch(u_ground[1], pixel, 0) : texelFetch(u_ground[2], pixel, 0);
}
`;
const VERTEX = `${COMMON}
uniform ivec2 u_cells; uniform mat3 u_turn; uniform vec2 u_half; uniform vec3 u_up; // middle height, scale, half the depth
uniform ivec2 u_size;
out vec2 v_at;
void main() {
  int cell = gl_VertexID / 6, corner = gl_VertexID % 6;
  ivec2 at = ivec2(cell % u_cells.x, cell / u_cells.x);
  at += ivec2(corner == 1 || corner == 4 || corner == 5, corner == 2 || corner == 3 || corner == 5);
  v_at = vec2(at) / vec2(u_cells);
  ivec2 pixel = min(ivec2(v_at * vec2(u_size)), u_size - 1);
  float height = ground(slot(v_at.x), pixel).r;
  float up = isnan(height) ? 0.0 : (height - u_up.x) * u_up.y;
  vec3 place = u_turn * vec3((v_at * 2.0 - 1.0) * vec2(u_half.x, -u_half.y), up);
  gl_Position = vec4(place.xy / u_half, -place.z / u_up.z, 1.0);
}`;
const FRAGMENT = `${COMMON}
uniform sampler2D u_image, u_hazard, u_ramp;
uniform vec3 u_sun; uniform vec4 u_range; uniform float u_exaggeration; uniform bool u_tint;
uniform ivec2 u_size;
in vec2 v_at;
out vec4 colour;
vec4 sample_of(int shown, ivec2 pixel) { return shown < 0 ? texelFetch(u_image, pixel, 0) : ground(shown, pixel); }
vec4 at(int shown, vec2 place) { // the mean of four pixels, as the hillshade of each; below 0: of the image
  vec2 p = clamp(place * vec2(u_size) - 0.5, vec2(0.0), vec2(u_size - 1));
  ivec2 i = ivec2(p), j = min(i + 1, u_size - 1); vec2 f = p - vec2(i);
  return mix(mix(sample_of(shown, i), sample_of(shown, ivec2(j.x, i.y)), f.x),
             mix(sample_of(shown, ivec2(i.x, j.y)), sample_of(shown, j), f.x), f.y);
}
void main() {
  int shown = slot(v_at.x);
  vec3 found;
  if (shown == 0 ? u_grey[0] : shown == 1 ? u_grey[1] : u_grey[2]) {
    float grey = (at(-1, v_at).r - u_range.z) / (u_range.w - u_range.z);
    found = vec3(isnan(grey) ? 0.0 : clamp(grey, 0.0, 1.0));
  } else {
    vec4 s = at(shown, v_at);
    if (!(s.w > 0.0) || isnan(s.x)) { colour = vec4(0.0, 0.0, 0.0, 1.0); return; }
    vec2 slope = s.yz / s.w * u_exaggeration;
    float light = (1.0 + 254.0 * max(0.0, dot(normalize(vec3(-slope.x, slope.y, 1.0)), u_sun))) / 255.0;
    vec3 tint = texture(u_ramp, vec2(clamp((s.x - u_range.x) / (u_range.y - u_range.x), 0.0, 1.0), 0.5)).rgb;
    found = u_tint ? min((0.25 + 0.6 * tint) * pow(light / u_sun.z, 1.5), vec3(1.0)) : vec3(light);
  }
  vec4 hazard = texture(u_hazard, v_at);
  colour = vec4(mix(found, hazard.rgb, hazard.a), 1.0);
}`;

/** Returns something that draws, or nothing if the browser has no WebGL 2. */
export function withGl(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) return undefined;
  const program = link(gl);
  const place = (name) => gl.getUniformLocation(program, name);
  gl.useProgram(program);
  gl.enable(gl.DEPTH_TEST);
  gl.uniform1iv(place("u_ground"), [0, 1, 2]);
  ["u_image", "u_hazard", "u_ramp"].forEach((name, k) => gl.uniform1i(place(name), 3 + k));
  texture(gl, 5, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, 256, 1, ramp());
  let [maps, grounds] = [undefined, []];

  return {
    name: "WebGL",
    /** Takes maps: rows, cols, pixel, layers ({image} or {surface}, see shading.js), main (the layer whose ground the image lies on). */
    take(taken) {
      maps = taken;
      grounds.forEach((ground) => gl.deleteTexture(ground));
      grounds = [];
      const image = maps.layers.find(({ image }) => image)?.image ?? new Float32Array(maps.rows * maps.cols);
      texture(gl, 3, gl.R32F, gl.RED, gl.FLOAT, maps.cols, maps.rows, image);
      this.lay(new Uint8Array(4 * maps.rows * maps.cols));
    },
    /** Takes the colours laid over the ground: RGBA bytes. */
    lay(colours) {
      texture(gl, 4, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, maps.cols, maps.rows, colours);
    },
    draw(view) {
      const { rows, cols, row_m, col_m } = maps;
      const cells = [Math.min(cols, 1024), Math.min(rows, 1024)];
      const half = [(cols * col_m) / 2, (rows * row_m) / 2];
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(0, 0, 0, 1);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.uniform2i(place("u_cells"), ...cells);
      gl.uniform2i(place("u_size"), cols, rows);
      gl.uniform2f(place("u_half"), ...half);
      gl.uniform3f(place("u_up"), (view.range[0] + view.range[1]) / 2, view.exaggeration, 4 * (half[0] + half[1]));
      gl.uniformMatrix3fv(place("u_turn"), false, turned(view.tilt_deg, view.turn_deg));
      gl.uniform1iv(place("u_grey"), view.slots.map((layer) => (maps.layers[layer].image ? 1 : 0)));
      gl.uniform2f(place("u_divide"), ...view.divide);
      view.slots.forEach((layer, slot) => show(maps.layers[layer].image ? maps.main : layer, slot));
      gl.uniform3f(place("u_sun"), ...sunVector(view.azimuth_deg, view.elevation_deg));
      gl.uniform4f(place("u_range"), ...view.range, ...view.image_range);
      gl.uniform1f(place("u_exaggeration"), view.exaggeration);
      gl.uniform1i(place("u_tint"), view.tint ? 1 : 0);
      gl.drawArrays(gl.TRIANGLES, 0, 6 * cells[0] * cells[1]);
    },
  };

  /** Puts the ground of a layer into a slot. A layer that nobody looks at needs no memory of the card. */
  function show(layer, slot) {
    if (grounds[layer]) {
      gl.activeTexture(gl.TEXTURE0 + slot);
      gl.bindTexture(gl.TEXTURE_2D, grounds[layer]);
    } else {
      grounds[layer] = texture(gl, slot, gl.RGBA32F, gl.RGBA, gl.FLOAT, maps.cols, maps.rows, maps.layers[layer].surface());
    }
  }
}

/** Columns of a matrix: turned about the vertical, then tilted back. */
function turned(tilt_deg, turn_deg) {
  const [t, r] = [(tilt_deg * Math.PI) / 180, (turn_deg * Math.PI) / 180];
  const [ct, st, cr, sr] = [Math.cos(t), Math.sin(t), Math.cos(r), Math.sin(r)];
  return [cr, sr * ct, -sr * st, -sr, cr * ct, -cr * st, 0, st, ct];
}

function texture(gl, unit, inside, format, type, cols, rows, data) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  const filter = type === gl.FLOAT ? gl.NEAREST : gl.LINEAR;
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  gl.texImage2D(gl.TEXTURE_2D, 0, inside, cols, rows, 0, format, type, data);
  return made;
}

function link(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}
