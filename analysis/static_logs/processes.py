"""Work in two processes at once, that Ctrl-C ends, with a progress bar."""

import ctypes
import gc
import multiprocessing
import signal
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor

from tqdm import tqdm

AT_ONCE = 2  # channels, or figures
_work: list[Callable] = []  # of a process that `in_processes` has made


def in_processes(work: Callable, jobs: Sequence, **bar) -> list:
    """Do some jobs in processes, two at a time, with a progress bar.

    Parameters
    ----------
    work : callable
        A job to its result. Under Linux the processes have what it refers to without a copy.
    jobs : sequence
    **bar
        For tqdm.

    Returns
    -------
    list
        The results, in the order of the jobs.
    """
    bar["total"] = len(jobs)
    if min(AT_ONCE, len(jobs)) == 1 or multiprocessing.current_process().daemon:
        return list(tqdm(map(work, jobs), **bar))
    how = multiprocessing.get_context("fork" if sys.platform == "linux" else None)
    processes = ProcessPoolExecutor(AT_ONCE, how, _begin, (work,))
    try:
        return list(tqdm(processes.map(_do, jobs), **bar))
    finally:  # after Ctrl-C nobody waits for what is being computed, or written
        processes.shutdown(not isinstance(sys.exception(), KeyboardInterrupt), cancel_futures=True)


def _begin(work):
    """Prepare a process for its jobs; Ctrl-C is the parent's, which ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: none outlives its parent
    gc.freeze()  # a collection would copy all objects that are the parent's
    _work[:] = [work]


def _do(job):
    return _work[0](job)
