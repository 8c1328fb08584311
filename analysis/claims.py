"""What the papers claim, what came out here, and the verdict: the ledger behind every notebook.

``data/published/claims.csv`` holds each claim with the range of values that would count as
agreement, set before any notebook ran (its README tells which were set knowing a closed form). A
notebook hands its value and 95 % interval to `Ledger.check`;
``figures/claims.csv`` holds the verdicts.
"""

import math
from collections.abc import Mapping

import pandas as pd
from filelock import FileLock

from analysis import DATA, Estimate, WrongUsage, engineering, figures_folder, pretty, replacing

__all__ = ["Ledger", "published", "verdicts"]

COLUMNS = ["id", "verdict", "value", "low", "high", "unit", "notebook"]
NOT_YET = "not yet run"
REPRODUCED, NOT_REPRODUCED, NOT_TESTABLE = "reproduced", "not reproduced", "not testable"
OUTCOMES = "^(reproduced if|reproduced|not [a-z]+(?: run)?)"


def published() -> pd.DataFrame:
    """Read the papers' claims.

    Returns
    -------
    pandas.DataFrame, indexed by id
    """
    return pd.read_csv(DATA / "published" / "claims.csv").set_index("id")


def verdicts() -> pd.DataFrame:
    """Read the verdict on every claim, in the order of the papers; those to come are not yet run.

    Returns
    -------
    pandas.DataFrame, indexed by id
        paper, where, claim; verdict, and its ``outcome`` without condition or reason; value, low,
        high, unit, and these four in words as ``reproduced``; notebook.
    """
    path = figures_folder() / "claims.csv"
    known = (
        pd.read_csv(path, dtype={"unit": str}).set_index("id")
        if path.exists()
        else pd.DataFrame(columns=COLUMNS[1:])
    )
    table = published()[["paper", "where", "claim", "quantity"]].join(known)
    table["verdict"] = table["verdict"].astype(object).fillna(NOT_YET)
    table["outcome"] = table["verdict"].str.extract(OUTCOMES)[0]
    table["reproduced"] = [_in_words(row) for _, row in table.iterrows()]
    return table.drop(columns="quantity")


def judge(value, low, high, agree_low, agree_high):
    """Compare a value and its 95 % interval with the range that counts as agreement.

    Parameters
    ----------
    value, low, high : float or None
        What came out here; None where it is unresolved, or unbounded on that side.
    agree_low, agree_high : float
        NaN where the claim is unbounded on that side.

    Returns
    -------
    str
    """
    floor = -math.inf if math.isnan(agree_low) else agree_low
    ceiling = math.inf if math.isnan(agree_high) else agree_high
    if value is not None and low is None and high is None:  # known exactly
        low = high = value
    bottom, top = (-math.inf if low is None else low), (math.inf if high is None else high)
    if top < floor or bottom > ceiling:
        return NOT_REPRODUCED
    if value is None:
        return f"{NOT_TESTABLE}: the log leaves {_span(low, high)} open"
    if floor <= bottom and top <= ceiling:
        return REPRODUCED
    return (
        f"{NOT_TESTABLE}: the 95 % interval {_span(low, high)} is partly outside the claim's range"
    )


class Ledger:
    """The verdicts of one notebook; each check is written down at once.

    Parameters
    ----------
    notebook : str
        Its file name without the suffix. What it said on an earlier run is struck out.
    """

    def __init__(self, notebook: str):
        self.notebook = notebook
        self._published = published()
        self._mine: dict[str, dict] = {}

    def check(
        self,
        claim: str,
        value: Estimate | float | bool | None,
        low: float | None = None,
        high: float | None = None,
        *,
        when: str | None = None,
        untestable: str | None = None,
    ) -> str:
        """Judge one claim and write the verdict down.

        Parameters
        ----------
        claim : str
            Its id in ``data/published/claims.csv``.
        value : Estimate, float, bool or None
            The reproduced number; for a yes/no sentence whether it holds; None where unresolved.
        low, high : float, optional
            Its 95 % interval; an Estimate brings its own.
        when : str, optional
            The condition under which it is reproduced: the verdict reads "reproduced if ...".
        untestable : str, optional
            Why it cannot be tested here; then `value` does not count.

        Returns
        -------
        str
            The verdict.
        """
        row = self._row(claim)
        ends = _ends(value) if isinstance(value, Estimate) else (value, low, high)
        value, low, high = (None if x is None or x != x else float(x) for x in ends)
        if untestable:
            verdict = f"{NOT_TESTABLE}: {untestable}"
        else:
            verdict = judge(value, low, high, row["low"], row["high"])
            if when and verdict == REPRODUCED:
                verdict = f"{REPRODUCED} if {when}"
        numbers = {"value": _short(value), "low": _short(low), "high": _short(high)}
        entry = {"id": claim, "verdict": verdict, **numbers, "unit": row["unit"]}
        self._mine[claim] = entry | {"notebook": self.notebook}
        self._write()
        return verdict

    def check_from(
        self,
        claim: str,
        by_setting: Mapping[float, Estimate | tuple[float | None, float | None, float | None]],
        default: float,
        when: str,
    ) -> str:
        """Judge a claim whose verdict may hang on one setting that the paper leaves open.

        It is reproduced outright if it is at every setting, under a condition if from some setting
        on it always is, and else judged at the default.

        Parameters
        ----------
        claim : str
        by_setting : dict of float to Estimate, or to (value, low, high)
            What came out at each setting.
        default : float
            The setting that the notebook runs with, one of those.
        when : str
            The condition, with a place for the least setting: ``"R is at least {:g} times ..."``.

        Returns
        -------
        str
            The verdict.
        """
        row = self._row(claim)
        settings = sorted(by_setting)
        agrees = (row["low"], row["high"])
        holds = [judge(*(*_ends(by_setting[x]), *agrees)) == REPRODUCED for x in settings]
        start = len(holds) - holds[::-1].index(False) if False in holds else 0
        if start in (0, len(holds)):
            return self.check(claim, *_ends(by_setting[default]))
        least = settings[start]
        return self.check(claim, *_ends(by_setting[least]), when=when.format(least))

    def untestable(self, claim: str) -> str:
        """Write down a claim that no data here can decide, with the reason of its own row.

        Returns
        -------
        str
            The verdict.
        """
        why = self._row(claim)["why"]
        if not why.startswith(f"{NOT_TESTABLE}: "):
            raise WrongUsage(f"claim '{claim}' can be tested: hand its value to `check`")
        return self.check(claim, None, untestable=why.removeprefix(f"{NOT_TESTABLE}: "))

    def table(self) -> pd.DataFrame:
        """Lay published and reproduced side by side, for the notebook's last section.

        Returns
        -------
        pandas.DataFrame
        """
        rows = []
        for claim, mine in self._mine.items():
            theirs = self._published.loc[claim]
            rows.append(
                {
                    "where": theirs["where"],
                    "claim": theirs["claim"],
                    "published": _number(theirs["value"], theirs),
                    "agrees within": "yes" if _asks(theirs) else _interval(theirs),
                    "reproduced": _number(mine["value"], theirs) or "–",
                    "95 % interval": _interval(mine),
                    "verdict": mine["verdict"],
                }
            )
        return pd.DataFrame(rows)

    def _row(self, claim):
        if claim not in self._published.index:
            raise WrongUsage(f"no claim '{claim}' in data/published/claims.csv")
        return self._published.loc[claim]

    def _write(self):
        path = figures_folder() / "claims.csv"
        path.parent.mkdir(parents=True, exist_ok=True)  # for the lock
        mine = pd.DataFrame(list(self._mine.values()), columns=COLUMNS)
        with FileLock(path.with_suffix(".lock")):  # other notebooks may be writing theirs
            rows = verdicts().reset_index()
            others = rows[(rows["verdict"] != NOT_YET) & (rows["notebook"] != self.notebook)]
            parts = [part[COLUMNS] for part in (others, mine) if len(part)]
            table = pd.concat(parts, ignore_index=True).set_index("id")
            table = table.reindex([i for i in self._published.index if i in table.index])
            with replacing(path) as draft:
                draft.write_text(table.to_csv(lineterminator="\n"), encoding="utf-8")


def _ends(estimate):
    if isinstance(estimate, Estimate):
        return estimate.value, estimate.low, estimate.high
    return estimate


def _short(x):
    """Three digits: what an interval of this kind means, and what another machine prints too."""
    return None if x is None else float(f"{x:.3g}")


def _in_words(row):
    """Write value and interval of a verdict with its unit."""
    if row["verdict"] == NOT_YET:
        return "–"
    words = [_number(row["value"], row)]
    if _interval(row) != "–":
        words.append(f"({_interval(row)} {pretty(row['unit'])}".strip() + ")")
    return " ".join(words).strip() or "–"


def _number(value, row):
    """Write a value in the unit of its row, or yes or no where the claim asks for that."""
    if value is None or value != value:
        return ""
    if _asks(row) and value in (0, 1):
        return "yes" if value else "no"
    return f"{value:g} {pretty(row['unit'])}".strip()


def _asks(row):
    return row["quantity"].startswith("1 if")


def _interval(row):
    span = _span(row["low"], row["high"], digits=6)  # as published, or rounded before
    return "–" if span == _span(None, None) else span


def _span(low, high, digits=3):
    def end(x):
        return "…" if x is None or x != x else engineering(x, digits)

    return f"{end(low)} to {end(high)}"
