// A job: commands of the program, one after the other, in a Web Worker. It can be stopped at any time.

import { load } from "./inputs.js";

// A module with one instruction of SIMD: where it is valid, the program that has a kernel for it runs.
const SIMD = [0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11];

let module;

/** Returns the program, loaded and compiled at the first call. */
export function program() {
  const name = WebAssembly.validate(Uint8Array.from(SIMD)) ? "elunar-simd128.wasm.gz" : "elunar.wasm.gz";
  module ??= load(name).then(unpacked).then((bytes) => WebAssembly.compile(bytes));
  return module;
}

/** Returns the bytes of a gzip file; some servers have unpacked it already. */
async function unpacked(bytes) {
  if (bytes[0] !== 0x1f) return bytes;
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

/**
 * Starts a job.
 * @param commands command lines without the program's name
 * @param files bytes by name
 * @param take names of the files to return
 * @param hear is given what the program says: {progress}, {warning} or {note}
 * @returns {{done: Promise, stop: function}} `done` gives {outs, files}; it fails with what the program says, or "stopped"
 */
export function start(commands, files, take, hear) {
  const worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
  let refuse;
  const done = new Promise((resolve, reject) => {
    refuse = reject;
    const errors = [];
    worker.onerror = (event) => reject(new Error(event.message ?? "the worker could not be started"));
    worker.onmessage = ({ data }) => {
      if (data.line?.startsWith("ERROR: ")) errors.push(data.line.slice(7));
      else if (data.line?.startsWith("{")) hear(JSON.parse(data.line));
      else if (data.code === 0) resolve(data);
      else if (data.code !== undefined) reject(new Error(errors.join("\n") || `the program ended with ${data.code}`));
    };
    program().then((module) => worker.postMessage({ module, commands, files, take }), reject);
  });
  const end = () => worker.terminate();
  done.then(end, end);
  return { done, stop: () => refuse(new Error("stopped")) };
}
