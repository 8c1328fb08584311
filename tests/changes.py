"""What moved since a revision: ``python tests/changes.py REVISION`` writes it into CHANGELOG.md.

There the newest version has the two lines between which the tables belong.
Compares the verdicts and values of ``figures/claims.csv`` there with those of this checkout. A
value has moved if it left its old 95 % interval or, where it had none, by more than 2 %.
"""

import io
import re
import subprocess
import sys

import pandas as pd

from analysis import FIGURES, ROOT
from analysis.claims import OUTCOMES, _in_words

OUTCOME = re.compile("|".join(sorted(OUTCOMES, reverse=True)))
MOVED = 0.02
START, END = "<!-- moved -->", "<!-- end of what moved -->"


def ledger(revision=None):
    """Read the verdicts of a revision, or those of this checkout."""
    if revision is None:
        text = (FIGURES / "claims.csv").read_text(encoding="utf-8")
    else:
        words = ["git", "-C", ROOT, "show", f"{revision}:figures/claims.csv"]
        run = subprocess.run(words, capture_output=True, text=True, check=False)
        if run.returncode:
            lacks = "invalid object" not in run.stderr
            raise SystemExit(
                f"revision {revision} has no figures/claims.csv"
                if lacks
                else f"there is no revision {revision}"
            )
        text = run.stdout
    table = pd.read_csv(io.StringIO(text), dtype={"unit": str}).set_index("id")
    return table.assign(outcome=[OUTCOME.match(v)[0] for v in table["verdict"]])


def moved(was, now):
    """Tell whether a value left its interval, or moved by more than 2 % where it had none."""
    if not (was["value"] == was["value"] and now["value"] == now["value"]):
        return False
    low, high = was["low"], was["high"]
    if (low == low or high == high) and low != high:  # an end that is open is NaN
        return now["value"] < low or now["value"] > high
    return abs(now["value"] - was["value"]) > MOVED * abs(was["value"])


def tables(revision):
    """Yield the lines of the tables."""
    was, now = ledger(revision), ledger()
    both = now.index.intersection(was.index)
    changed = [c for c in both if was["outcome"][c] != now["outcome"][c]]
    yield f"Of {len(both)} claims in both, {len(changed)} have another verdict.\n"
    yield "| was | is | claims |\n|---|---|---|"
    kinds: dict[tuple, list] = {}
    for claim in changed:
        is_now = re.sub(r"(by construction: [^:]*).*", r"\1", now["verdict"][claim])
        kinds.setdefault((was["outcome"][claim], is_now), []).append(claim)
    for (before, after), claims in sorted(kinds.items()):
        yield (f"| {before} | {after} | {', '.join(f'`{claim}`' for claim in claims)} |")
    numbers = [c for c in both if moved(was.loc[c], now.loc[c])]
    yield (f"\nNumbers that moved ({len(numbers)}):\n\n| claim | was | is |\n|---|---|---|")
    for claim in numbers:
        yield (f"| `{claim}` | {_in_words(was.loc[claim])} | {_in_words(now.loc[claim])} |")
    for word, of in (
        ("New", now.index.difference(was.index)),
        ("Gone", was.index.difference(both)),
    ):
        yield (f"\n{word} ({len(of)}): {', '.join(f'`{claim}`' for claim in of)}.")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("say since which revision: python tests/changes.py 073ead1")
    log = ROOT / "CHANGELOG.md"
    before, _, rest = log.read_text(encoding="utf-8").partition(START)
    _, _, after = rest.partition(END)
    written = "\n".join(tables(sys.argv[1]))
    log.write_text(f"{before}{START}\n\n{written}\n\n{END}{after}", encoding="utf-8")
