#!/bin/sh
# Builds the static libraries for iPhone and simulator without a Mac and checks what is in them.
#   ios/check-staticlib.sh TOOLCHAIN [OUT]
# TOOLCHAIN: a folder with bin/cargo whose sources of the standard library are there (tools/cross-toolchain.sh makes
# one), because no prebuilt one for Apple is needed then. Needs llvm-nm and llvm-readobj, too.
set -eu
toolchain=$(cd "${1:?TOOLCHAIN}" && pwd)
cd "$(dirname "$0")/.."
out=${2:-${CARGO_TARGET_DIR:-target}/apple}
wanted=$(sed -n 's/^[a-z].*[ *]\(flashmat_[a-z0-9_]*\)(.*/_\1/p' ffi/include/flashmat.h | sort)
for target in aarch64-apple-ios aarch64-apple-ios-sim; do
  RUSTC_BOOTSTRAP=1 "$toolchain/bin/cargo" rustc --release -Zbuild-std=std,panic_unwind -p flashmat-ffi --lib \
    --crate-type staticlib --features embedded-model --target "$target" --target-dir "$out"
  library=$out/$target/release/libflashmat.a
  found=$(llvm-nm --defined-only --extern-only "$library" 2>/dev/null | sed -n 's/^[0-9a-f]* T \(_flashmat_.*\)$/\1/p' | sort)
  if [ "$found" != "$wanted" ]; then
    printf '%s: exports differ from the header\n%s\n' "$target" "$found" >&2
    exit 1
  fi
  llvm-readobj --file-headers "$library" 2>/dev/null | grep -q 'Arch: aarch64' || {
    echo "$target: not for arm64" >&2
    exit 1
  }
  stripped=$out/$target-stripped.a
  cp "$library" "$stripped"
  llvm-strip --strip-debug "$stripped" 2>/dev/null || rm -f "$stripped"
  printf '%s: %s functions, %s bytes' "$target" "$(printf '%s\n' "$found" | wc -l)" "$(wc -c < "$library")"
  if [ -f "$stripped" ]; then printf ', %s without debug information' "$(wc -c < "$stripped")"; fi
  echo
done
