#!/usr/bin/env bash
# Measures the runner and writes benches/record/<CPU>/<date>-runner/: tables as CSV, and about.txt, which says how they were made.
# For an otherwise idle machine, of which it takes all cores.
#
#   benches/record.sh                          nano, tiny, small
#   ELUNAR_BENCH_PAPER=1 benches/record.sh     paper, too: minutes more, and several GB of memory
set -euo pipefail
cd "$(dirname "$0")/.."

benches=(gemm operators tile_latency)
fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }
load() { [ -r /proc/loadavg ] && cut -d' ' -f1 /proc/loadavg || echo unknown; }
about() { lscpu 2>/dev/null | sed -n "s/^ *$1: *//p" | head -1; }

model="$(about 'Model name')"
flags="$(about Flags)"
cpu="$(tr '[:upper:]' '[:lower:]' <<<"${model:-$(uname -m)}" | sed 's/[^a-z0-9][^a-z0-9]*/-/g; s/^-//; s/-$//')"
case " $flags " in
*" amx_int8 "*) cpu="$cpu-amx" ;;
*" avx512_vnni "*) cpu="$cpu-avx512" ;;
*" avx2 "*) cpu="$cpu-avx2" ;;
esac
commit="$(git rev-parse --short HEAD)"
[ -z "$(git status --porcelain --untracked-files=no)" ] || commit="$commit with changes"
date="$(date -u +%Y-%m-%d)"

arguments=()
for bench in "${benches[@]}"; do arguments+=(--bench "$bench"); done
before="$(load)"
cargo bench --locked -p elunar-benches "${arguments[@]}" --no-run

tables="$(mktemp -d)"
trap 'rm -rf "$tables"' EXIT
built="$(load)"
started=$SECONDS
ELUNAR_BENCH_TABLES="$tables" cargo bench --locked -p elunar-benches "${arguments[@]}"
minutes=$(((SECONDS - started + 59) / 60))
for table in peaks products products_together operator_kinds operators tiles; do
    [ -s "$tables/$table.csv" ] || fail "$table: expected a table at $tables/$table.csv"
done

record="benches/record/$cpu/$date-runner"
{
    printf 'The runner, %s\n' "$date"
    printf '%s (%s cores; caches: L1d %s, L2 %s, L3 %s), %s\n' "${model:-$(uname -m)}" "$(getconf _NPROCESSORS_ONLN)" \
        "$(about 'L1d cache')" "$(about 'L2 cache')" "$(about 'L3 cache')" "$(rustc --version | cut -d' ' -f1,2)"
    printf 'Load %s before, %s after building, %s at the end (these benchmarks are one or two threads of it); %s min\n' \
        "$before" "$built" "$(load)" "$minutes"
    printf 'Commit %s, release profile, random weights\n' "$commit"
    printf 'Command: %sbenches/record.sh\n' "${ELUNAR_BENCH_PAPER:+ELUNAR_BENCH_PAPER=$ELUNAR_BENCH_PAPER }"
} >"$tables/about.txt"
rm -rf "$record"
mkdir -p "$record"
mv "$tables"/*.csv "$tables/about.txt" "$record"
echo "record: $record"
