#!/usr/bin/env bash
# Passes every test of the project: format, lints, Rust tests, the no_std builds, the training kit.
# Needs cargo (the toolchain of rust-toolchain.toml), python3 >= 3.11 with venv, and a network for their packages.
#   ./ci.sh            everything
#   ./ci.sh rust       only the Rust half        ./ci.sh train     only the training kit
set -euo pipefail
cd "$(dirname "$0")"
part=${1:-all}
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

train() {
  venv=${FLASHMAT_VENV:-.venv}
  if [ ! -x "$venv/bin/ruff" ]; then
    step "Python packages"
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet torch -e "train[test]"
  fi
  step "training kit: lints"
  "$venv/bin/ruff" check train
  "$venv/bin/ruff" format --check train
  step "training kit: tests"
  (cd train && "../$venv/bin/python" -m pytest -q)
}

case $part in
  all) rust && train ;;
  rust) rust ;;
  train) train ;;
  *) echo "ci.sh: no part named '$part'; say all, rust or train" >&2; exit 2 ;;
esac
step "all passed"
