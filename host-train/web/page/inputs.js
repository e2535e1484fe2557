// The files that the user gives: by a dialogue or by dropping them.

/** Watches a place for files; `changed` is called when there are new ones. Returns what tells them. */
export function input(place, changed) {
  const [field, said] = [place.querySelector("input"), place.querySelector("output")];
  const found = { files: {}, main: undefined };
  async function take(list) {
    const files = [...list];
    if (files.length === 0) return;
    const read = async (file) => [file.name, new Uint8Array(await file.arrayBuffer())];
    set(Object.fromEntries(await Promise.all(files.map(read))));
    changed();
  }
  function set(files, note = "") {
    const names = Object.keys(files);
    // A label says where its image is.
    found.main = names.find((name) => /\.(lbl|tiff?)$/i.test(name)) ?? names[0];
    found.files = files;
    const size = Object.values(files).reduce((sum, bytes) => sum + bytes.length, 0);
    said.textContent = names.length === 0 ? "" : `${names.join(", ")} (${(size / 1000).toFixed(0)} kB)${note}`;
  }
  field.addEventListener("change", () => take(field.files));
  place.addEventListener("dragover", (event) => {
    event.preventDefault();
    place.classList.add("over");
  });
  place.addEventListener("dragleave", () => place.classList.remove("over"));
  place.addEventListener("drop", (event) => {
    event.preventDefault();
    place.classList.remove("over");
    take(event.dataTransfer.files);
  });
  return { found, set };
}

/** Loads a file of this page. */
export async function load(name) {
  const found = await fetch(name);
  if (!found.ok) throw new Error(`${name}: the server says ${found.status}`);
  return new Uint8Array(await found.arrayBuffer());
}
