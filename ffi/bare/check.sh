#!/bin/sh
# Proves the build without std: links a C program to it, on this host and, with a cross toolchain, for a Cortex-M4, and
# compares what they compute with what the normal library does.
#   ffi/bare/check.sh             host only
#   ffi/bare/check.sh TOOLCHAIN   TOOLCHAIN/bin/cargo has the sources of Rust's core library; needs clang, lld and, to
#                                 run the program, qemu-system-arm
set -eu
toolchain=${1:+$(cd "$1" && pwd)}
cd "$(dirname "$0")/../.."
target=${CARGO_TARGET_DIR:-$PWD/target}
out=$target/bare-check
mkdir -p "$out"
model="$PWD/tests/golden/toy.fmat"
mib=16

echo "host, without std"
cargo rustc -p flashmat-ffi --no-default-features --profile bare --lib --crate-type staticlib --locked
if nm -u "$target/bare/libflashmat.a" 2>/dev/null | grep -E ' (malloc|free|abort|pthread_.*|__rust_alloc.*)$'; then
  echo "the library wants a heap or threads" >&2
  exit 1
fi
cc -std=gnu99 -Wall -Wextra -Werror -DHOSTED -DWORKSPACE_MIB=$mib "-DMODEL=\"$model\"" -I ffi/include \
  ffi/bare/main.c ffi/bare/model.S "$target/bare/libflashmat.a" -Wl,--gc-sections -lm -o "$out/host"
# The header promises that this is stack enough.
(ulimit -s 384 && exec "$out/host") > "$out/host.txt"
cat "$out/host.txt"

if [ -z "$toolchain" ]; then
  echo "NOT CHECKED: bare metal; give a cross toolchain"
  exit 0
fi
if ! command -v clang > /dev/null || ! command -v ld.lld > /dev/null; then
  echo "NOT CHECKED: bare metal; clang and lld are not installed"
  exit 0
fi
echo "Cortex-M4F, without std"
RUSTC_BOOTSTRAP=1 "$toolchain/bin/cargo" rustc -p flashmat-ffi --no-default-features --profile bare --lib \
  --crate-type staticlib -Zbuild-std=core --target thumbv7em-none-eabihf --target-dir "$target/thumb"
clang --target=thumbv7em-none-eabihf -mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard -std=gnu99 -O2 -ffreestanding \
  -fno-builtin -nostdlib -Wall -Wextra -Werror -DWORKSPACE_MIB=$mib "-DMODEL=\"$model\"" -I ffi/include \
  ffi/bare/main.c ffi/bare/model.S ffi/bare/cortex-m4.c "$target/thumb/thumbv7em-none-eabihf/bare/libflashmat.a" \
  -fuse-ld=lld -Wl,--gc-sections -T ffi/bare/cortex-m4.ld -o "$out/cortex-m4.elf"
echo "linked: $(wc -c < "$out/cortex-m4.elf") bytes with the model"
if ! command -v qemu-system-arm > /dev/null; then
  echo "NOT CHECKED: running it; qemu-system-arm is not installed"
  exit 0
fi
qemu-system-arm -cpu cortex-m4 -machine mps2-an386 -nographic -semihosting-config enable=on,target=native \
  -kernel "$out/cortex-m4.elf" < /dev/null > "$out/cortex-m4.txt" 2>&1 # semihosting writes to stderr
cat "$out/cortex-m4.txt"
# 32-bit pointers: the workspace may differ, the maps may not.
grep -v workspace "$out/host.txt" > "$out/a"
grep -v workspace "$out/cortex-m4.txt" > "$out/b"
cmp "$out/a" "$out/b"
echo "the Cortex-M4 computes the host's bits"
