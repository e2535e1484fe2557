#!/usr/bin/env bash
# Measures the runner and writes benches/record/<CPU>/<date>-runner.md: for an otherwise idle machine, of which it takes all cores.
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
for bench in "${benches[@]}"; do [ -s "$tables/$bench.md" ] || fail "$bench: expected a table at $tables/$bench.md"; done

folder="benches/record/$cpu"
record="$folder/$date-runner.md"
mkdir -p "$folder"
{
    printf '# %s: the runner\n\n' "$date"
    printf '%s (%s cores; caches: L1d %s, L2 %s, L3 %s), %s. ' "${model:-$(uname -m)}" "$(getconf _NPROCESSORS_ONLN)" \
        "$(about 'L1d cache')" "$(about 'L2 cache')" "$(about 'L3 cache')" "$(rustc --version | cut -d' ' -f1,2)"
    printf 'Load %s before, %s after building, %s at the end (these benchmarks are one or two threads of it); %s min. ' \
        "$before" "$built" "$(load)" "$minutes"
    printf 'Commit %s, release profile, weights random.\n\n`%sbenches/record.sh`\n\n' "$commit" \
        "${ELUNAR_BENCH_PAPER:+ELUNAR_BENCH_PAPER=$ELUNAR_BENCH_PAPER }"
    cat "$tables/tile_latency.md" "$tables/operators.md" "$tables/gemm.md"
} | cat -s | sed '${/^$/d}' >"$tables/record"
mv "$tables/record" "$record"
echo "record: $record"
