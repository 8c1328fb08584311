"""What the papers claim, what came out here, and the verdict: the ledger behind every notebook.

``data/published/claims.csv`` holds each claim with the range of values that would count as
agreement, set before any notebook ran (its README tells which were set knowing a closed form). A
notebook hands its value and 95 % interval to `Ledger.check`, or what many simulated logs gave to
`Ledger.check_logs`; ``figures/claims.csv`` holds the verdicts. What a notebook found, in one
sentence that an engineer can use, goes by `finding` to ``figures/findings.csv``.

Two kinds of claim are not judged: those that no data here can decide, and those that could not have
come out otherwise (an input handed back, an identity, print against print). The register says so,
where ``why`` begins with ``not testable:`` or ``by construction:``. The checks refuse these claims,
so that none of them can be called reproduced; the `Ledger` of a notebook writes down those that the
register lists under it, with the first check or with its table.
"""

import math
import re
from typing import Any

import numpy as np
import pandas as pd
from filelock import FileLock
from numpy.typing import ArrayLike

from analysis import (
    DATA,
    FIGURES,
    Estimate,
    WrongUsage,
    engineering,
    figures_folder,
    pretty,
    replacing,
    text,
)

__all__ = [
    "INTEGRATED", "OUTCOMES", "Ledger", "counted", "counts", "finding", "independent", "learned",
    "of_paper", "published", "verdicts",
]  # fmt: skip

ONCE = ["id", "verdict", "value", "low", "high", "unit", "notebook"]
# Of a claim on tracking, which is judged twice; value, low and high are then as the paper did.
WAYS = ["as_the_paper_did", "as_a_car_does"]
TWICE = [*WAYS, "car_value", "car_low", "car_high"]
COLUMNS = ONCE + TWICE
ON_ATTITUDE = "the noise is put on the attitude as a density"
INTEGRATED = "the noise is integrated, as in a car"
FOUND = ["notebook", "sentence", "condition", "figure", "so"]
MOST_WORDS, MOST_WHEN = 30, 65  # of the sentence of a finding, and of its condition
NOT_YET = "not yet run"
REPRODUCED, NOT_REPRODUCED, NOT_TESTABLE = "reproduced", "not reproduced", "not testable"
# Undecidable is a result: what is at hand, or a log of this length, cannot tell.
UNDECIDABLE, BY_CONSTRUCTION = "undecidable", "by construction"
OUTCOMES = (
    REPRODUCED, f"{REPRODUCED} if", NOT_REPRODUCED, f"{NOT_REPRODUCED} if", UNDECIDABLE,
    NOT_TESTABLE, BY_CONSTRUCTION, NOT_YET,
)  # fmt: skip
NOT_JUDGED = (f"{NOT_TESTABLE}: ", f"{BY_CONSTRUCTION}: ")  # beginning of such a row's reason
THAT_DAY = "about these units on that day"  # in the reason of a sentence that nobody can rerun
FEWEST_LOGS = 200  # simulated logs that a verdict on something random needs
YES_OR_NO = "yes or no"  # unit of a claim that is one or the other
# How numbers without a unit of their own are written: before, factor, after.
WRITTEN = {"times": ("× ", 1, ""), "share": ("", 100, " %"), "count": ("", 1, "")}
MOST = 0.9  # share of the logs in which a claim has to come out, or to fail, for a verdict


def published() -> pd.DataFrame:
    """Read the papers' claims.

    Returns
    -------
    pandas.DataFrame, indexed by id
    """
    return pd.read_csv(DATA / "published" / "claims.csv").set_index("id")


def finding(notebook: str, sentence: str, *, when: str, figure: str, so: str = "") -> text.Shown:
    """Record what a notebook found, for the index, README and the site; the last call counts.

    In a notebook that is run by hand nothing is written.

    Parameters
    ----------
    notebook : str
        Its file name without the suffix.
    sentence : str
        What an engineer can use: at most 30 words, its numbers computed and with units.
    when : str
        The condition under which it was found: data, simulation, setting; at most 65 words.
    figure : str
        Name of the figure that shows it, as in `figures.save`.
    so : str
        What to do differently, if anything: heads the README, the index and the site.

    Returns
    -------
    text.Shown
        The sentence with its condition.
    """
    sentence, when = " ".join(sentence.split()), " ".join(when.split())
    for part, said, most in (("finding", sentence, MOST_WORDS), ("condition", when, MOST_WHEN)):
        if (words := len(said.split())) > most:
            raise WrongUsage(f"the {part} of {notebook} has {words} words: at most {most}")
    row = dict(zip(FOUND, (notebook, sentence, when, figure, so), strict=True))
    _write_down("findings", notebook, [row], FOUND, lambda table: table.sort_values("notebook"))
    return text.Shown(f"**Finding.** {sentence} *{when}*")


def findings() -> pd.DataFrame:
    """Read what the notebooks found: first what says to do something differently.

    Returns
    -------
    pandas.DataFrame, indexed by number, from 1
        Columns notebook, sentence, condition, figure, so.
    """
    table = pd.read_csv(_register("findings"), keep_default_na=False)
    table = table.sort_values("so", key=lambda so: so == "", kind="stable", ignore_index=True)
    return table.set_index(table.index + 1)


def learned(*, to_do: bool) -> text.Shown:
    """Lay out the findings for the index: small picture, sentence, condition, link.

    Parameters
    ----------
    to_do : bool
        Those that say what to do differently, headed by it; or the others.

    Returns
    -------
    text.Shown
    """
    rows, known = [], findings()
    for row in known[known["so"].ne("") == to_do].itertuples():
        path = f"../figures/{row.figure}.png"
        picture = f'<a href="{path}"><img src="{path}" width="180" alt="{row.figure}"></a>'
        link = f"[{row.notebook}]({row.notebook}.ipynb)"
        said = f"{row.so}**<br>{row.sentence}" if to_do else f"{row.sentence}**"
        rows.append([picture, f"**{row.Index}. {said}<br>{row.condition} {link}"])
    wide = "&nbsp;" * 32  # so that no browser squeezes the pictures
    return text.table(pd.DataFrame(rows, columns=[wide, "what was found, and when"]))


def counts() -> pd.DataFrame:
    """Count the verdicts of each paper, one for each computation.

    A claim that the same computation decides as another one (``same_as`` in the register) counts
    with that one. Sentences about the papers' own units on that day are history and do not count.

    Returns
    -------
    pandas.DataFrame, indexed by paper
        A column for each of `OUTCOMES`.
    """
    rows = independent()
    return pd.crosstab(rows["paper"], rows["outcome"]).reindex(columns=OUTCOMES, fill_value=0)


def independent() -> pd.DataFrame:
    """Give the claims that count as `verdicts` has them: one for each computation, no history."""
    register = published()
    return verdicts()[register["same_as"].isna() & ~register["why"].str.contains(THAT_DAY)]


def counted() -> text.Shown:
    """Count the verdicts in a sentence."""
    n, claimed = counts().sum(), len(published())
    agree, differ = (n[kind] + n[f"{kind} if"] for kind in (REPRODUCED, NOT_REPRODUCED))
    waiting = f", and {n[NOT_YET]} wait for a notebook" * bool(n[NOT_YET])
    ways = independent()[["outcome", *WAYS]].dropna()
    taken, paper, car = (sum(said.startswith(REPRODUCED) for said in ways[of]) for of in ways)
    twice = (
        f" On tracking, {len(ways)} claims of the terrain paper are judged twice: with the noise of"
        f" a gyro on the attitude, as in its text, {paper} hold; with it integrated, as in eq. (1)"
        f" and in a car, {car}. Counted above is the former, chosen also because more claims hold"
        f" there, or the car's where that is open; by the car's {agree - taken + car} hold in all."
    )
    return text.Shown(
        f"The papers make {claimed} claims; {n.sum()} are distinct (each computation once,"
        f" history left out). {agree} of these are reproduced, {n[REPRODUCED]} of them without a"
        " condition (such as that the sensor is its printed model; several choices that a paper"
        f" leaves open may reverse them together); {differ} are not,"
        f" {n[NOT_REPRODUCED]} without one; {n[UNDECIDABLE]} are left open by the data or logs"
        f" as long as the papers', {n[NOT_TESTABLE]} need data not at hand; {n[BY_CONSTRUCTION]}"
        f" could not have come out otherwise and are no evidence{waiting}."
        f"{twice * bool(len(ways))}"
    )


def of_paper(paper: str) -> text.Shown:
    """Lay out the main claims of a paper: its own results, as its abstract and conclusions say.

    Parameters
    ----------
    paper : str

    Returns
    -------
    text.Shown
    """
    main = published()["main"] == "yes"
    rows = verdicts()[lambda rows: (rows["paper"] == paper) & main]
    rows = rows.assign(notebook=[f"[{n[:2]}]({n}.ipynb)" for n in rows["notebook"].fillna("--")])
    rows = rows.rename(columns={"reproduced": "came out as"})
    return text.table(rows[["claim", "published", "came out as", "verdict", "notebook"]])


def _register(name):
    return (figures_folder() or FIGURES) / f"{name}.csv"


def _known(name, columns):
    """Read a table that all notebooks share; before one has written, there is an empty one."""
    csv = _register(name)
    return pd.read_csv(csv, dtype={"unit": str}) if csv.exists() else pd.DataFrame(columns=columns)


def _write_down(name, notebook, rows, columns, in_order):
    """Put the rows of one notebook in place of its earlier ones in a table that all share."""
    if figures_folder() is None:  # run by hand
        return
    path = _register(name)
    path.parent.mkdir(parents=True, exist_ok=True)  # for the lock
    with FileLock(path.with_suffix(".lock")):  # other notebooks may be writing theirs
        known = _known(name, columns)
        parts = [known[known["notebook"] != notebook], pd.DataFrame(rows, columns=columns)]
        parts = [part for part in parts if len(part)] or parts
        table = pd.concat(parts, ignore_index=True)
        with replacing(path) as draft:
            draft.write_text(in_order(table).to_csv(index=False, lineterminator="\n"), "utf-8")


def verdicts() -> pd.DataFrame:
    """Read the verdict on every claim, in the order of the papers; those to come are not yet run.

    Returns
    -------
    pandas.DataFrame, indexed by id
        paper, where, claim; verdict, and its ``outcome`` without condition or reason; value, low,
        high, unit, and these four in words as ``reproduced``; ``published`` in words; notebook.
    """
    known, register = _known("claims", COLUMNS).set_index("id"), published()
    table = register[["paper", "where", "claim", "unit"]].join(known.drop(columns="unit"))
    table["verdict"] = table["verdict"].astype(object).fillna(NOT_YET)
    outcomes = "|".join(sorted(OUTCOMES, reverse=True))
    table["outcome"] = table["verdict"].str.extract(f"^({outcomes})")[0]
    table["published"] = [_published(row) for _, row in register.iterrows()]
    table["reproduced"] = [_in_words(row) for _, row in table.iterrows()]
    for claim, row in table[table["as_a_car_does"].notna()].iterrows():
        table.loc[claim, "reproduced"] += f"; in a car {_in_words(_in_a_car(row))}"
    return table


def judge(value, low, high, agree_low, agree_high, unit="1"):
    """Compare a value and its 95 % interval with the range that counts as agreement.

    Parameters
    ----------
    value, low, high : float or None
        What came out here; None where it is unresolved, or unbounded on that side.
    agree_low, agree_high : float
        NaN where the claim is unbounded on that side.
    unit : str
        In which an open interval is told.

    Returns
    -------
    str
    """
    bottom, top = (-math.inf if low is None else low), (math.inf if high is None else high)
    if top < agree_low or bottom > agree_high:  # false of a bound that is NaN, as everywhere here
        return NOT_REPRODUCED
    if value is None:
        known = _range(*_rounded(unit, low, high), unit)
        only = f", only a bound ({known})" * (known != "–")
        return f"{UNDECIDABLE}: the log gives no value{only}"
    if not (bottom < agree_low or top > agree_high):
        return REPRODUCED
    outside = f"({_range(*_rounded(unit, low, high), unit)}) is partly outside the claim's range"
    return f"{UNDECIDABLE}: the 95 % interval {outside}"


def judge_logs(found, agree_low, agree_high):
    """Judge a claim in each of many simulated logs; most of them have to say the same.

    Parameters
    ----------
    found : ndarray, shape (n,) or (n, 3)
        What each log gave: a value, true or false, or a value with its 95 % interval. NaN where a
        log gives no value, or leaves a side of the interval open.
    agree_low, agree_high : float
        NaN where the claim is unbounded on that side.

    Returns
    -------
    verdict : str
        A log whose interval lies partly outside the range speaks neither for the claim nor against.
    value, low, high : float
        Median and middle 95 % of the values, logs without a value last, each if some log gives
        more; of true or false, the share of the logs in which it is true, without interval.
    """
    if len(found) < FEWEST_LOGS:
        raise WrongUsage(f"{len(found)} logs: a verdict takes at least {FEWEST_LOGS}")
    each = np.column_stack([found] * 3) if found.ndim == 1 else found
    missing = np.isnan(each[:, 0])
    low, high = np.nan_to_num(each[:, 1], nan=-np.inf), np.nan_to_num(each[:, 2], nan=np.inf)
    share = np.mean(~((low < agree_low) | (high > agree_high) | missing))
    against = np.mean((high < agree_low) | (low > agree_high))
    if share >= MOST:
        verdict = REPRODUCED
    elif against >= MOST:
        verdict = NOT_REPRODUCED
    else:
        verdict = f"{UNDECIDABLE}: a log of this length gives it in {100 * share:.3g} % of cases"
        left = 100 * (1 - share - against)
        verdict += f"; {left:.3g} % leave it open" if left > 0.01 else ""
    if found.dtype == bool:
        return verdict, (float(found.mean()), None, None)
    values = np.where(missing, np.inf, each[:, 0])
    method: Any = "nearest" if missing.any() else "linear"
    middle = np.quantile(values, [0.5, 0.025, 0.975], method=method)
    most = np.nanmax(each[:, 0], initial=-np.inf) if missing.any() else np.inf
    return verdict, tuple(v if v < most else None for v in middle)


class Ledger:
    """The verdicts of one notebook; each check is written down at once.

    In a notebook that is run by hand nothing is written: `table` shows the verdicts, and beside one
    that differs the one in ``figures/claims.csv``.

    Parameters
    ----------
    notebook : str
        Its file name without the suffix. What it said on an earlier run is struck out.
    when : str, optional
        The setting that the claims of the notebook share: every verdict reads "reproduced if ..."
        or "not reproduced if ...".
    """

    def __init__(self, notebook: str, when: str | None = None):
        self.notebook = notebook
        self.when = when
        self._published = published()
        own = self._published[self._published["notebook"] == notebook]
        self._mine: dict[str, dict] = {}
        self._not_judged = [
            self._entry(row, row["why"], (None,) * 3)
            for _, row in own[own["why"].str.startswith(NOT_JUDGED)].iterrows()
        ]

    def check(
        self,
        claim: str,
        value: Estimate | float | bool | None,
        low: float | None = None,
        high: float | None = None,
        *,
        when: str | None = None,
        undecided: str | None = None,
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
            The setting under which the verdict was reached, beside that of the notebook.
        undecided : str, optional
            Why the data at hand cannot tell; then `value` does not count.

        Returns
        -------
        str
            The verdict.
        """
        row = self._judged(claim)
        judged = _verdict(row, value if isinstance(value, Estimate) else (value, low, high))
        if undecided:
            return self._enter(row, (f"{UNDECIDABLE}: {undecided}", judged[1]))
        return self._enter(row, judged, self.when, when)

    def check_logs(self, claim: str, found: ArrayLike, *, when: str | None = None) -> str:
        """Judge one claim about something random by what came out in many simulated logs.

        It is reproduced if it comes out in at least 90 % of the logs, not reproduced if it fails in
        at least 90 %, and else undecidable; then the verdict gives the share.

        Parameters
        ----------
        claim : str
        found : array_like, shape (n,) or (n, 3)
            A value a log (a number, or whether the sentence holds), or value, low and high of a
            95 % interval; at least 200 logs.
        when : str, optional

        Returns
        -------
        str
            The verdict.
        """
        row = self._judged(claim)
        return self._enter(row, _verdict(row, np.asarray(found)), self.when, when)

    def check_both(self, claim: str, paper: pd.DataFrame, car: pd.DataFrame, *when: str) -> str:
        """Judge one claim twice: as the paper most likely did, and as a car does.

        What both give is the verdict. If they differ it has a condition: the paper's where that is
        decided, else the car's. Where another R gives the opposite, R_0 is a condition, too.

        Parameters
        ----------
        claim : str
        paper, car : pandas.DataFrame
            Columns ``value``, ``low``, ``high`` at several R; the index is R over R_0. The verdict
            is that at 1, and where it turns is said.
        *when : str
            What the one and what the other hangs on, beside these; or nothing.

        Returns
        -------
        str
            The verdict.
        """
        row, said, ends = self._judged(claim), [], []
        for found in (paper, car):
            each = {at: _verdict(row, of) for at, *of in found.itertuples()}
            said.append({times: verdict for times, (verdict, _) in each.items()})
            ends.append(each[1][1])
        verdict, other = (of[1].partition(":")[0] for of in said)
        ways = [_with_turns(of) for of in said]
        turns = ["; ".join(w for w in way.split("; ")[1:] if w[:4] != "open") for way in ways]
        if verdict == other:
            verdict, way = said[0][1], when
            turn = turns[0] or (turns[1] and f"in a car {turns[1]}")
        elif verdict in (REPRODUCED, NOT_REPRODUCED):
            way, turn = (ON_ATTITUDE, *when[:1]), turns[0]
        else:
            verdict, way, turn = other, (INTEGRATED, *when[1:]), turns[1]
        conditions = (*dict.fromkeys(way), turn and f"R is R₀ ({turn})")
        together = ", ".join(filter(None, conditions))
        both = dict(zip(TWICE, (*ways, *_rounded(row["unit"], *ends[1])), strict=True))
        return self._enter(row, (verdict, ends[0]), self.when, together, both=both)

    def table(self, elsewhere: str | None = None, *, main: bool = False) -> text.Shown:
        """Lay published and reproduced side by side, for the notebook's last section.

        Only what was decided has a row; the rest is in the register, and the last line counts it. A
        condition that all verdicts share stands in the last line, once.

        Parameters
        ----------
        elsewhere : str, optional
            Beginning, as a regular expression, of claims that the notebook shows in another place.
        main : bool
            Only those on which a paper's abstract and conclusions rest.

        Returns
        -------
        text.Shown
        """
        if not self._mine:
            self._write()
        rows, written, skipped = [], verdicts()["verdict"], 0
        for mine in self._mine.values():
            theirs, cited = self._published.loc[mine["id"]], written[mine["id"]]
            other_place = elsewhere and re.match(elsewhere, theirs["claim"])
            if other_place or (main and theirs["main"] != "yes"):
                skipped += 1
                continue
            other = "" if cited == mine["verdict"] else f" (figures/claims.csv: {cited})"
            if mine["verdict"].startswith(NOT_TESTABLE) and not other:
                continue
            verdict = mine["verdict"]
            if self.when:
                verdict = verdict.replace(f" if {self.when}, ", " if ", 1)
                verdict = verdict.removesuffix(f" if {self.when}").removesuffix(",")
            row = {k: theirs[k] for k in ("where", "claim")} | {"published": _published(theirs)}
            row["counts as agreement"] = _agreement(theirs)
            if mine["as_a_car_does"]:
                for way, of in zip(WAYS, (mine, _in_a_car(mine)), strict=True):
                    row[way.replace("_", " ")] = f"{_in_words(of)}: {mine[way]}"
                row["as a car does"] += other
            else:
                row["our value"] = _number(mine["value"], theirs["unit"]) or "–"
                row["95 % interval"] = _range(mine["low"], mine["high"], theirs["unit"])
                row["verdict"] = verdict + other
            rows.append(row)
        under = f"All verdicts hold if {self.when}. " * bool(self.when and rows)
        apart = len(self._entries()) - len(rows) - skipped
        left = f"Not shown, for they cannot be tested or hold by construction: {apart} of"
        left += f" {len(self._entries())} claims (figures/claims.csv)."
        shown = text.table(pd.DataFrame(rows)) if rows else ""
        return text.Shown(f"{shown}\n\n{under}{left * bool(apart)}".strip())

    def errata(self) -> text.Shown:
        """Lay out the errata of the notebook that change a result; the others are counted."""
        register = pd.read_csv(DATA / "published" / "errata.csv")
        mine = register[register["notebook"] == self.notebook]
        rows = mine[mine["changes"] == "a result"]
        left = f"{len(mine) - len(rows)} of {len(mine)} errata change only a number or the text"
        link = "[data/published/errata.csv](../data/published/errata.csv)"
        table = text.table(rows[["where", "printed", "should_be", "evidence"]]) if len(rows) else ""
        return text.Shown(f"{table}\n\n{left}: {link}.".strip())

    def _judged(self, claim):
        if claim not in self._published.index:
            raise WrongUsage(f"no claim '{claim}' in data/published/claims.csv")
        row = self._published.loc[claim]
        if row["why"].startswith(NOT_JUDGED):
            raise WrongUsage(f"claim '{claim}' is not judged: its row says {row['why']}")
        return row

    def _enter(self, row, judged, *when, both=None):
        verdict, ends = judged
        conditions = ", ".join(filter(None, when))
        if conditions:
            verdict += f"{',' * verdict.startswith(UNDECIDABLE)} if {conditions}"
        self._mine[row.name] = self._entry(row, verdict, ends) | (both or {})
        self._write()
        return verdict

    def _entry(self, row, verdict, ends):
        entry = (row.name, verdict, *_rounded(row["unit"], *ends), row["unit"], self.notebook)
        return dict.fromkeys(COLUMNS) | dict(zip(ONCE, entry, strict=True))

    def _entries(self):
        return [*self._mine.values(), *self._not_judged]

    def _write(self):
        def as_published(table):
            there = self._published.index.intersection(table["id"])
            return table.set_index("id").reindex(there).reset_index()

        _write_down("claims", self.notebook, self._entries(), COLUMNS, as_published)


def _verdict(row, found):
    """Judge an Estimate, a (value, low, high) or the logs of an array; also give its numbers."""
    if isinstance(found, np.ndarray):
        logs = found.astype(bool if row["unit"] == YES_OR_NO else float)
        return judge_logs(logs, row["low"], row["high"])
    is_estimate = isinstance(found, Estimate)
    ends = (found.value, found.low, found.high) if is_estimate else found
    ends = [None if x is None or x != x else float(x) for x in ends]
    exact = not is_estimate and ends[1:] == [None, None]  # an Estimate is then open on both sides
    return judge(*(ends[:1] * 3 if exact else ends), *row[["low", "high", "unit"]]), ends


def _rounded(unit, *ends):
    """Round to three digits: what such an interval means, and any machine prints; counts stay."""
    exact = unit == "count" and ends[1:] == (None, None)
    return [None if x is None else float(f"{x:.{9 if exact else 3}g}") for x in ends]


def _in_a_car(row):
    """Give a verdict's row with the numbers that a car gives."""
    return {**row, **{k: row[f"car_{k}"] for k in ("value", "low", "high")}}


def _with_turns(said):
    """Write the verdict at R_0, and at which of the R it is another one.

    Parameters
    ----------
    said : dict of float to str
        Verdict by R over R_0, which is among them.
    """
    plain = {at: "open" if UNDECIDABLE in of else of for at, of in sorted(said.items())}
    words = [plain[1]]
    for kind in (k for k in (REPRODUCED, NOT_REPRODUCED, "open") if k != words[0]):
        at = [times for times, verdict in plain.items() if verdict == kind]
        if len(at) == len(plain) - 1:
            words.append(f"{kind} at every other R")
        elif at and at[0] > 1 and at == [times for times in plain if times >= at[0]]:
            words.append(f"{kind} from {at[0]:g} R₀")
        elif at and at[-1] < 1 and at == [times for times in plain if times <= at[-1]]:
            words.append(f"{kind} up to {at[-1]:g} R₀")
        elif at:
            words.append(f"{kind} at {', '.join(f'{times:g}' for times in at)} R₀")
    return "; ".join(words)


def _in_words(row):
    """Write value and interval of a verdict with its unit."""
    if row["verdict"] == NOT_YET:
        return "–"
    value, around = _number(row["value"], row["unit"]), _range(row["low"], row["high"], row["unit"])
    if not value or around in ("–", value):
        return value or around
    return f"{value} ({around.removeprefix('between ').replace(' and ', ' to ')})"


def _agreement(row):
    """Write the range of values that count as agreement; sizes and ratios begin at 0 anyway."""
    low = math.nan if row["low"] == 0 and row["high"] > 0 else row["low"]
    return _range(low, row["high"], row["unit"])


def _published(row):
    """Write the published number; that of an inequality is its bound."""
    value, agrees = _number(row["value"], row["unit"]), _agreement(row)
    return agrees if agrees in (f"at least {value}", f"at most {value}") else value


def _number(value, unit):
    """Write a value in its unit, or yes or no where the claim asks for that."""
    if value is None or value != value:
        return ""
    if unit == YES_OR_NO:
        return {0: "no", 1: "yes"}.get(value, f"in {100 * value:.3g} % of logs")
    if math.isinf(value):
        return "infinite"
    before, times, after = WRITTEN.get(unit, ("", 1, f" {pretty(unit)}"))
    return f"{before}{engineering(times * value, 5)}{after}".rstrip()


def _range(low, high, unit):
    """Write an interval, or the range of a claim, in words."""
    low, high = _number(low, unit), _number(high, unit)
    if not (low and high):
        return f"at least {low}" if low else f"at most {high}" if high else "–"
    if low == high:
        return low
    before, _, after = WRITTEN.get(unit, ("", 1, f" {pretty(unit)}"))
    return f"between {low.removesuffix(after)} and {high.removeprefix(before)}"
