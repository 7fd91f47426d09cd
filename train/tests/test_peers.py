"""The graphs that peers run (tests/peers/graphs.py) compute what the model files say: the toy's and the product's."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flashmat_train import modelfile
from flashmat_train.int8_reference import network_input, run_float

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests/peers"))

import graphs  # noqa: E402

SIZE = 128


def photo() -> np.ndarray:
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE * 2 - 1
    waves = np.stack([0.4 + 0.2 * np.sin(20 * x + 7 * y * c) for c in (1, 2, 3)])
    return (waves * np.exp(-(x * x + y * y))).astype(np.float32)


def in_float(model: modelfile.Model) -> modelfile.Graph:
    """The file's graph with the float weights that its int8 ones stand for."""
    layers = []
    for layer in model.graph.layers:
        if isinstance(layer, modelfile.Conv | modelfile.Depthwise):
            weight, bias = graphs.real_weights(layer, model.graph)
            layer = replace(layer, weight=weight, bias=bias)
        layers.append(layer)
    return replace(model.graph, layers=layers)


@pytest.mark.parametrize("file", ["tests/golden/toy.fmat", "models/phone.fmat"])
def test_a_peers_graph_computes_what_the_file_says(file: str) -> None:
    model = modelfile.read_model(ROOT / file)
    image = network_input(photo()).astype(np.float32)
    want = run_float(in_float(model), image)
    graph = graphs.build(model, want.probabilities)
    onnx.checker.check_model(graph, full_check=True)
    session = onnxruntime.InferenceSession(graph.SerializeToString(), providers=["CPUExecutionProvider"])
    names = [o.name for o in session.get_outputs()]
    got = dict(zip(names, session.run(None, {"input": image.transpose(2, 0, 1)[None]}), strict=True))
    assert np.abs(got["probabilities"][0] - want.probabilities).max() < 1e-4
    for name, planes in want.maps.items():
        # Residuals are added as they are there, times a rounded one in the file.
        assert np.sqrt(np.mean((got[name][0] - planes) ** 2)) < 2e-3, name


def test_residuals_become_additions() -> None:
    model = modelfile.read_model(ROOT / "models/phone.fmat")
    graph = graphs.build(model, np.full(8, 0.125)).graph
    folded = [c for c in model.graph.layers if isinstance(c, modelfile.Conv) and len(c.sources) == 2]
    folded = [c for c in folded if c.weight_q.shape[1:3] == (1, 1)]
    assert len([n for n in graph.node if n.name.endswith(".sum") and n.op_type == "Add"]) == len(folded) > 0
