#!/usr/bin/env python3
"""Puts models/NAME.md into models/NAME.fmat as its card; nothing else of the file changes.

    PYTHONPATH=train tools/card.py [models/phone.fmat]

Run it after every change to a card, then `tools/results.py`, which writes the file's new hash into docs/results.md.
"""

from __future__ import annotations

import sys
from pathlib import Path

from flashmat_train import modelfile

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    """Rewrites the file's card; SystemExit when anything else would change."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "models/phone.fmat"
    old = modelfile.read_model(path)
    before = modelfile.model_bytes(old)
    if before != path.read_bytes():
        raise SystemExit(f"{path}: another writer made it; writing it anew would change more than the card")
    old.card = path.with_suffix(".md").read_text()
    modelfile.write_model(path, old)


if __name__ == "__main__":
    main()
