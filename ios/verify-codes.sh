#!/bin/sh
# Compares the Swift package with the C header: the copied header, status codes, formats, classes, stages. No Swift
# toolchain needed.
set -eu
cd "$(dirname "$0")"
header=../ffi/include/flashmat.h
status=0
if ! cmp -s "$header" Sources/FlashmatFFI/flashmat.h; then
  echo "Sources/FlashmatFFI/flashmat.h is not ffi/include/flashmat.h: copy it" >&2
  status=1
fi

# compare NAME FILE SWIFT-ENUM PREFIX: `case name = number` (numbers count up) against PREFIX_NAME = number.
compare() {
  swift=$(awk -v enum="enum $3:" '
    index($0, enum) { inside = 1; number = -1; next }
    inside && /^ *}/ { exit }
    inside && /^ *case / {
      name = $2; gsub(/`/, "", name)
      if ($3 == "=") number = $4; else number++
      print name, number + 0
    }' "$2" | sort)
  c=$(sed -n "s/^ *$4_\([A-Z0-9_]*\) = \([0-9]*\),*$/\1 \2/p" "$header" | sort)
  if [ -z "$swift" ] || [ -z "$c" ]; then
    echo "$1: nothing found to compare" >&2
    status=1
    return
  fi
  wanted=$(printf '%s\n' "$c" | awk -v map="$5" '
    BEGIN { n = split(map, pairs, " "); for (i = 1; i <= n; i++) { split(pairs[i], p, "="); other[p[1]] = p[2] } }
    {
      if ($1 in other) { if (other[$1] != "-") print other[$1], $2; next }
      n = split(tolower($1), words, "_"); name = words[1]
      for (i = 2; i <= n; i++) name = name toupper(substr(words[i], 1, 1)) substr(words[i], 2)
      print name, $2
    }' | sort)
  if [ "$swift" != "$wanted" ]; then
    echo "$1: Swift and C differ" >&2
    printf 'Swift:\n%s\nC:\n%s\n' "$swift" "$wanted" >&2
    status=1
  fi
}
# Names that differ on purpose: C=Swift, and - for what Swift has no case for.
compare "status codes" Sources/Flashmat/FlashmatError.swift Code FLASHMAT_STATUS "OK=-"
compare "classes" Sources/Flashmat/Material.swift MaterialClass FLASHMAT_CLASS "AUTO=-"
compare "stages" Sources/Flashmat/Material.swift CaptureStage FLASHMAT_STAGE ""
compare "formats" Sources/Flashmat/Photo.swift Format FLASHMAT_FORMAT ""
compare "rotations" Sources/Flashmat/Photo.swift Rotation FLASHMAT_ROTATION "CW90=clockwise90 CW180=half CW270=clockwise270"
compare "encodings" Sources/Flashmat/Photo.swift Encoding FLASHMAT_ENCODING "DEFAULT=standard SRGB=sRGB"
compare "matrices" Sources/Flashmat/Photo.swift YUVMatrix FLASHMAT_YUV_MATRIX "DEFAULT=standard"
compare "ranges" Sources/Flashmat/Photo.swift YUVRange FLASHMAT_YUV_RANGE "DEFAULT=standard"
if [ "$status" = 0 ]; then
  echo "the Swift package agrees with the C header"
fi
exit "$status"
