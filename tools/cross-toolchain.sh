#!/usr/bin/env bash
# A Rust toolchain that builds for targets that rustup's has no library for here: Debian's rustc-web (a current Rust),
# its library sources (for -Zbuild-std) and its aarch64 Linux library. Extracted into a folder, not installed.
#   tools/cross-toolchain.sh DIR      then DIR/bin/cargo, with RUSTC_BOOTSTRAP=1 for -Zbuild-std
# Needs Debian bookworm's apt with its security archive. About 180 MB to fetch, 1.1 GB on disk, half a minute.
set -euo pipefail
mkdir -p "${1:?usage: cross-toolchain.sh DIR}"
dir=$(cd "$1" && pwd)
[ -x "$dir/bin/cargo" ] && "$dir/bin/cargo" -V && exit 0
command -v apt-get >/dev/null || { echo "cross-toolchain.sh: no apt-get here" >&2; exit 1; }
mkdir -p "$dir/debs" "$dir/root" "$dir/bin"
cd "$dir/debs"
dpkg --print-foreign-architectures | grep -qx arm64 || dpkg --add-architecture arm64
apt-get update -qq
version=$(apt-cache policy rustc-web | awk '/Candidate:/{print $2}')
case $version in '' | '(none)') echo "cross-toolchain.sh: no package rustc-web here" >&2; exit 1 ;; esac
library=$(apt-cache show "rustc-web=$version" "libstd-rust-web-dev=$version" |
  sed -n 's/^Depends: \(libstd-rust-web-[0-9.]*\) (=.*/\1/p' | head -1)
llvm=$(apt-cache show "$library=$version" | grep -o 'libllvm[0-9]*' | head -1)
apt-get download -qq "rustc-web=$version" "cargo-web=$version" "rust-web-src=$version" \
  "libstd-rust-web-dev:amd64=$version" "$library:amd64=$version" "libstd-rust-web-dev:arm64=$version" "$llvm" \
  libgit2-1.5 libssh2-1 libmbedtls14 libmbedcrypto7 libmbedx509-1 libhttp-parser2.9
for deb in *.deb; do dpkg -x "$deb" ../root; done
rm -f ./*.deb
root=$dir/root/usr
for tool in rustc rustdoc cargo; do
  cat >"$dir/bin/$tool" <<EOF
#!/bin/sh
export LD_LIBRARY_PATH="$root/lib/x86_64-linux-gnu:$root/lib/llvm-${llvm#libllvm}/lib\${LD_LIBRARY_PATH:+:\$LD_LIBRARY_PATH}"
export RUSTC="\${RUSTC:-$dir/bin/rustc}" RUSTDOC="\${RUSTDOC:-$dir/bin/rustdoc}"
exec "$root/bin/$tool" "\$@"
EOF
  chmod +x "$dir/bin/$tool"
done
"$dir/bin/cargo" -V
