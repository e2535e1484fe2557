#!/usr/bin/env bash
# Makes the tables of the shipped `nano` and `ground` anew, and writes them into docs/accuracy.md and the README:
#
#   host-train/models/card.sh DATA OUT
#
# DATA: data of other origin (suites/external.py says what a folder must hold). OUT gets scenes, DTMs and tables. What lies there already is not made
# again, so remove what a new model changes: OUT/*.done. PROGRAM: host-train (default: built by cargo). Needs python3 with numpy, scipy and
# rasterio.
set -euo pipefail
[ $# = 2 ] || { sed -n '2,7s/^# \{0,1\}//p' "$0"; exit 64; }
here="$(cd "$(dirname "$0")/.." && pwd)"
data="$(realpath "$1")"
mkdir -p "$2"
out="$(realpath "$2")"
cd "$here/.."
nano=host-train/models/nano.eld
models=(--model "nano=$nano" --model ground=host-train/models/ground.eld)
run() { if [ -n "${PROGRAM:-}" ]; then "$PROGRAM" "$@"; else cargo run --release --quiet --package host-train -- "$@"; fi; }
# $1: a part's name, the rest: its command. Runs it unless it is done.
part() {
    [ ! -e "$out/$1.done" ] || return 0
    echo "$1" >&2
    "${@:2}" >"$out/$1.txt" 2>&1 || { tail -3 "$out/$1.txt" >&2; exit 1; }
    touch "$out/$1.done"
}
# $1: a suite of scenes with a known Sun. Scores the models with the Sun told and fitted.
both() {
    part "$1" run suite --suite "$out/lists/$1.toml" "${models[@]}" --out "$out/$1"
    part "$1-hide" run suite --suite "$out/lists/$1.toml" --hide-sun "${models[@]}" --out "$out/$1-hide"
}
# $1: name of an image and its coarse DTM with truth, $2: the part that has them. Scores heights and expected errors.
sure() {
    local dtm="$out/sure/$2/$1" scenes="$out/$2/scenes"
    run predict --fit-sun --image "$scenes/$1_image.tif" --coarse "$scenes/$1_coarse.tif" --model "$nano" -o "$dtm.tif" \
        --uncertainty "${dtm}_e.tif" &&
        run evaluate --dtm "$dtm.tif" --truth "$scenes/$1_truth.tif" --uncertainty "${dtm}_e.tif" >"$dtm.txt"
}
all_sure() {
    local image part
    for part in real real-erring suite; do
        mkdir -p "$out/sure/$part"
        for image in "$out/$part"/scenes/*_image.tif; do sure "$(basename "$image" _image.tif)" "$part" || return; done
    done
}
part lists python3 "$here/suites/external.py" "$data" "$out/lists"
part real run suite --real "$data/real" "${models[@]}" --linear-own --out "$out/real"
part real-azimuth run suite --suite "$out/lists/real-azimuth.toml" "${models[@]}" --out "$out/real-azimuth"
for list in real-erring real-erring-azimuth; do part "$list" run suite --suite "$out/lists/$list.toml" "${models[@]}" --out "$out/$list"; done
for list in real real-azimuth real-erring real-erring-azimuth; do
    part "$list-free" run suite --suite "$out/lists/$list.toml" --no-anchor "${models[@]}" --out "$out/$list-free"
done
for list in variants unrelated unrelated-azimuth noise; do part "$list" run suite --suite "$out/lists/$list.toml" --model ground=host-train/models/ground.eld --out "$out/$list"; done
for list in apollo15 independent stereolunar; do both "$list"; done
part nac run suite --suite "$out/lists/nac.toml" --model "nano=$nano" --out "$out/nac"
part real-sfs "$here/suites/sfs.sh" "$out/real-sfs" --real "$data/real"
part real-tuned env WEIGHTS="1 0.5" "$here/suites/sfs.sh" "$out/real-tuned" --real "$data/real"
part real-against run suite --real "$data/real" --model "nano=$nano" --against "sfs=$out/real-sfs/sfs" --against "tuned=$out/real-tuned/sfs" \
    --out "$out/real-against"
for list in held-out landforms limits; do part "sfs-$list" "$here/suites/sfs.sh" "$out/sfs-$list" "$here/suites/$list.toml"; done
part suite run suite --against "sfs=$out/sfs-held-out/sfs" --linear-bound --model float=host-train/models/nano.safetensors --model "int8=$nano" \
    --model ground=host-train/models/ground.eld --out "$out/suite"
part landforms run suite --suite "$here/suites/landforms.toml" --against "sfs=$out/sfs-landforms/sfs" --linear-bound "${models[@]}" \
    --out "$out/landforms"
part suite-free run suite --no-anchor "${models[@]}" --out "$out/suite-free"
part limits run suite --suite "$here/suites/limits.toml" --against "sfs=$out/sfs-limits/sfs" --model "nano=$nano" --out "$out/limits"
part sure all_sure
for list in apollo15 independent stereolunar; do
    part "$list-free" run suite --suite "$out/lists/$list.toml" --no-anchor "${models[@]}" --out "$out/$list-free"
done
for what in anchor sigma ceiling means fields; do part "$what" python3 "$here/suites/estimates.py" "$out" "$what"; done
python3 "$here/models/card.py" "$out"
