"""Entry of ``python -m analysis``."""

import contextlib
import ctypes
import os
import signal
import sys
import threading

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of mallopt(3)
STARTED = os.getpid()


def stop(*_):
    """Answer Ctrl-C or kill: say so at once, end worker processes and kernels, and clean up."""
    if os.getpid() != STARTED:
        os._exit(130)  # a forked worker
    print("\nstopping: nothing half-written stays", file=sys.stderr, flush=True)
    threading.excepthook = lambda *_: None  # joblib's misses the work that is taken from it
    import psutil  # here, not above: a run that is not stopped does without it

    for child in psutil.Process().children(recursive=True):
        child.terminate()
    raise KeyboardInterrupt


os.environ.setdefault("OMP_NUM_THREADS", "1")  # channels and cells are the threads
# Of a study that is stopped, joblib's process that removes locks warns.
os.environ.setdefault("PYTHONWARNINGS", "ignore:resource_tracker")
os.environ.pop("MPLBACKEND", None)  # figures go into files, and matplotlib refuses an unknown one
with contextlib.suppress(AttributeError, TypeError, OSError):  # other systems have no mallopt
    # A long log fills the memory: freed arrays of 4 MB or more go back to the system at once.
    ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, 4 << 20)
    ctypes.CDLL(None).mallopt(M_TRIM_THRESHOLD, 16 << 20)
for stream in filter(None, (sys.stdout, sys.stderr)):  # none where it is closed
    stream.reconfigure(errors="replace")  # a terminal without Greek letters ends no run
try:
    for ending in (signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)):
        if ending == signal.SIGINT or signal.getsignal(ending) != signal.SIG_IGN:  # by nohup
            signal.signal(ending, stop)
    from workbench.cli import main

    status = main()
except KeyboardInterrupt:  # while a library was loaded
    status = 130
except ModuleNotFoundError as error:
    install = "make install, then . .venv/bin/activate"
    print(f"{error.name} is not installed: {install}", file=sys.stderr)
    status = 2
if status == 130:
    sys.stdout.flush()
    os._exit(status)  # threads that still compute are not waited for
sys.exit(status)
