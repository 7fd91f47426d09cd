"""The picture of the sweep over environment strengths."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from flashmat_train.__main__ import main
from flashmat_train.sweep import COLOURS, PANELS, read


def test_every_curve_is_drawn_and_other_files_are_refused(tmp_path: Path) -> None:
    head = ",".join(("environment", *PANELS))
    for name, offset in (("a", 1.0), ("b", 2.0)):
        lines = [f"{s / 10:.2f}," + ",".join(f"{offset + s * k:.3f}" for k in range(len(PANELS))) for s in range(9)]
        (tmp_path / f"{name}.csv").write_text("\n".join((head, *lines)) + "\n")
    x, y = read(tmp_path / "a.csv")["normal_mse_paper"]
    assert x[-1] == 0.8 and y[-1] == 17.0
    out = tmp_path / "sweep.png"
    main(["sweep", "--csv", f"one={tmp_path / 'a.csv'}", "--csv", f"two={tmp_path / 'b.csv'}", "--out", str(out)])
    pixels = np.asarray(Image.open(out)).reshape(-1, 3)
    for colour in COLOURS[:2]:
        assert (pixels == colour).all(axis=1).sum() > 500
    (tmp_path / "c.csv").write_text("a,b\n1,2\n")
    with pytest.raises(SystemExit, match="not a file of"):
        read(tmp_path / "c.csv")
    with pytest.raises(SystemExit, match="LABEL=FILE"):
        main(["sweep", "--csv", "x.csv", "--out", str(out)])
