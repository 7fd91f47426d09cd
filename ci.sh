#!/usr/bin/env bash
# Passes every test of the project: format, lints, Rust tests, the no_std builds, the training kit.
# Needs cargo (the toolchain of rust-toolchain.toml), python3 >= 3.11 with venv, and a network for their packages.
#   ./ci.sh            everything but the fuzzers
#   ./ci.sh rust       only the Rust half        ./ci.sh train     only the training kit
#   ./ci.sh ffi        only the C library's checks beyond the Rust tests (its C tests are among those)
#   ./ci.sh swift      only the Swift package (sets up a Swift toolchain below target/ where it can: root, Debian)
#   ./ci.sh counts     only the instruction counts of the hot stages (x86-64; installs valgrind where it can: root, Debian)
#   ./ci.sh viewer     only the glTF of the samples in a validator and a viewer (node, Chromium)
#   ./ci.sh fuzz       only the fuzzers, 20 s each (a C++ compiler); not yet part of everything
#   ./ci.sh android    only the Android library (a JDK; fetches JUnit, Kotlin's compiler, a cross toolchain)
set -euo pipefail
cd "$(dirname "$0")"
part=${1:-all}
# Nothing here is built twice, so what incremental builds keep (gigabytes) would never be read.
export CARGO_INCREMENTAL=${CARGO_INCREMENTAL:-0}
venv=$(realpath -m "${FLASHMAT_VENV:-.venv}")
flashmat=
started=$SECONDS
step() { printf '\n== %s (%d s)\n' "$*" "$((SECONDS - started))"; }

rust() {
  step "format"
  cargo fmt --all --check
  step "lints"
  cargo clippy --workspace --all-targets --all-features --locked -- -D warnings
  step "Rust tests"
  cargo test --workspace --all-features --locked
  step "core without std, without a heap"
  cargo check -p flashmat-core --no-default-features --locked
  cargo check -p flashmat-core --no-default-features --features alloc --locked
}

counts() {
  step "instructions of the hot stages"
  # 3: not run, and it said why.
  tests/counts/check.sh || [ $? = 3 ]
}

android() {
  step "Android: library on this machine's JVM"
  android/test-host.sh
  step "Android: what can be checked without its SDK"
  android/check-cross.sh
}

ffi() {
  cross=${FLASHMAT_CROSS:-${CARGO_TARGET_DIR:-target}/tools/cross}
  if ! tools/cross-toolchain.sh "$cross"; then
    echo "NOT RUN: bare metal and iPhone builds; no cross toolchain here"
    cross=
  fi
  step "C library without std"
  ffi/bare/check.sh ${cross:+"$cross"}
  if [ -n "$cross" ] && command -v llvm-nm >/dev/null; then
    step "C library for iPhone and simulator"
    ios/check-staticlib.sh "$cross"
  fi
}

swift_package() {
  step "Swift package"
  ios/test-linux.sh "${FLASHMAT_SWIFT:-${CARGO_TARGET_DIR:-target}/tools/swift}"
}

viewer() {
  step "glTF in the Khronos validator and in three.js"
  if [ "${CI:-}" = true ] && ! command -v chromium >/dev/null && command -v apt-get >/dev/null; then
    apt-get install -y -qq --no-install-recommends chromium >/dev/null 2>&1 || echo "no Chromium to be had here"
  fi
  # After the Rust tests the program is there already; else the check builds one.
  tests/viewer/check.sh ${flashmat:+"$flashmat"}
}

fuzz() {
  step "fuzzers: built, and each run for 20 s"
  cargo fmt --manifest-path fuzz/Cargo.toml --check
  fuzz/run.sh all 20
}

packages() {
  if [ ! -x "$venv/bin/ruff" ]; then
    step "Python packages"
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet torch -e "train[test]"
  fi
  # Dr.Jit wants an LLVM library of 16 or newer; with one the comparison with Mitsuba must run, not be skipped.
  if ! ls /usr/lib/*/libLLVM*19* >/dev/null 2>&1 && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get install -y -qq --no-install-recommends libllvm19 >/dev/null 2>&1 || echo "no libllvm19 to be had here"
  fi
}

train() {
  packages
  step "training kit: lints"
  "$venv/bin/ruff" check train
  "$venv/bin/ruff" format --check train
  if [ -n "${DRJIT_LIBLLVM_PATH:-}" ] || ls /usr/lib/*/libLLVM*19* >/dev/null 2>&1; then
    export FLASHMAT_REQUIRE_MITSUBA=1
  else
    echo "NOT RUN unless another LLVM serves: the comparison with Mitsuba; install libllvm19"
  fi
  step "training kit: tests"
  (cd train && "$venv/bin/python" -m pytest -q)
}

# Waits for process $1, shows what it wrote to $2, and fails if it did.
join() {
  local status=0
  wait "$1" || status=$?
  cat "$2"
  return "$status"
}

case $part in
  # Not `rust && ...`: bash ignores errors inside functions of such a list.
  all)
    # The training kit shares nothing with the rest: its packages are fetched, and its tests run, beside it.
    log=$(mktemp)
    trap 'kill $(jobs -p) 2>/dev/null || true; rm -f "$log"' EXIT
    packages >"$log" 2>&1 &
    rust
    flashmat=$(realpath "${CARGO_TARGET_DIR:-target}/debug/flashmat")
    join $! "$log"
    counts
    train >"$log" 2>&1 &
    training=$!
    ffi
    swift_package
    android
    viewer
    join "$training" "$log"
    ;;
  rust) rust ;;
  counts) counts ;;
  ffi) ffi ;;
  swift) swift_package ;;
  android) android ;;
  viewer) viewer ;;
  fuzz) fuzz ;;
  train) train ;;
  *) echo "ci.sh: no part named '$part'; say all, rust, counts, ffi, swift, android, viewer, fuzz or train" >&2; exit 2 ;;
esac
step "all passed"
