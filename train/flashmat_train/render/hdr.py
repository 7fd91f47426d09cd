"""Reads Radiance .hdr (RGBE, run-length encoded) equirectangular maps; neither Pillow nor torch reads them."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def read_hdr(path: Path) -> np.ndarray:
    """Linear RGB, (H,W,3) float32. Raises ValueError with the file's name when it is not such a file."""
    data = path.read_bytes()
    header, sep, rest = data.partition(b"\n\n")
    if not sep or not header.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise ValueError(f"{path}: not a Radiance HDR file")
    line, _, body = rest.partition(b"\n")
    parts = line.split()
    if len(parts) != 4 or parts[0] != b"-Y" or parts[2] != b"+X":
        raise ValueError(f"{path}: unsupported resolution line {line!r}")
    h, w = int(parts[1]), int(parts[3])
    buf = np.frombuffer(body, np.uint8)
    out = np.empty((h, w, 4), np.uint8)
    pos = 0
    try:
        for y in range(h):
            if buf[pos] != 2 or buf[pos + 1] != 2 or (int(buf[pos + 2]) << 8 | int(buf[pos + 3])) != w:
                if y:
                    raise ValueError(f"{path}: mixed scanline encodings")
                return _decode(buf[: h * w * 4].reshape(h, w, 4))
            pos += 4
            for c in range(4):
                x = 0
                while x < w:
                    n = int(buf[pos])
                    if n > 128:
                        out[y, x : x + n - 128, c] = buf[pos + 1]
                        pos, x = pos + 2, x + n - 128
                    else:
                        out[y, x : x + n, c] = buf[pos + 1 : pos + 1 + n]
                        pos, x = pos + 1 + n, x + n
    except IndexError as e:
        raise ValueError(f"{path}: truncated") from e
    return _decode(out)


def _decode(rgbe: np.ndarray) -> np.ndarray:
    e = rgbe[..., 3].astype(np.int32)
    scale = np.where(e > 0, np.ldexp(1.0, e - 136), 0.0).astype(np.float32)
    return (rgbe[..., :3].astype(np.float32) + np.where(e > 0, np.float32(0.5), np.float32(0))[..., None]) * scale[
        ..., None
    ]
