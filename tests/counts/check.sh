#!/usr/bin/env bash
# Counts the instructions of the hot stages (tests/examples/count.rs) under valgrind and holds them against counts.tsv
# beside this file: reports a stage that is more than 5 % off, either way, and fails when one takes 30 % more. Between the two
# it does not fail: the compiler inlines anew when other code changes, which has moved a stage by a quarter.
#   tests/counts/check.sh             compares
#   tests/counts/check.sh --update    writes the table anew: commit it with the change that moved it, and say why
# Counts do not depend on a machine's load or clock, and the CPU level is forced; what is left are the C library's copies
# and fills. They do depend on the compiler, which rust-toolchain.toml pins. Levels: scalar and avx2; valgrind knows no
# AVX-512 and cannot run avx512vnni. Exit status 3: nothing was counted, because something is missing here.
set -euo pipefail
cd "$(dirname "$0")/../.."
table=tests/counts/counts.tsv
limit=5
fail=30
skip() { echo "NOT RUN: instruction counts; $*" >&2; exit 3; }

[ "$(uname -m)" = x86_64 ] || skip "the table is of x86-64"
if ! command -v valgrind >/dev/null && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
  apt-get install -y -qq --no-install-recommends valgrind >/dev/null 2>&1 || true
fi
command -v valgrind >/dev/null || skip "valgrind is not here; install it"
levels=scalar
if grep -qw avx2 /proc/cpuinfo; then levels+=" avx2"; else echo "NOT RUN: level avx2, which this CPU lacks" >&2; fi

cargo build --quiet --release --locked -p flashmat-tests --example count
count=${CARGO_TARGET_DIR:-target}/release/examples/count

# Instructions within a function, calls included: instructions STAGE LEVEL FUNCTION
instructions() {
  local out
  out=$(valgrind --tool=callgrind --callgrind-out-file=/dev/null "--toggle-collect=$3" "$count" "$1" "$2" 2>&1) || {
    echo "$out" >&2
    return 1
  }
  sed -n 's/^==.*Collected : \([0-9]*\).*/\1/p' <<<"$out"
}

# A network's run is cut into its operators; of the other stages the whole is counted.
measure() {
  printf '# Instructions of one run at 128 x 128, one thread, by %s; tests/counts/check.sh --update writes this.\n' \
    "$(rustc --version | cut -d' ' -f1,2)"
  local stage level
  for level in $levels; do
    for stage in $("$count"); do
      printf '%s\t%s\t%s\n' "$stage" "$level" "$(instructions "$stage" "$level" count::counted)"
    done
    for stage in op_input op_conv op_mix; do
      printf 'network/%s\t%s\t%s\n' "$stage" "$level" \
        "$(instructions network "$level" "flashmat_core::net::$stage::run")"
    done
  done
}

now=$(mktemp)
trap 'rm -f "$now"' EXIT
measure >"$now"
if [ "${1:-}" = --update ]; then
  cp "$now" "$table"
  echo "$table is written"
  exit
fi
if ! diff <(head -1 "$table") <(head -1 "$now") >/dev/null; then
  echo "another compiler than the table's: $(head -1 "$table")" >&2
fi
awk -F'\t' -v limit="$limit" -v fail="$fail" -v levels="$levels" '
  /^#/ { next }
  NR == FNR { before[$1 "\t" $2] = $3; next }
  {
    key = $1 "\t" $2
    seen[key] = 1
    if ($3 + 0 == 0) { printf "%-18s %-7s counted nothing: is its function gone or inlined?\n", $1, $2; bad = 1; next }
    if (!(key in before)) { printf "%-18s %-7s %12d  not in the table\n", $1, $2, $3; bad = 1; next }
    drift = 100 * ($3 / before[key] - 1)
    off = drift > limit || drift < -limit
    printf "%-18s %-7s %12d %+7.2f %%%s\n", $1, $2, $3, drift, off ? "  DRIFTED" : ""
    if (off) drifted = drifted " " $1 "/" $2
    if (drift > fail) bad = 1
  }
  END {
    for (key in before) {
      split(key, part, "\t")
      if (!(key in seen) && index(" " levels " ", " " part[2] " ")) { print key "  in the table, but not counted"; bad = 1 }
    }
    if (drifted) print "More than " limit " % off:" drifted
    exit bad
  }' "$table" "$now" || {
  echo "Instruction counts are more than $fail % above $table, or rows are missing. If that is meant (a gain, or a price worth paying):" >&2
  echo "  tests/counts/check.sh --update    and commit the table with the change, saying why" >&2
  exit 1
}
