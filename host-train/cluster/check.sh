#!/usr/bin/env bash
# Scenes on a Slurm cluster of three nodes on this machine, in GNU parallel and in Snakemake: check.sh PROGRAM MODEL
#
# Every DTM and the mosaic must have the SHA-256 of the serial run. Prints SKIPPED for an engine that is not installed.
set -eEuo pipefail
trap 'echo "ERROR: line $LINENO: exit code 0 expected, found $?: $BASH_COMMAND" >&2' ERR
here="$(cd "$(dirname "$0")" && pwd)"
ELUNAR="$(realpath "${1:?usage: $0 PROGRAM MODEL}")"
model="$(realpath "${2:?usage: $0 PROGRAM MODEL}")"
export ELUNAR
# Debian keeps daemons where not every user looks.
PATH="$PATH:/usr/sbin"

work="$(mktemp -d)"
small="" # a small file system, once mounted
finish() {
    "$here/slurm/test-cluster.sh" down "$work/slurm" || true
    [ -z "$small" ] || umount "$small" 2>/dev/null || true
    rm -rf "$work"
}
trap finish EXIT
cd "$work"

fail() {
    echo "ERROR: $*" >&2
    tail -n 5 "$work"/*/logs/*.err >&2 2>/dev/null || true
    exit 1
}
say() { printf '%4s s  %s\n' "$SECONDS" "$*"; }

SECONDS=0
scenes=8
"$ELUNAR" synth --out s --scenes "$scenes" --rows 560 --cols 400 --seed 3 >/dev/null
# Neighbours in a mosaic would overlap; here all scenes lie at one place, which a mosaic also joins.
echo "id,image,coarse" >table.csv
for ((i = 0; i < scenes; i++)); do printf 's%d,s/scene_%04d_image.tif,s/scene_%04d_coarse.tif\n' "$i" "$i" "$i" >>table.csv; done

# $1: folder of a run. Makes its manifest.
manifest() {
    mkdir -p "$1/logs"
    "$ELUNAR" manifest --table table.csv --model "$model" --output-dir "$1/dtms" -o "$1/m.jsonl" >/dev/null
}
# $1: folder of a run. Compares its DTMs and its mosaic with the serial run's, and looks for what a run may leave.
same() {
    local name left
    for name in "${@:2}"; do
        cmp -s "serial/dtms/$name.tif" "$1/dtms/$name.tif" || fail "$1: $name.tif: the DTM of the serial run expected, another or none found"
    done
    (cd "$1/dtms" && sha256sum --check --quiet -- *.sha256) || fail "$1: a SHA-256 does not hold"
    left="$(find "$1/dtms" -name '*.part' -o -name '*.lock' -o -name '*.rows')"
    [ -z "$left" ] || fail "$1: nothing but DTMs expected, found $left"
}
mosaic_same() { cmp -s serial/mosaic.tif "$1/mosaic.tif" || fail "$1: the mosaic of the serial run expected, another found"; }
all() { seq -f 's%g' 0 "$((scenes - 1))"; }
status() { "$ELUNAR" status --manifest "$1/m.jsonl" "$1"/logs/*.jsonl "${@:2}"; }

manifest serial
"$ELUNAR" batch --manifest serial/m.jsonl >serial/logs/a.jsonl 2>serial/logs/a.err
"$ELUNAR" status --manifest serial/m.jsonl --require 100% --done serial/list >/dev/null
"$ELUNAR" mosaic --dem-list serial/list -o serial/mosaic.tif >/dev/null
say "serial: $scenes scenes and their mosaic"

# Whether the engine of a scene is there.
slurm_missing() {
    local tool
    for tool in slurmctld slurmd munged sbatch python3; do command -v "$tool" >/dev/null || { echo "$tool"; return; }; done
}

# $@: options of sbatch before the script's own words.
submit() { sbatch --parsable --chdir="$work" --output=/dev/null "$@"; }
# $1: a job. Waits until none of its tasks is left.
await() {
    local i
    for ((i = 0; i < 600; i++)); do
        [ -n "$(squeue -h -j "$1" 2>/dev/null)" ] || return 0
        sleep 0.2
    done
    squeue >&2
    fail "job $1 did not end"
}
batches() { pgrep -f "batch --manifest $1/m.jsonl" || true; }
# $1: a run, $2: how many batches it has at once. Stops each as soon as it lives: none may end before the test disturbs them.
hold() {
    local i found
    for ((i = 0; i < 600; i++)); do
        found="$(batches "$1")"
        # shellcheck disable=SC2086
        [ -z "$found" ] || kill -STOP $found 2>/dev/null || true
        [ "$(wc -w <<<"$found")" -lt "$2" ] || return 0
        sleep 0.05
    done
    fail "$1: $2 batches alive at once expected, found $(wc -w <<<"$found")"
}
# $1: a run. Its batches go on.
release() {
    local found
    found="$(batches "$1")"
    # shellcheck disable=SC2086
    [ -z "$found" ] || kill -CONT $found 2>/dev/null || true
}

undisturbed() {
    local array join
    manifest quiet
    array="$(submit --array=1-3 -c2 "$here/slurm/array.sh" quiet/m.jsonl)"
    join="$(submit --dependency="afterany:$array" "$here/slurm/mosaic.sh" quiet/m.jsonl quiet/mosaic.tif 100%)"
    await "$array"
    await "$join"
    # shellcheck disable=SC2046
    same quiet $(all)
    mosaic_same quiet
    status quiet --html quiet/status.html --require 100% | tail -1
    say "slurm: undisturbed, with the mosaic as dependent job"
}

# Whether a task of the run was queued again: its log has a count of restarts.
again() { ls "$1"/logs/*.[1-9].jsonl >/dev/null 2>&1 || fail "$1: a second attempt at a task expected, none found"; }

node_down() {
    local array
    manifest down
    array="$(submit --array=1-3 -c4 "$here/slurm/array.sh" down/m.jsonl)"
    hold down 3
    # The controller cancels the node's job and queues it again.
    scontrol update NodeName=n1 State=DOWN Reason=test
    release down
    await "$array"
    scontrol update NodeName=n1 State=RESUME 2>/dev/null || true # it may have come back by itself
    again down
    # shellcheck disable=SC2046
    same down $(all)
    say "slurm: a node set down, its task queued again"
}

slurmd_killed() {
    local array alive
    manifest killed
    array="$(submit --array=1-3 -c4 "$here/slurm/array.sh" killed/m.jsonl)"
    hold killed 3
    # Only the daemon: its job lives on, and its output has an owner. Another attempt waits for it, or finds its work.
    kill -KILL "$(cat slurm/run/slurmd.n2.pid)"
    sleep 1
    alive="$(batches killed | wc -l)"
    [ "$alive" = 3 ] || fail "killed: three batches alive expected, $alive found"
    scontrol update NodeName=n2 State=DOWN Reason=test
    release killed
    await "$array"
    again killed
    # The orphan may still be at work.
    "$ELUNAR" batch --manifest killed/m.jsonl --wait 60 >killed/logs/last.jsonl 2>killed/logs/last.err || fail "killed: not all items are done"
    # shellcheck disable=SC2046
    same killed $(all)
    say "slurm: a slurmd killed, its job left alive"
    SLURM_CONF="$work/slurm/slurm.conf" slurmd -N n2
    scontrol update NodeName=n2 State=RESUME 2>/dev/null || true
}

full_disk() {
    local code=0
    manifest full
    small="$work/full/dtms"
    mkdir -p "$small"
    if ! mount -t tmpfs -o size=2m tmpfs "$small" 2>/dev/null; then
        small=""
        echo "SKIPPED: the scene of a full disk: a small file system cannot be mounted here"
        return
    fi
    RETRIES=0 WAIT=0 submit --wait --array=1-1 -c2 "$here/slurm/array.sh" full/m.jsonl >/dev/null || code=$?
    [ "$code" = 75 ] || fail "full: exit code 75 expected, $code found"
    [ -z "$(find full/dtms -name '*.tif' -size -2k)" ] || fail "full: a stub of a DTM was left"
    status full >full/text || true
    grep -q "No space left" full/text || fail "full: the error of a full disk expected, found: $(cat full/text)"
    # What was finished is whole; with room, the same command goes on.
    for one in full/dtms/*.tif; do
        [ ! -f "$one" ] || (cd full/dtms && sha256sum --check --quiet "$(basename "$one").sha256") || fail "full: $one is no whole DTM"
    done
    mount -o remount,size=200m "$small"
    RETRIES=0 WAIT=0 submit --wait --array=1-1 -c2 "$here/slurm/array.sh" full/m.jsonl >/dev/null || fail "full: not all items are done with room"
    # shellcheck disable=SC2046
    same full $(all)
    umount "$small"
    small=""
    say "slurm: a full disk of 2 MB, then room"
}

broken_input() {
    local code=0 broken
    cp -r s broken-s
    head -c 20000 s/scene_0003_image.tif >broken-s/scene_0003_image.tif
    mkdir -p broken/logs
    sed 's|,s/|,broken-s/|g' table.csv >broken/table.csv
    "$ELUNAR" manifest --table broken/table.csv --model "$model" --output-dir broken/dtms -o broken/m.jsonl >/dev/null
    broken="$(submit --array=1-3 -c2 "$here/slurm/array.sh" broken/m.jsonl)"
    await "$broken"
    # shellcheck disable=SC2046
    same broken $(all | grep -v '^s3$')
    [ ! -e broken/dtms/s3.tif ] || fail "broken: a DTM of a broken image was made"
    status broken --require 100% >broken/text 2>broken/error || code=$?
    if [ "$code" != 65 ] || ! grep -q "bad input.*scene_0003_image" broken/text; then fail "broken: $code: $(cat broken/text)"; fi
    status broken --require 85% >/dev/null || fail "broken: 7 of 8 items are enough for 85 %"
    say "slurm: one broken input costs its item alone"
}

in_parts() {
    local n array image=s/scene_0002_image.tif coarse=s/scene_0002_coarse.tif
    mkdir -p parts/dtms
    for n in 1 2 5; do
        array="$(submit --array="1-$n" -c1 "$here/slurm/parts.sh" --image "$image" --coarse "$coarse" --model "$model" -o parts/dtms/s2.tif)"
        await "$array"
        "$ELUNAR" join --parts "$n" --image "$image" --coarse "$coarse" --model "$model" -o parts/dtms/s2.tif >/dev/null
        same parts s2
        rm parts/dtms/s2*
    done
    say "slurm: one image in 1, 2 and 5 parts"
}

gnu_parallel() {
    if ! command -v parallel >/dev/null; then echo "SKIPPED: GNU parallel is not installed"; return; fi
    manifest parallel
    "$here/parallel.sh" parallel/m.jsonl --jobs 2
    # shellcheck disable=SC2046
    same parallel $(all)
    say "GNU parallel"
}

snake() {
    if ! command -v snakemake >/dev/null; then echo "SKIPPED: Snakemake is not installed"; return; fi
    manifest snake
    run() { snakemake --snakefile "$here/Snakefile" --directory "$work/snake" --cores 2 --quiet all --config program="$ELUNAR" "$@" >snake/text 2>&1; }
    run manifest="$work/snake/m.jsonl" mosaic="$work/snake/mosaic.tif" || { tail -20 snake/text >&2; fail "snake: the workflow failed"; }
    # shellcheck disable=SC2046
    same snake $(all)
    mosaic_same snake
    say "snakemake: undisturbed"
    # One broken image: the others are made, and the share decides.
    mkdir -p snake2/logs && mkdir -p broken-s && cp -n s/* broken-s/ && head -c 20000 s/scene_0003_image.tif >broken-s/scene_0003_image.tif
    sed 's|,s/|,broken-s/|g' table.csv >snake2/table.csv
    "$ELUNAR" manifest --table snake2/table.csv --model "$model" --output-dir snake2/dtms -o snake2/m.jsonl >/dev/null
    if run manifest="$work/snake2/m.jsonl" mosaic="$work/snake2/mosaic.tif"; then fail "snake2: a share of 100 % was reached with a broken image"; fi
    [ ! -e snake2/mosaic.tif ] || fail "snake2: a mosaic was made"
    run manifest="$work/snake2/m.jsonl" mosaic="$work/snake2/mosaic.tif" require=85% || { tail -20 snake/text >&2; fail "snake2: 85 % failed"; }
    # shellcheck disable=SC2046
    same snake2 $(all | grep -v '^s3$')
    say "snakemake: one broken input"
}

missing="$(slurm_missing)"
if [ -n "$missing" ]; then
    echo "SKIPPED: Slurm: no $missing (Debian packages slurmctld, slurmd, slurm-client and munge)"
elif ! "$here/slurm/test-cluster.sh" up slurm 3; then
    echo "SKIPPED: Slurm: its daemons do not start here"
else
    # shellcheck source=/dev/null
    . slurm/env
    say "slurm: three nodes"
    for scene in ${SCENES:-undisturbed node_down slurmd_killed full_disk broken_input in_parts}; do "$scene"; done
fi
gnu_parallel
snake
