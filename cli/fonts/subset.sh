#!/usr/bin/env bash
# Makes the two fonts here from Inter's own. Needs npm, and python3 with fonttools and brotli.
set -euo pipefail
cd "$(dirname "$0")"
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
(cd "$work" && npm pack --silent inter-ui@4.1.1 >/dev/null && tar xzf inter-ui-4.1.1.tgz)
letters=U+20-7E,U+A0-24F,U+2B0-2FF,U+300-36F,U+370-3FF,U+400-52F,U+1E00-1EFF
signs=U+2010-2027,U+2030-203A,U+20AC,U+2116,U+2122,U+2190-2193,U+2212
for weight in Regular SemiBold; do
  pyftsubset "$work/package/web/Inter-$weight.woff2" --unicodes="$letters,$signs" --layout-features=kern,mark,ccmp \
    --no-hinting --name-IDs=0,1,2,3,4,5,6,13,14 --output-file="$work/$weight.woff2"
  # Unpacked: what reads it knows no WOFF.
  python3 -c "import sys; from fontTools.ttLib import TTFont; f = TTFont(sys.argv[1]); f.flavor = None; f.save(sys.argv[2])" \
    "$work/$weight.woff2" "Inter-$weight.ttf"
done
