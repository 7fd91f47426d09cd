"""Kills the program at every system call of a commit, and lets every call of it that changes the disk fail.

    faults.py FLASHMAT WORKDIR [CALL...]

With names of system calls, only these. Needs strace. A capture replaces an older result of another size, beside a note of the user's. For each system call of the
list below and each time that the run makes it, the run is repeated with a kill, or an error, injected there. Each time:
all maps and the report of the result are of one run (the old or the new one), the note is there, a run that says that it
went well has the new result, and a further run completes and leaves nothing hidden. Prints a table of counts; exit
status 1 if anything was not so. Only python3's own library is used.
"""

import json
import os
import shutil
import struct
import subprocess
import sys
import zlib
from collections import Counter
from pathlib import Path

CALLS = ["openat", "write", "mkdir", "rename", "renameat2", "link", "linkat", "fsync", "flock", "unlink", "rmdir", "close"]
# Errors that the call may give; reads and closes are only killed at.
ERRORS = {
    "openat": ["ENOSPC", "EACCES", "EIO", "EINTR"],
    "write": ["ENOSPC", "EIO", "EINTR"],
    "mkdir": ["ENOSPC", "EACCES", "EIO", "EINTR"],
    "rename": ["ENOSPC", "EACCES", "EIO", "EINTR"],
    "renameat2": ["ENOSPC", "EACCES", "EIO", "EINTR", "EINVAL"],
    "link": ["EPERM", "EIO"],
    "linkat": ["EPERM", "EIO"],
    "fsync": ["EIO", "ENOSPC", "EINTR", "EINVAL"],
    "flock": ["ENOLCK", "EINTR"],
    "unlink": ["EACCES", "EIO", "EINTR"],
    "rmdir": ["EACCES", "EIO", "EINTR"],
}
MAPS = ["albedo.png", "normal.png", "roughness.png", "render.png"]


def png(path: Path, side: int) -> None:
    """A photo of tiles, brighter in the middle."""

    def value(x: int, y: int) -> int:
        fall = 1 / (1 + 2 * ((x / side - 0.5) ** 2 + (y / side - 0.5) ** 2))
        return int((190 if (x // 20 + y // 20) % 2 else 120) * fall)

    rows = b"".join(
        b"\0" + bytes(c for x in range(side) for c in (value(x, y), value(x, y) * 9 // 10, value(x, y) * 7 // 10))
        for y in range(side)
    )

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def side_of(path: Path) -> int:
    """Width of a whole PNG file; 0 if it is not whole."""
    data = path.read_bytes() if path.exists() else b""
    return struct.unpack(">I", data[16:20])[0] if data.endswith(b"IEND\xaeB`\x82") else 0


class Trial:
    """One folder in which runs are spoilt."""

    def __init__(self, program: str, work: Path) -> None:
        self.program, self.work = program, work
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        png(work / "a.png", 160)
        self.seed = work / "seed"
        self.out = work / "out"
        self.check(self.capture(128, self.seed))
        (self.seed / "a" / "note").write_text("mine")

    def command(self, size: int, out: Path) -> list[str]:
        options = ["--size", str(size), "--threads", "1", "--no-refine", "--quiet", "--out", str(out)]
        return [self.program, "capture", *options, str(self.work / "a.png")]

    def capture(self, size: int, out: Path, *prefix: str) -> subprocess.CompletedProcess:
        return subprocess.run([*prefix, *self.command(size, out)], capture_output=True, text=True)

    @staticmethod
    def check(run: subprocess.CompletedProcess) -> None:
        if run.returncode:
            raise RuntimeError(run.stderr)

    def reset(self) -> None:
        shutil.rmtree(self.out, ignore_errors=True)
        shutil.copytree(self.seed, self.out)

    def counts(self) -> tuple[Counter, dict[str, int]]:
        """How often a good run makes each call, and how often before it first touches the output folder."""
        self.reset()
        log = self.work / "log"
        self.check(self.capture(256, self.out, "strace", "-f", "-o", str(log), "-e", "trace=" + ",".join(CALLS)))
        count, before, touched = Counter(), {}, False
        for line in log.read_text(errors="replace").splitlines():
            name = line.split(None, 1)[1].split("(", 1)[0] if " " in line else ""
            if name not in CALLS:
                continue
            if not touched and str(self.out) in line:
                touched, before = True, dict(count)
            count[name] += 1
        return count, before

    def spoilt(self, call: str, what: str, when: int) -> list[str]:
        """What is wrong after a run in which `what` happens at the given call."""
        self.reset()
        inject = f"inject={call}:{what}:when={when}"
        run = self.capture(256, self.out, "strace", "-f", "-o", "/dev/null", "-e", f"trace={call}", "-e", inject)
        wrong = []
        folder = self.out / "a"
        report = folder / "report.json"
        sides = {side_of(folder / name) for name in MAPS}
        sides.add(json.loads(report.read_text())["size"] if report.exists() else -1)
        if sides not in ({128}, {256}):
            # Without an exchange the old result may be in the work folder until the next run.
            if not (what.endswith("EINVAL") and not folder.exists()):
                wrong.append(f"maps of sizes {sides}")
        if run.returncode == 0 and sides != {256}:
            wrong.append("said to be done, but is not")
        if not (folder / "note").exists():
            wrong.append("the note is gone")
        again = self.capture(256, self.out)
        if again.returncode:
            wrong.append("the next run fails: " + again.stderr.strip())
        if {side_of(folder / name) for name in MAPS} != {256} or not (folder / "note").exists():
            wrong.append("the next run does not complete")
        left = sorted(os.listdir(self.out))
        if left != ["a"]:
            wrong.append(f"left behind: {left}")
        return wrong


def main() -> int:
    if not shutil.which("strace"):
        print("needs strace")
        return 2
    trial = Trial(os.path.abspath(sys.argv[1]), Path(sys.argv[2]).resolve())
    count, before = trial.counts()
    table, wrong = Counter(), []
    chosen = sys.argv[3:] or CALLS
    for call in chosen:
        for when in range(before.get(call, 0) + 1, count[call] + 1):
            for what in ["signal=KILL", *("error=" + e for e in ERRORS.get(call, []))]:
                found = trial.spoilt(call, what, when)
                table[call, "kills" if what.startswith("signal") else "errors"] += 1
                wrong += [f"{call} {what} at {when}: {w}" for w in found]
    print("| call | kills | errors |\n| --- | --- | --- |")
    for call in CALLS:
        if table[call, "kills"]:
            print(f"| {call} | {table[call, 'kills']} | {table[call, 'errors']} |")
    kills, errors = (sum(n for (_, kind), n in table.items() if kind == k) for k in ("kills", "errors"))
    print(f"| all | {kills} | {errors} |")
    print("\n".join(wrong))
    print(f"{len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
