#!/bin/sh
# Makes Flashmat.xcframework for devices and simulators. Needs a Mac with Xcode and rustup.
#   ios/build-xcframework.sh
set -eu
cd "$(dirname "$0")/.."
if [ "$(uname -s)" != Darwin ]; then
  echo "build-xcframework.sh needs a Mac: xcodebuild and lipo come with Xcode" >&2
  exit 1
fi
IPHONEOS_DEPLOYMENT_TARGET=15.0
MACOSX_DEPLOYMENT_TARGET=12.0
export IPHONEOS_DEPLOYMENT_TARGET MACOSX_DEPLOYMENT_TARGET
targets="aarch64-apple-ios aarch64-apple-ios-sim x86_64-apple-ios aarch64-apple-darwin x86_64-apple-darwin"
for target in $targets; do
  rustup target add "$target"
  cargo rustc -p flashmat-ffi --release --locked --features embedded-model --crate-type staticlib --target "$target"
done
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
mkdir -p "$out/headers" "$out/simulator" "$out/mac"
cp ffi/include/flashmat.h "$out/headers/"
# Module map without `link`: the framework's library is linked anyway.
printf 'module FlashmatFFI {\n    header "flashmat.h"\n    export *\n}\n' > "$out/headers/module.modulemap"
lipo -create target/aarch64-apple-ios-sim/release/libflashmat.a target/x86_64-apple-ios/release/libflashmat.a \
  -output "$out/simulator/libflashmat.a"
lipo -create target/aarch64-apple-darwin/release/libflashmat.a target/x86_64-apple-darwin/release/libflashmat.a \
  -output "$out/mac/libflashmat.a"
rm -rf ios/Flashmat.xcframework
xcodebuild -create-xcframework \
  -library target/aarch64-apple-ios/release/libflashmat.a -headers "$out/headers" \
  -library "$out/simulator/libflashmat.a" -headers "$out/headers" \
  -library "$out/mac/libflashmat.a" -headers "$out/headers" \
  -output ios/Flashmat.xcframework
ls -l ios/Flashmat.xcframework/*/libflashmat.a
