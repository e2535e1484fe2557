// The page: inputs, the job, and the terrain that it makes.

import { dial } from "./dial.js";
import { input, load } from "./inputs.js";
import { program, start } from "./job.js";
import { parse, picture } from "./maps.js";
import { terrain } from "./terrain.js";

const $ = (id) => document.getElementById(id);
const EXAMPLE = { image: "example_image.tif", coarse: "example_coarse.tif" };
const [DTM, ERRORS, MAPS, SHADE] = ["dtm.tif", "errors.tif", "maps.bin", "dtm_hillshade.png"];
let job, looking;

const image = input($("drop-image"), look);
const coarse = input($("drop-coarse"), look);
const truth = input($("drop-truth"), () => {});
const model = input($("drop-model"), () => {});
const show = terrain();
const showSun = dial($("image-sun"), (azimuth_deg) => {
  $("image-azimuth").value = azimuth_deg;
  sunGiven();
});

/** Says whether a DTM can be made. */
function ready() {
  $("predict").disabled = job !== undefined || !image.found.main || !coarse.found.main;
}

/** Looks at new inputs: draws the image under the arrow, or says what is wrong with them. */
async function look() {
  ready();
  if ($("predict").disabled) return;
  looking?.stop();
  const mine = start([["view", ...ofInputs(), "-o", MAPS, "--quiet"]], { ...image.found.files, ...coarse.found.files }, [MAPS], hear);
  looking = mine;
  try {
    const { files } = await mine.done;
    $("errors").textContent = "";
    showSun(Number($("image-azimuth").value), 0, picture(parse(files[MAPS])));
  } catch (error) {
    if (looking === mine) fail(error);
  }
}

/** The user has chosen a Sun. */
function sunGiven() {
  document.querySelector("[name=sun][value=given]").checked = true;
  showSun(Number($("image-azimuth").value));
}
["image-azimuth", "image-elevation"].forEach((id) => $(id).addEventListener("input", sunGiven));
showSun(315);

$("example").addEventListener("click", async () => {
  try {
    say("loading the example");
    const [i, c] = await Promise.all([load(EXAMPLE.image), load(EXAMPLE.coarse)]);
    image.set({ [EXAMPLE.image]: i }, ", the example");
    coarse.set({ [EXAMPLE.coarse]: c }, ", the example");
    truth.set({}, "");
    document.querySelector("[name=sun][value=fit]").checked = true;
    await predict();
  } catch (error) {
    fail(error);
  }
});
$("predict").addEventListener("click", () => predict().catch(fail));
$("cancel").addEventListener("click", () => job?.stop());

function say(text) {
  $("status").textContent = text;
}

function fail(error) {
  say("");
  $("errors").textContent = error.message === "stopped" ? "Stopped. Nothing was made." : error.message;
}

/** Returns the words of a command about the inputs. */
function ofInputs() {
  const words = ["--image", image.found.main, "--coarse", coarse.found.main];
  if (document.querySelector("[name=sun]:checked").value === "given") {
    words.push("--sun-azimuth", $("image-azimuth").value, "--sun-elevation", $("image-elevation").value);
  }
  return words;
}

async function predict() {
  const begun = performance.now();
  ["errors", "status"].forEach((id) => ($(id).textContent = ""));
  $("warnings").replaceChildren();
  $("warnings").hidden = true;
  if (!model.found.main) model.set({ "nano.eld": await load("nano.eld") }, ", of this page");
  const inputs = [image, coarse, truth, model].map(({ found }) => found.files);
  const twice = inputs.flatMap(Object.keys).find((name, i, names) => names.indexOf(name) !== i);
  if (twice) throw new Error(`${twice}: two inputs have this name; give one of them another`);
  await program();
  const made = ["predict", ...ofInputs(), "--model", model.found.main, "--uncertainty", ERRORS, "-o", DTM];
  const beside = truth.found.main ? ["--truth", truth.found.main] : [];
  const view = ["view", ...ofInputs(), "--dtm", DTM, "--uncertainty", ERRORS, ...beside, "-o", MAPS];
  const files = Object.assign({}, ...inputs);
  job = start([[...made, "--json", "--progress", "json"], [...view, "--quiet"]], files, [DTM, ERRORS, MAPS, SHADE], hear);
  [$("cancel").disabled, $("example").disabled] = [false, true];
  ready();
  try {
    const { outs, files } = await job.done;
    found(JSON.parse(outs[0]), parse(files[MAPS]));
    offer(files);
    $("command").textContent = ["elunar", ...made].join(" ");
    say(`done in ${((performance.now() - begun) / 1000).toFixed(1)} s`);
  } finally {
    job = undefined;
    [$("cancel").disabled, $("example").disabled, $("progress").value] = [true, false, 0];
    ready();
  }
}

/** Shows what the program says while it works. */
function hear({ progress, warning }) {
  if (progress) {
    $("progress").value = progress.all ? progress.done / progress.all : 0;
    say(`${progress.what || "tiles"}: ${progress.done} of ${progress.all} ${progress.unit}`);
  }
  if (warning) {
    $("warnings").hidden = false;
    $("warnings").append(Object.assign(document.createElement("li"), { textContent: warning }));
  }
}

/** Shows a finished job. */
function found(record, maps) {
  $("record").textContent = JSON.stringify(record, null, 1);
  const { light } = record;
  if (light) {
    [$("image-azimuth").value, $("image-elevation").value] = [light.azimuth_deg, light.elevation_deg].map(Math.round);
    showSun(light.azimuth_deg, light.azimuth_sd_deg, picture(maps));
    const spread = light.azimuth_sd_deg > 0 ? ` ± ${light.azimuth_sd_deg.toFixed(0)}°` : "°";
    const factor = Math.exp(light.log_strength_sd).toFixed(2);
    $("sun-found").textContent = `${light.source}: azimuth ${light.azimuth_deg.toFixed(0)}${spread}, `
      + `elevation ${light.elevation_deg.toFixed(0)}°, strength uncertain by a factor of ${factor}`;
  }
  $("result").hidden = false;
  show(maps, light?.azimuth_deg ?? 315);
}

/** Offers the files for download. */
function offer(files) {
  $("downloads").querySelectorAll("a").forEach((link) => URL.revokeObjectURL(link.href));
  const says = { [DTM]: "DTM", [ERRORS]: "expected errors", [SHADE]: "hillshade" };
  const links = Object.entries(says).filter(([name]) => files[name]).map(([name, what]) => {
    const link = Object.assign(document.createElement("a"), { className: "button", download: name });
    link.href = URL.createObjectURL(new Blob([files[name]], { type: "application/octet-stream" }));
    link.textContent = `${what}: ${name} (${(files[name].length / 1000).toFixed(0)} kB)`;
    return link;
  });
  $("downloads").replaceChildren(...links);
}
