#!/bin/sh
# Puts header, libraries, pkg-config file and CMake package where C programs look for them.
#   cargo build -p flashmat-ffi --release --features embedded-model
#   ffi/install.sh target/release /usr/local
set -eu
if [ $# -ne 2 ]; then
  echo "install.sh FOLDER-WITH-LIBFLASHMAT PREFIX" >&2
  exit 2
fi
here=$(cd "$(dirname "$0")" && pwd)
version=$(sed -n 's/^set(PACKAGE_VERSION "\(.*\)")$/\1/p' "$here/cmake/flashmat-config-version.cmake" | head -n 1)
case $(uname -s) in
  Darwin) private= ;;
  *) private="-lpthread -ldl -lm" ;;
esac
mkdir -p "$2/include" "$2/lib/pkgconfig" "$2/lib/cmake/flashmat"
cp "$here/include/flashmat.h" "$2/include/"
cp "$here"/cmake/*.cmake "$2/lib/cmake/flashmat/"
sed -e "s|@VERSION@|$version|" -e "s|@PRIVATE_LIBS@|$private|" "$here/flashmat.pc.in" > "$2/lib/pkgconfig/flashmat.pc"
found=
for library in libflashmat.a libflashmat.so libflashmat.dylib; do
  if [ -f "$1/$library" ]; then
    cp "$1/$library" "$2/lib/"
    found=1
  fi
done
if [ -z "$found" ]; then
  echo "install.sh: no libflashmat in $1: cargo build -p flashmat-ffi --release" >&2
  exit 1
fi
