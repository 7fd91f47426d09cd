#!/bin/sh
# Runs the Swift package's tests on Linux: `swift test` against libflashmat.a.
#   ios/test-linux.sh            with the `swift` on the PATH
#   ios/test-linux.sh FOLDER     without one: with that of a Debian 13 in FOLDER, which is set up first if it is not
#                                there (root, debootstrap; 450 MB to fetch, 3.4 GB on disk, two minutes)
# Says "NOT RUN" and why where neither can be had, after the checks that need no Swift; that is no failure.
# FLASHMAT_LIB_DIR: a folder with libflashmat.a; a release build is made if there is none.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
cd "$root"
folder=${1:-}

not_run() {
  echo "NOT RUN: the Swift tests: $1"
  echo "checked instead: the header as the module map has it, codes and enumerations against the header"
  exit 0
}

ios/verify-codes.sh
# What importing the module means to clang (or any C compiler).
for compiler in clang cc; do
  if command -v "$compiler" > /dev/null; then
    header=$(sed -n 's/^ *header "\(.*\)"$/\1/p' ios/Sources/FlashmatFFI/module.modulemap)
    "$compiler" -std=c11 -Wall -Wextra -Werror -pedantic -fsyntax-only -x c "ios/Sources/FlashmatFFI/$header"
    break
  fi
done

if ! command -v swift > /dev/null; then
  [ -n "$folder" ] || not_run "no swift on the PATH, and no folder given for one"
  [ "$(id -u)" = 0 ] || not_run "setting up a Debian needs root"
  # A link that only means something inside.
  if [ ! -L "$folder/usr/bin/swift" ] && [ ! -e "$folder/usr/bin/swift" ]; then
    command -v debootstrap > /dev/null || apt-get install -y -qq --no-install-recommends debootstrap > /dev/null 2>&1 ||
      not_run "debootstrap cannot be had"
    # The mirror that this machine uses.
    mirror=$(cat /etc/apt/sources.list /etc/apt/sources.list.d/*debian* 2> /dev/null |
      sed -n -e 's/^URIs: *\([^ ]*\/debian\)\/*$/\1/p' -e 's/^deb .*\(http[^ ]*\/debian\)\/* .*/\1/p' | head -n 1)
    mkdir -p "$folder"
    debootstrap --variant=minbase --include=swiftlang,ca-certificates,libc6-dev,libstdc++-14-dev,git trixie "$folder" \
      "${mirror:-http://deb.debian.org/debian}" > "$folder.log" 2>&1 || not_run "debootstrap failed, see $folder.log"
  fi
fi

library=${FLASHMAT_LIB_DIR:-}
if [ -z "$library" ]; then
  cargo build -p flashmat-ffi --release --locked
  library=${CARGO_TARGET_DIR:-$root/target}/release
fi
if command -v swift > /dev/null; then
  FLASHMAT_LIB_DIR=$library FLASHMAT_ROOT=$root swift test --package-path ios
  exit 0
fi

rm -rf "$folder/work/ios/Sources" "$folder/work/ios/Tests"
mkdir -p "$folder/work/ios" "$folder/work/lib" "$folder/work/tests/golden"
# The header is a link to the C library's.
cp -rL ios/Package.swift ios/Sources ios/Tests "$folder/work/ios/"
cp "$library/libflashmat.a" "$folder/work/lib/"
cp tests/golden/toy.fmat "$folder/work/tests/golden/"
# Without /proc the compiler does not find its own libraries. What is mounted here is unmounted at the end.
mounted=
unmount() { for point in $mounted; do umount "$point"; done; }
trap unmount EXIT
for point in proc dev; do
  if ! mountpoint -q "$folder/$point"; then
    mount --bind "/$point" "$folder/$point" 2> /dev/null || not_run "mounting is not allowed here"
    mounted="$folder/$point $mounted"
  fi
done
chroot "$folder" env FLASHMAT_LIB_DIR=/work/lib FLASHMAT_ROOT=/work \
  swift test --disable-sandbox --package-path /work/ios
