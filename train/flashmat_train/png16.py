"""Writes 16-bit PNG files, grey or RGB; Pillow writes no 16-bit RGB."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np


def write_png16(path: Path, pixels: np.ndarray) -> None:
    """Values in [0,1], (n,m) grey or (n,m,3) RGB, rounded to 16 bits; what lies outside is clamped."""
    codes = np.rint(np.clip(pixels, 0, 1) * 65535.0).astype(">u2")
    h, w = codes.shape[:2]
    wide = codes.reshape(h, -1).view(np.uint8).reshape(h, -1)
    # each row as the difference to the one above: smaller for pictures
    lines = np.concatenate((np.full((h, 1), 2, np.uint8), np.diff(wide, axis=0, prepend=np.zeros_like(wide[:1]))), 1)
    header = struct.pack(">IIBBBBB", w, h, 16, 2 if codes.ndim == 3 else 0, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes(), 6)), (b"IEND", b""))
    data = b"\x89PNG\r\n\x1a\n"
    for kind, body in chunks:
        data += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    path.write_bytes(data)
