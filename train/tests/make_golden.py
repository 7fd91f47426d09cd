"""Writes the Rust tests' golden files: the toy model, and what the reference executors make of one photo.

    python train/tests/make_golden.py tests/golden

`toy.golden`: magic FMGOLD01, u32 record count, then records: name (32 bytes), u32 kind (0 i8, 1 f32, 2 u8), u32 step,
u64 values in all, u32 CRC-32 of all values' bytes, u32 samples, then every `step`-th value. Little endian.
Records: `photo` (sRGB codes [3][n][n]), each int8 tensor and vector by its name, `probabilities`, `map/<map>` mixed
by the classifier, `metal/<map>` with the class given, `lit/<map>` with a light scale of 1.5 known, and
`float/...` from the float weights.
"""

from __future__ import annotations

import struct
import sys
import zlib
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

from toy_model import smooth_photo, toy_model  # noqa: E402

from flashmat_train.int8_reference import (  # noqa: E402
    network_input,
    quantise_input,
    run_float,
    run_int8,
    srgb_encode,
)
from flashmat_train.modelfile import CLASS_NAMES, write_model  # noqa: E402

KINDS = {"int8": 0, "float32": 1, "uint8": 2}
SAMPLES = 256


def record(name: str, values: np.ndarray) -> bytes:
    """One record; the photo is kept whole."""
    if values.dtype == np.float64:
        values = values.astype(np.float32)
    flat = np.ascontiguousarray(values).reshape(-1)
    step = 1 if name == "photo" else max(1, flat.size // SAMPLES | 1)
    kept = flat[::step]
    head = struct.pack("<2IQ2I", KINDS[flat.dtype.name], step, flat.size, zlib.crc32(flat.tobytes()), kept.size)
    return name.encode().ljust(32, b"\0") + head + kept.tobytes()


def main(folder: Path) -> None:
    """Writes toy.fmat and toy.golden."""
    model = toy_model()
    codes = np.rint(srgb_encode(smooth_photo(seed=11)) * 255).astype(np.uint8)
    encoded = codes.astype(np.float64) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    image = network_input(linear.astype(np.float32))
    records = [record("photo", codes)]
    result = run_int8(model.graph, quantise_input(image))
    records += [record(name, values) for name, values in result.tensors.items()]
    records.append(record("probabilities", result.probabilities))
    records += [record(f"map/{name}", values) for name, values in result.maps.items()]
    metal = run_int8(model.graph, quantise_input(image), CLASS_NAMES.index("metal"))
    records += [record(f"metal/{name}", values) for name, values in metal.maps.items()]
    lit = run_int8(model.graph, quantise_input(network_input(linear.astype(np.float32), 1.5)))
    records += [record(f"lit/{name}", values) for name, values in lit.maps.items()]
    exact = run_float(model.graph, image)
    records += [record(f"float/{name}", values) for name, values in exact.tensors.items()]
    records.append(record("float/probabilities", exact.probabilities))
    records += [record(f"float/map/{name}", values) for name, values in exact.maps.items()]
    folder.mkdir(parents=True, exist_ok=True)
    write_model(folder / "toy.fmat", model)
    (folder / "toy.golden").write_bytes(b"FMGOLD01" + struct.pack("<I", len(records)) + b"".join(records))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
