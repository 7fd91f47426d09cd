"""A small run of the `mitsuba-check` stage. In a process of its own: an LLVM too old for Dr.Jit aborts the process."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest


def test_renderer_agrees_with_mitsuba(real_or_generated: Path) -> None:
    required = bool(os.environ.get("FLASHMAT_REQUIRE_MITSUBA"))
    if importlib.util.find_spec("mitsuba") is None and not required:
        pytest.skip("Mitsuba 3 is not installed (pip install mitsuba): the comparison was not made")
    options = ["--data", str(real_or_generated), "--scenes", "3", "--size", "16", "--spp", "2048", "--threads", "1"]
    path = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "flashmat_train", "mitsuba-check", *options],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=900,
    )
    print(done.stdout, done.stderr[-2000:])
    if not required and ("Mitsuba has no variant that runs here" in done.stderr or "LLVM ERROR" in done.stderr):
        pytest.skip("Mitsuba has no usable LLVM here: the comparison was not made")
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
