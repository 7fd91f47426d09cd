"""Items made by a second process while the first one works on those before."""

from __future__ import annotations

import queue
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import torch
import torch.multiprocessing as mp

#: Seconds after which a silent process is asked whether it still lives.
PATIENCE = 5.0


@dataclass
class _End:
    """The last thing that the other process says: why it stopped, or nothing."""

    trouble: str | None


class Prefetch:
    """An iterator over what `make()` gives in a process of its own, at most `depth` items ahead.

    `make` and the items are pickled; tensors travel through shared memory. What goes wrong there is raised here, as
    RuntimeError with its traceback. Close it, or use it as a context, so that the process ends with its user.
    """

    def __init__(self, make: Callable[[], Iterator[Any]], depth: int = 4):
        context = mp.get_context("spawn")
        self.queue = context.Queue(depth)
        self.read = context.Event()
        self.process = context.Process(target=_fill, args=(make, self.queue, self.read), daemon=True)
        self.process.start()

    def __iter__(self) -> Prefetch:
        return self

    def __next__(self) -> Any:
        while True:
            try:
                item = self.queue.get(timeout=PATIENCE)
                break
            except queue.Empty:
                if not self.process.is_alive():
                    raise RuntimeError(
                        f"the process that makes photos ended with code {self.process.exitcode}: out of memory?"
                    ) from None
        if isinstance(item, _End):
            self.close()
            if item.trouble:
                raise RuntimeError(f"the process that makes photos failed:\n{item.trouble}")
            raise StopIteration
        return item

    def __enter__(self) -> Prefetch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the process; what it has made is lost."""
        self.read.set()
        self.process.terminate()
        self.process.join()
        self.queue.cancel_join_thread()
        self.queue.close()


def _fill(make: Callable[[], Iterator[Any]], out: mp.Queue, read: Any) -> None:
    torch.set_num_threads(1)
    trouble = None
    try:
        for item in make():
            out.put(item)
    except BaseException as e:  # also SystemExit, whose sentence says what is wrong
        trouble = str(e) if isinstance(e, SystemExit) else traceback.format_exc()
    out.put(_End(trouble))
    read.wait()  # tensors that the other has not read yet are this process's
