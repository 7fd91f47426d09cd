#!/usr/bin/env bash
# Builds libflashmat_jni.so for Android with the NDK:   ./build-jni.sh OUT [ABI...]
# Needs rustup with the targets below, and the NDK at $ANDROID_NDK_HOME (r26 or later).
# OUT/<abi>/libflashmat_jni.so is what Gradle packs; unstripped copies, for crash reports, in OUT/../symbols/<abi>/.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
out=${1:?"usage: build-jni.sh OUT [ABI...]"}
shift
abis=("$@")
[ ${#abis[@]} -gt 0 ] || abis=(arm64-v8a armeabi-v7a x86_64)
api=24
ndk=${ANDROID_NDK_HOME:?"set ANDROID_NDK_HOME to the NDK's folder"}
tools=$(echo "$ndk"/toolchains/llvm/prebuilt/*/bin)
[ -x "$tools/clang" ] || { echo "build-jni.sh: no clang in $tools: is ANDROID_NDK_HOME an NDK?" >&2; exit 1; }

for abi in "${abis[@]}"; do
  case $abi in
    arm64-v8a) target=aarch64-linux-android clang=aarch64-linux-android ;;
    armeabi-v7a) target=armv7-linux-androideabi clang=armv7a-linux-androideabi ;;
    x86_64) target=x86_64-linux-android clang=x86_64-linux-android ;;
    *) echo "build-jni.sh: no ABI named '$abi': arm64-v8a, armeabi-v7a, x86_64" >&2; exit 2 ;;
  esac
  rustup target list --installed 2>/dev/null | grep -qx "$target" || rustup target add "$target"
  name=${target//-/_}
  linker=CARGO_TARGET_$(echo "$name" | tr '[:lower:]' '[:upper:]')_LINKER
  flags=CARGO_TARGET_$(echo "$name" | tr '[:lower:]' '[:upper:]')_RUSTFLAGS
  # 16 KB pages: devices from Android 15 on; harmless on older ones.
  env "$linker=$tools/$clang$api-clang" "CC_$name=$tools/$clang$api-clang" "AR_$name=$tools/llvm-ar" \
    "$flags=-C link-arg=-Wl,-z,max-page-size=16384" \
    cargo build --manifest-path "$here/../jni/Cargo.toml" --release --locked --target "$target"
  built=$(cargo metadata --manifest-path "$here/../jni/Cargo.toml" --format-version 1 --no-deps |
    sed 's/.*"target_directory":"\([^"]*\)".*/\1/')/$target/release/libflashmat_jni.so
  mkdir -p "$out/$abi" "$out/../symbols/$abi"
  cp "$built" "$out/../symbols/$abi/"
  "$tools/llvm-strip" --strip-unneeded -o "$out/$abi/libflashmat_jni.so" "$built"
  echo "$out/$abi/libflashmat_jni.so: $(stat -c %s "$out/$abi/libflashmat_jni.so" 2>/dev/null || stat -f %z "$out/$abi/libflashmat_jni.so") bytes"
done
