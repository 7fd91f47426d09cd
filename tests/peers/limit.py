"""A copy of ONNX Runtime that believes that this CPU stops at AVX2.

ONNX Runtime has no switch for that. It learns of AVX-512 and AMX from XGETBV, and of AVX-VNNI from a bit of CPUID leaf
7.1: the copy's XGETBV instructions (0f 01 d0) become `push 7; pop rax` (x87, SSE, AVX state and no more), and its
`cpuid; test al, 0x10` becomes `cpuid; test al, 0`.
"""

from __future__ import annotations

import shutil
from pathlib import Path

XGETBV, ONLY_AVX = b"\x0f\x01\xd0", b"\x6a\x07\x58"
AVX_VNNI, NEVER = b"\x0f\xa2\xa8\x10", b"\x0f\xa2\xa8\x00"


def copy(package: Path, folder: Path) -> bool:
    """Copies the package into `folder`, limited to AVX2; `False` when the library does not have the code expected."""
    target = folder / package.name
    shutil.copytree(package, target, dirs_exist_ok=True, ignore=shutil.ignore_patterns("*.pyc", "libonnxruntime.so*"))
    (library,) = (target / "capi").glob("onnxruntime_pybind11_state*.so")
    code = library.read_bytes()
    if not code.count(XGETBV) or not code.count(AVX_VNNI):
        return False
    library.write_bytes(code.replace(XGETBV, ONLY_AVX).replace(AVX_VNNI, NEVER))
    return True
