#!/usr/bin/env bash
# Everything about one machine with a GPU: is training right there, how fast is it, beside PyTorch; then training for the time that is left.
#
#   benches/gpu.sh [--program P] [--minutes M] [--backends "cuda vulkan"] [--presets "nano tiny small paper"] [--out DIR] [--run DIR]
#
# P: the program `host-train`, or one packed as .xz [target/gpu/host-train, otherwise target/release/host-train]. It may have been built
# elsewhere; nothing is built here. M: minutes in all [9]; what is left of them trains `nano` in the folder of --run [out/gpu-run], which
# the next call goes on with. Each trial has a limit and a line of its own: one that panics, hangs or lacks a library loses no other.
# Results go to --out [benches/record/<GPU>/<date>-gpu]. PyTorch's steps need python3 with torch, numpy and safetensors.
set -euo pipefail
cd "$(dirname "$0")/.."
fail() { printf 'ERROR: gpu.sh: %s\n' "$*" >&2; exit 64; }
program="" minutes=9 backends="" presets="nano tiny small paper" out="" run=out/gpu-run command="benches/gpu.sh $*"
while [ $# -gt 0 ]; do
    [ $# -gt 1 ] || fail "$1: expected a value, found none"
    case "$1" in
    --program) program="$2" ;;
    --minutes) minutes="$2" ;;
    --backends) backends="$2" ;;
    --presets) presets="$2" ;;
    --out) out="$2" ;;
    --run) run="$2" ;;
    *) fail "$1: expected --program, --minutes, --backends, --presets, --out or --run" ;;
    esac
    shift 2
done
case "$minutes" in '' | *[!0-9]* | 0) fail "--minutes: expected a whole number above 0, found '$minutes'" ;; esac

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
export XDG_RUNTIME_DIR="${XDG_RUNTIME_DIR:-$work}" # Vulkan's loader complains without one
for one in target/gpu/host-train target/release/host-train; do
    if [ -z "$program" ] && [ -x "$one" ]; then program="$one"; fi
done
[ -f "$program" ] || fail "--program: expected the program host-train, found ${program:-none}"
case "$program" in
*.xz) xz -dc "$program" >"$work/host-train" && chmod +x "$work/host-train" ;;
*) ln -s "$(realpath "$program")" "$work/host-train" ;;
esac
host_train="$work/host-train"
"$host_train" --version >/dev/null || fail "$program: expected a program that starts here"

gpu="$(nvidia-smi --query-gpu=name --format=csv,noheader 2>/dev/null | head -1 || true)"
[ -n "$gpu" ] || gpu="$("$host_train" devices | awk '$3 == "GPU" { $1 = $2 = $3 = $4 = ""; print; exit }' | sed 's/^ *//')"
[ -n "$gpu" ] || gpu="no GPU"
name="$(tr '[:upper:]' '[:lower:]' <<<"$gpu" | sed 's/[^a-z0-9][^a-z0-9]*/-/g; s/^-//; s/-$//')"
date="$(date -u +%Y-%m-%d)"
[ -n "$out" ] || out="benches/record/$name/$date-gpu"
mkdir -p "$out"
: >"$work/lines"
: >"$work/trials"

left() { echo $((60 * minutes - SECONDS)); }
# trial SECONDS NAME COMMAND...: runs it within a limit. Its JSON lines go to $work/lines, its end to $out/log.txt.
trial() {
    local limit="$1" what="$2" rc=0 begun=$SECONDS
    shift 2
    if [ "$(left)" -lt 15 ]; then
        echo "$what,skipped: no time left," >>"$work/trials"
        return 1
    fi
    [ "$limit" -lt "$(left)" ] || limit="$(left)"
    timeout -k 5 "$limit" "$@" >"$work/one" 2>&1 || rc=$?
    { echo "== $what"; tail -n 30 "$work/one"; } >>"$out/log.txt"
    case "$rc" in
    0) echo "$what,passed,$((SECONDS - begun))" ;;
    124 | 137) echo "$what,over the limit of $limit s,$((SECONDS - begun))" ;;
    *) echo "$what,failed: $(grep -iE 'error|panic' "$work/one" | head -1 | tr ',"\r' '; ' | cut -c1-200),$((SECONDS - begun))" ;;
    esac | tee -a "$work/trials" >&2
    [ "$rc" = 0 ] && grep '^{' "$work/one" >>"$work/lines"
    return "$rc"
}
# The largest memory of the GPU in use while a command runs, MiB, into $work/memory.
watched() {
    local watcher=""
    if command -v nvidia-smi >/dev/null; then
        (while sleep 0.5; do nvidia-smi --query-gpu=memory.used --format=csv,noheader,nounits | head -1; done) >"$work/used" 2>/dev/null &
        watcher=$!
    fi
    local rc=0
    "$@" || rc=$?
    [ -z "$watcher" ] || { kill "$watcher"; wait "$watcher" || true; } 2>/dev/null
    sort -n "$work/used" 2>/dev/null | tail -1 >"$work/memory" || true
    return "$rc"
}

# 1. Is it right? A backend that fails its golden files is not timed.
if [ -z "$backends" ]; then
    backends="$("$host_train" devices | awk '$3 == "GPU" { print $1 }' | sort -u | tr '\n' ' ')"
fi
[ -n "${backends// /}" ] || echo "no backend of this program finds a GPU (host-train devices): PyTorch and the feed alone" | tee -a "$out/log.txt" >&2
right=""
for backend in $backends; do
    if trial 240 "golden files on $backend" "$host_train" check --backend "$backend" tests/golden/{mini,ablations}/case.safetensors; then
        right="$right $backend"
    fi
done

# 2. How fast? PyTorch beside ours, on the same weights.
for preset in $presets; do
    "$host_train" init --preset "$preset" --set network.head=residual --seed 1 -o "$work/$preset.safetensors" >/dev/null
    if python3 -c 'import torch, safetensors, sys; sys.exit(not torch.cuda.is_available())' 2>/dev/null; then
        trial 60 "PyTorch $preset" python3 benches/peers/gpu_steps.py "$preset=$work/$preset.safetensors" || true
    else
        echo "PyTorch $preset,skipped: no python3 with torch and a CUDA device," | tee -a "$work/trials" >&2
    fi
    for backend in $right; do
        for precision in f32 bf16; do
            if watched trial 75 "steps of $preset on $backend in $precision" "$host_train" train-speed --preset "$preset" \
                --start-from "$work/$preset.safetensors" --backend "$backend" --precision "$precision"; then
                sed -i "\$s/}\$/,\"memory_mib\":$(grep . "$work/memory" || echo null)}/" "$work/lines"
            fi
        done
    done
done

# 3. What the processor feeds.
for makers in 1 "$(getconf _NPROCESSORS_ONLN)"; do
    trial 40 "feed of $makers threads" "$host_train" train-speed --makers "$makers" --count $((8 * makers)) || true
done

# 4. The record: what ran, and the tables.
{
    printf 'Training on a GPU, %s\n' "$date"
    printf '%s, driver %s; %s cores\n' "$gpu" "$(nvidia-smi --query-gpu=driver_version --format=csv,noheader 2>/dev/null | head -1 || echo none)" \
        "$(getconf _NPROCESSORS_ONLN)"
    printf 'Program: %s of commit %s, %s\n' "$("$host_train" --version)" "$(git rev-parse --short HEAD 2>/dev/null || echo unknown)" \
        "$(basename "$program")"
    printf 'Command: %s\n' "$command"
} >"$out/about.txt"
{ echo 'trial,result,seconds'; cat "$work/trials"; } >"$out/trials.csv"
python3 - "$work/lines" "$out" <<'EOF'
import csv, json, sys
lines, out = [json.loads(line) for line in open(sys.argv[1])], sys.argv[2]
def write(name, head, rows):
    if rows:
        with open(f"{out}/{name}.csv", "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *rows])
steps = [l for l in lines if "makers" not in l]
best = {}
for l in steps:
    if "PyTorch" in l.get("trainer", ""):
        key = l["preset"], l["precision"]
        best[key] = max(best.get(key, 0), l.get("steps_per_s", 0))
rows = []
for l in steps:
    peer = best.get((l["preset"], l["precision"]))
    rate = l.get("steps_per_s")
    ratio = f"{rate / peer:.2f}" if peer and rate else ""
    rows.append([l["preset"], l.get("trainer") or f"ours, {l['backend']}", l["precision"], f"{l['batch']} of {l['crop'][0]} x {l['crop'][1]}",
                 f"{rate:.2f}" if rate else l.get("error", ""), ratio, l.get("memory_mib") or "", f"{l.get('untimed_s', 0):.1f}",
                 " ".join(f"{x:.5g}" for x in l.get("first_losses", []))])
write("steps", ["preset", "trainer", "precision", "batch", "steps/s", "over PyTorch's fastest", "memory, MiB", "untimed, s", "first losses"], rows)
write("feed", ["makers", "batch", "batches/s"], [[l["makers"], l["batch"], f"{l['batches_per_s']:.2f}"] for l in lines if "makers" in l])
EOF

# 5. Training with the time that is left; Ctrl-C's signal makes it write a checkpoint.
read -r backend _ <<<"$right" || true
if [ -n "$backend" ] && [ "$(left)" -gt 30 ]; then
    begin=(--preset nano --backend "$backend" --steps 60000 --set recipe.checkpoint_minutes=2 recipe.checkpoint_every=1000000 recipe.validate_every=2000)
    [ ! -f "$run/checkpoint/state.json" ] || begin=(--resume)
    echo "training nano on $backend in $run for $(($(left) - 20)) s" >&2
    timeout -s INT -k 20 $(($(left) - 20)) "$host_train" train --out "$run" --profile "${begin[@]}" >"$work/train" 2>&1 || true
    tail -n 30 "$work/train" >>"$out/log.txt"
    tail -n 3 "$work/train" >&2
fi
echo "record: $out"
