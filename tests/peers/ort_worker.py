"""Runs one ONNX graph in ONNX Runtime when told to, on one thread: the peer of server.rs, with its protocol.

`ort_worker.py GRAPH INPUT.npy OUT.npz`; prints `ready`, then for each line of standard input wall-clock and CPU
milliseconds of one run.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import onnxruntime


def main(graph: str, source: str, out: str) -> None:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
    session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    feed = {"input": np.load(source)}
    names = [o.name for o in session.get_outputs()]
    np.savez(out, **dict(zip(names, session.run(None, feed), strict=True)))
    print("ready", onnxruntime.__version__, flush=True)
    for _ in sys.stdin:
        start, cpu = time.perf_counter(), time.thread_time()
        session.run(None, feed)
        cpu, wall = time.thread_time() - cpu, time.perf_counter() - start
        print(wall * 1e3, cpu * 1e3, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
