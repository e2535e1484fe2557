#!/usr/bin/env bash
# Campaigns: checks of minutes to hours, which ./ci.sh does not run. README.md says what each one does, record.csv what they found so far.
#
#   tests/campaigns/run.sh                  all of them
#   tests/campaigns/run.sh slots kills      these: programs slots strip kills races schedules endless foreign manifests miri roundings inject fuzz
#   ELUNAR_LAYOUTS, ELUNAR_BOOTS, ELUNAR_FLIPS, ELUNAR_KILLS, ELUNAR_RACES, ELUNAR_SCHEDULES, ELUNAR_INJECTIONS, FUZZ_SECONDS: lengths
#   ELUNAR_SEED=N        programs and schedules from this seed on; programs need another folder then
#   ELUNAR_JOBS=train,export    commands of kills, races, foreign
#   ELUNAR_PART=2/5      a part of the programs of miri
#   ELUNAR_CAMPAIGNS=DIR                    where progress, logs, findings and corpora are (default: tests/campaigns/out)
set -euo pipefail
cd "$(dirname "$0")/../.."

mkdir -p "${ELUNAR_CAMPAIGNS:-tests/campaigns/out}"
folder="$(cd "${ELUNAR_CAMPAIGNS:-tests/campaigns/out}" && pwd)"
core="profile.dev.package.elunar-core"
# The flight library with overflow checks and debug assertions, which its development profile leaves out for speed.
checked=(--config "$core.overflow-checks=true" --config "$core.debug-assertions=true" --config "$core.opt-level=2")

ignored() { cargo test --locked "$@" -- --ignored --nocapture --test-threads 1; }

programs() {
    ELUNAR_LAYOUTS="${ELUNAR_LAYOUTS:-1000000}" ELUNAR_PROGRESS="$folder/programs.txt" \
        ignored --package elunar-provoke "${checked[@]}" --test overlapping_programs many_programs
}

slots() { ELUNAR_BOOTS="${ELUNAR_BOOTS:-100000}" ignored --package elunar-core "${checked[@]}" --lib many_boots; }

kills() { ELUNAR_KILLS="${ELUNAR_KILLS:-50}" ignored --package host-train --test kills many_kills; }

races() { ELUNAR_RACES="${ELUNAR_RACES:-20}" ignored --package host-train --test kills many_races; }

schedules() {
    ELUNAR_SCHEDULES="${ELUNAR_SCHEDULES:-100000}" cargo test --locked --package elunar-base --lib -- --nocapture no_schedule
}

endless() { ignored --package host-train --test endless every_input; }

foreign() { ignored --package host-train --test foreign every_command_every_name_every_kind; }

manifests() { ignored --package elunar --test apart every_file_every_reader_every_way; }

# `cargo miri` keeps the environment that it compiled with: what may change goes by its flags.
miri() {
    MIRIFLAGS="-Zmiri-permissive-provenance -Zmiri-tree-borrows ${ELUNAR_PART:+-Zmiri-env-set=ELUNAR_PART=$ELUNAR_PART}" \
        cargo +nightly miri test --locked --package elunar-provoke --target-dir "${CARGO_TARGET_DIR:-target}/miri" --test small_programs -- --nocapture
}

# Its lines are those of roundings.csv; ELUNAR_SUMS_STEP=1000 tries every thousandth sum.
roundings() { cargo test --locked --package elunar-core --lib -- --ignored --nocapture --test-threads 1 every_sum every_root; }

# Flips bits in the memory of strips: of a tiny model, and of the shipped one.
strip() {
    ELUNAR_FLIPS="${ELUNAR_FLIPS:-20000}" ignored --package elunar-core --lib many_flips
    cargo run --locked --quiet --package host-train -- faults host-train/models/nano.eld --strip \
        --injections "${ELUNAR_FLIPS:-20000}" --out "$folder/strip"
}

inject() {
    cargo run --locked --package elunar-inject -- host-train/models/nano.eld --injections "${ELUNAR_INJECTIONS:-3000}" --out "$folder/inject"
}

fuzz() { FUZZ_FOLDER="$folder/fuzz" tests/fuzz/campaign.sh; }

[ $# -gt 0 ] || set -- programs slots strip kills races schedules endless foreign manifests miri roundings inject fuzz
for campaign in "$@"; do
    case "$campaign" in
    programs | slots | strip | kills | races | schedules | endless | foreign | manifests | miri | roundings | inject | fuzz)
        printf '\n== %s, %s, commit %s, %s\n' "$campaign" "$(date -u +%F)" "$(git rev-parse --short HEAD)" \
            "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo 2>/dev/null | head -1)"
        SECONDS=0
        "$campaign" 2>&1 | tee -a "$folder/$campaign.log"
        echo "$campaign: $SECONDS s"
        ;;
    *)
        echo "ERROR: expected a campaign (programs slots strip kills races schedules endless foreign manifests miri roundings inject fuzz), found '$campaign'" >&2
        exit 1
        ;;
    esac
done
