#!/usr/bin/env python3
"""Writes the seeds that the fuzzers start from: seeds.py. Needs numpy, Pillow and tifffile.

The files are small and made from nothing, so that they may lie in the repository. Run it again after a change here and
commit what it wrote; a fuzzer's own finds stay in corpus/, which is not committed.
"""

import io
import random
import shutil
import struct
import zlib
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image, ImageCms

SEEDS = Path(__file__).parent / "seeds"
TOY = Path(__file__).parent.parent / "tests" / "golden" / "toy.fmat"
WIDTH, HEIGHT = 34, 33


def write(target: str, name: str, data: bytes) -> None:
    folder = SEEDS / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data)


def pixels(dtype=np.uint8, channels: int = 3) -> np.ndarray:
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    light = 1.0 - ((x - WIDTH / 2) ** 2 + (y - HEIGHT / 2) ** 2) / WIDTH**2
    tiles = 0.5 + 0.5 * ((x // 5 + y // 5) % 2)
    planes = [light * tiles * (1.0 - 0.2 * c) for c in range(channels)]
    values = np.stack(planes, axis=-1) if channels > 1 else planes[0]
    if np.issubdtype(dtype, np.floating):
        return values.astype(dtype)
    return (values * np.iinfo(dtype).max).clip(0, np.iinfo(dtype).max).astype(dtype)


def encoded(image: Image.Image, format: str, **options) -> bytes:
    out = io.BytesIO()
    image.save(out, format, **options)
    return out.getvalue()


def exif(order: str = "<") -> bytes:
    """Orientation 6, a focal length of 26 mm (35 mm equivalent) and of 4.25 mm, colour space sRGB."""
    short, long, rational = 3, 4, 5

    def entry(tag, kind, value):
        packed = struct.pack(order + "HH", value, 0) if kind == short else struct.pack(order + "I", value)
        return struct.pack(order + "HHI", tag, kind, 1) + packed

    first = [entry(0x0112, short, 6), entry(0x8769, long, 8 + 2 + 24 + 4)]
    second_at = 8 + 2 + 24 + 4
    after = second_at + 2 + 36 + 4
    second = [entry(0x920A, rational, after), entry(0xA001, short, 1), entry(0xA405, short, 26)]
    body = b"".join([struct.pack(order + "H", 2), *first, bytes(4)])
    body += b"".join([struct.pack(order + "H", 3), *second, bytes(4), struct.pack(order + "II", 425, 100)])
    mark = b"II*\0" if order == "<" else b"MM\0*"
    return mark + struct.pack(order + "I", 8) + body


def png_with(data: bytes, chunks: list[tuple[bytes, bytes]]) -> bytes:
    """A PNG with chunks before its pixels."""
    at = data.index(b"IDAT") - 4
    made = b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    )
    return data[:at] + made + data[at:]


def photos() -> None:
    rgb, grey = Image.fromarray(pixels()), Image.fromarray(pixels(channels=1))
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    marked = b"Exif\0\0" + exif()
    jpegs = {
        "plain": encoded(rgb, "JPEG", quality=70),
        "progressive": encoded(rgb, "JPEG", quality=60, progressive=True),
        "subsampled": encoded(rgb, "JPEG", quality=50, subsampling=2, restart_marker_blocks=3),
        "grey": encoded(grey, "JPEG", quality=60),
        "cmyk": encoded(rgb.convert("CMYK"), "JPEG", quality=60),
        "exif": encoded(rgb, "JPEG", quality=60, exif=marked),
        "exif-big-endian": encoded(rgb, "JPEG", quality=60, exif=b"Exif\0\0" + exif(">")),
        "profile": encoded(rgb, "JPEG", quality=60, icc_profile=profile),
    }
    for name, data in jpegs.items():
        write("photo", f"{name}.jpg", data)
    write("photo", "cut.jpg", jpegs["plain"][: len(jpegs["plain"]) // 2] + b"\xff\xd9")
    write("photo", "two.jpg", jpegs["plain"] + jpegs["grey"])

    png = encoded(rgb, "PNG")
    write("photo", "plain.png", png)
    write("photo", "grey.png", encoded(grey, "PNG"))
    write("photo", "palette.png", encoded(rgb.quantize(16), "PNG", transparency=3))
    write("photo", "alpha.png", encoded(Image.fromarray(pixels(channels=4)), "PNG"))
    write("photo", "sixteen.png", encoded(Image.fromarray(pixels(np.uint16, 1)), "PNG"))
    write("photo", "profile.png", encoded(rgb, "PNG", icc_profile=profile))
    gamma = struct.pack(">I", 100000)
    white = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
    chunks = [(b"cICP", bytes([9, 16, 0, 1])), (b"gAMA", gamma), (b"cHRM", white), (b"eXIf", exif())]
    write("photo", "chunks.png", png_with(png, chunks))
    for kind, body in chunks:
        write("photo", f"{kind.decode()}.png", png_with(png, [(kind, body)]))
    raw = f"\nexif\n{len(marked):8}\n{marked.hex()}\n".encode()
    write("photo", "text.png", png_with(png, [(b"zTXt", b"Raw profile type exif\0\0" + zlib.compress(raw))]))

    write("photo", "lossy.webp", encoded(rgb, "WEBP", quality=50))
    write("photo", "lossless.webp", encoded(rgb, "WEBP", lossless=True))
    write("photo", "alpha.webp", encoded(Image.fromarray(pixels(channels=4)), "WEBP", lossless=True))
    write("photo", "exif.webp", encoded(rgb, "WEBP", quality=50, exif=marked, icc_profile=profile))

    tiffs = {
        "plain": (pixels(), {}),
        "wide": (pixels(np.uint16), {"compression": "zlib", "predictor": True}),
        "float": (pixels(np.float32), {}),
        "half": (pixels(np.float16), {}),
        "u32": (pixels(np.uint32), {}),
        "planar": (np.moveaxis(pixels(), -1, 0), {"planarconfig": "separate"}),
        "tiles": (pixels(), {"tile": (16, 16)}),
        "grey": (pixels(channels=1), {}),
        "big": (pixels(), {"bigtiff": True}),
        "big-endian": (pixels(np.uint16), {"byteorder": ">"}),
        "profile": (pixels(), {"iccprofile": profile}),
    }
    for name, (values, options) in tiffs.items():
        out = io.BytesIO()
        photometric = "minisblack" if values.ndim == 2 else "rgb"
        tifffile.imwrite(out, values, photometric=photometric, metadata=None, **options)
        write("photo", f"{name}.tif", out.getvalue())
    for compression in ("packbits", "tiff_lzw", "jpeg"):
        write("photo", f"{compression}.tif", encoded(rgb, "TIFF", compression=compression))
    out = io.BytesIO()
    with tifffile.TiffWriter(out) as pages:
        pages.write(pixels()[:16, :16], photometric="rgb", subfiletype=1, metadata=None)
        pages.write(pixels(), photometric="rgb", metadata=None)
    write("photo", "pages.tif", out.getvalue())


def decoded(target: str, count: int, length: int, first: bytes = b"") -> None:
    """Seeds for targets that decode numbers from bytes: small bytes, for those mean the usual."""
    numbers = random.Random(target)
    for index in range(count):
        data = bytes(numbers.choice([numbers.randrange(200), numbers.randrange(8), index]) for _ in range(length))
        write(target, f"{index:02}", first + data)


def models() -> None:
    toy = TOY.read_bytes()
    # A header and the sections' table alone.
    write("model", "raw", b"\x04" + toy[:2048])
    write("model", "raw-checksum", b"\x08" + toy[:2048])
    change = struct.Struct("<BIBI")
    places = {"header": 12, "table": 72, "graph": 512, "layer": 4096, "weights": 100_000}
    for name, at in places.items():
        write("model", name, b"\x01" + change.pack(255 if at > 16 << 10 else 0, at, 0, 3))
    write("model", "good", b"\x01")


def reports() -> None:
    classes = ["fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood"]
    stages = ["frame", "net", "crf_albedo", "crf_normal", "search", "crf_roughness", "total"]
    report = (
        '{"version":"0","model":{"name":"m","hash":""},"size":2,"class":{"name":"wood","probabilities":{'
        + ",".join(f'"{name}":0.125' for name in classes)
        + '}},"light_scale":1.0,"flash":[0,0,1],"room_light":0.1,"residual":0.05,"fov_deg":43.35,"f0":0.05,'
        + '"timings_ms":{'
        + ",".join(f'"{name}":1.5' for name in stages)
        + '},"workspace_bytes":9,"engine":"int8","level":"avx2","warnings":["a \\u00e9 \\"b\\""]}'
    )
    write("writers", "report", b"\x00" + report.encode())


def main() -> None:
    shutil.rmtree(SEEDS, ignore_errors=True)
    photos()
    models()
    reports()
    decoded("frame", 24, 96)
    # Few: each is one or several captures, and all are run before the time begins to count.
    decoded("pipeline", 8, 96)
    decoded("c_interface", 8, 480)
    decoded("writers", 8, 160, b"\x01")


if __name__ == "__main__":
    main()
