"""One thread for each computation, so that its bits depend on no machine's number of cores."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager


@contextmanager
def single_threaded() -> Iterator[None]:
    """One BLAS, OpenMP and OpenCV thread inside the block; what was set before, after it.

    A sum over several threads is rounded in another order than over one: results would differ in
    their last bits between machines. Workers gain nothing from more threads than cores.
    """
    from threadpoolctl import threadpool_limits

    with ExitStack() as stack:
        stack.enter_context(threadpool_limits(limits=1))
        cv2 = sys.modules.get("cv2")
        if cv2 is not None:
            stack.callback(cv2.setNumThreads, cv2.getNumThreads())
            cv2.setNumThreads(1)
        yield
