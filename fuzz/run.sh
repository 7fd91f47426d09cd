#!/usr/bin/env bash
# Builds the fuzzers (libFuzzer, AddressSanitizer) and runs them.
#   fuzz/run.sh build                   builds all targets
#   fuzz/run.sh TARGET SECONDS [...]    builds and runs one target for so long; what follows goes to libFuzzer
#   fuzz/run.sh all SECONDS [JOBS]      builds all targets, runs each for so long, JOBS at a time (2); what CI does
# Needs cargo and a C++ compiler; the stable toolchain does (RUSTC_BOOTSTRAP), cargo-fuzz is not needed. Inputs that add
# coverage are kept in fuzz/corpus/TARGET, one that fails in fuzz/artifacts/TARGET: run.sh TARGET 0 FILE runs it again.
set -euo pipefail
cd "$(dirname "$0")"
targets=(model frame pipeline c_interface photo writers)
host=$(rustc -vV | sed -n 's/^host: //p')
# Other flags than the product's: in a folder of their own nothing is built anew for either.
target_dir=${FLASHMAT_FUZZ_TARGET:-$PWD/target}

build() {
  local flags=(--cfg fuzzing -Zsanitizer=address -Cpasses=sancov-module)
  local coverage
  for coverage in level=4 inline-8bit-counters pc-table trace-compares; do
    flags+=("-Cllvm-args=-sanitizer-coverage-$coverage")
  done
  # With --target the flags are not for build scripts.
  RUSTC_BOOTSTRAP=1 RUSTFLAGS="${flags[*]}" CARGO_INCREMENTAL=0 CARGO_TARGET_DIR=$target_dir \
    cargo build --quiet --locked --target "$host" --bins
}

# Runs target $1 for $2 seconds, or, with more arguments, as they say.
run() {
  local target=$1 seconds=$2
  shift 2
  mkdir -p "corpus/$target" "artifacts/$target"
  local folders=("corpus/$target" "seeds/$target")
  # With a file to run again there are no folders.
  [ "$seconds" != 0 ] || folders=()
  ASAN_OPTIONS=${ASAN_OPTIONS:-detect_leaks=1:allocator_may_return_null=1} \
    "$target_dir/$host/debug/$target" -max_total_time="$seconds" -timeout=300 -rss_limit_mb=3072 -max_len=32768 \
    -print_final_stats=1 -artifact_prefix="artifacts/$target/" "$@" ${folders[@]+"${folders[@]}"}
}

# Runs target $1 for $2 seconds in silence; one line when it went well, all it said when not.
report() {
  local log status=0
  log=$(mktemp)
  run "$1" "$2" >"$log" 2>&1 || status=$?
  if [ "$status" = 0 ]; then
    printf '%-12s %s inputs\n' "$1" "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")"
  else
    tail -n 60 "$log"
    echo "fuzz/run.sh: target '$1' failed; fuzz/artifacts/$1 holds the input" >&2
  fi
  rm -f "$log"
  return "$status"
}

case ${1:-} in
  build) build ;;
  all)
    build
    export -f run report
    export target_dir host
    printf '%s\n' "${targets[@]}" | xargs -P "${3:-2}" -I{} bash -c 'report "$@"' report {} "${2:?seconds}"
    ;;
  *)
    if [[ " ${targets[*]} " != *" ${1:-} "* || $# -lt 2 ]]; then
      echo "fuzz/run.sh: say build, all SECONDS, or one of ${targets[*]} and SECONDS" >&2
      exit 2
    fi
    build
    run "$@"
    ;;
esac
