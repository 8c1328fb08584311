"""Entry of ``python -m analysis``."""

import sys

for stream in (sys.stdout, sys.stderr):  # a terminal without Greek letters ends no run
    stream.reconfigure(errors="replace")  # type: ignore[union-attr]
try:
    from analysis.cli import main

    sys.exit(main())
except ModuleNotFoundError as error:
    install = "make install, then . .venv/bin/activate"
    print(f"{error.name} is not installed: {install}", file=sys.stderr)
    sys.exit(2)
