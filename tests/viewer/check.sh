#!/usr/bin/env bash
# The samples' material.glb in the Khronos validator and in three.js (headless Chromium).
#   tests/viewer/check.sh [FLASHMAT]     FLASHMAT: the program (default: cargo's release build)
# Screenshots: tests/artefacts. What could not be run is said plainly and is no failure.
set -euo pipefail
cd "$(dirname "$0")"
root=$(cd ../.. && pwd)
flashmat=${1:-}
if [ -z "$flashmat" ]; then
  cargo build --release --locked -p flashmat --manifest-path "$root/Cargo.toml"
  flashmat=${CARGO_TARGET_DIR:-$root/target}/release/flashmat
fi
if ! [ -d node_modules ] && ! npm ci --no-audit --no-fund; then
  echo "NOT RUN: npm could not install the validator and three.js"
  exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$flashmat" capture --out "$work" "$root"/samples/*.jpg
node validate.mjs "$work"/*/material.glb
for photo in "$root"/samples/*.jpg; do
  status=0
  node look.mjs "$work/$(basename "${photo%.*}")" "$photo" || status=$?
  case $status in
    0) ;;
    77) break ;;
    *) exit "$status" ;;
  esac
done
