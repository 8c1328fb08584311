"""The ledger of claims: how a verdict is reached, and what is kept from notebook to notebook."""

import math
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from refused import refused

from analysis import FIGURES, Estimate, WrongUsage, claims
from analysis.claims import NOT_REPRODUCED, NOT_TESTABLE, NOT_YET, REPRODUCED, UNDECIDABLE, judge

OPEN = math.nan  # a side on which the claim is unbounded
JUDGED = claims.published()[lambda rows: ~rows["why"].str.startswith(claims.NOT_JUDGED)]
FIRST, SECOND, THIRD = JUDGED.index[JUDGED["unit"] == "deg"][:3]
SAID = ((True, "yes"), (False, "no"), (None, "–"))
YES_OR_NO = JUDGED.index[JUDGED["quantity"].str.startswith("1 if")][0]
PUBLISHED = JUDGED.loc[FIRST]
OF_LOGS = "undecidable: a log of this length gives it in"


def in_table(ledger):
    """Rows of the table that a notebook shows."""
    lines = [line for line in ledger.table().splitlines() if line.startswith("| ")]
    head, *rows = ([cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines)
    return [dict(zip(head, row, strict=True)) for row in rows]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Keep the ledger of these tests in a folder of their own."""
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(tmp_path / "figures"))
    return tmp_path / "figures" / "claims.csv"


@pytest.mark.parametrize(("found", "agree", "verdict"), [
    # value within, and its interval too
    ((1.5, 1.5, 1.5), (1, 2), REPRODUCED), ((1.5, 1.2, 1.8), (1, 2), REPRODUCED),
    ((1.0, 1.0, 1.0), (1, 2), REPRODUCED), ((0.0, 0.0, 0.0), (-1, 0), REPRODUCED),
    # value outside: the interval decides
    ((3.0, 3.0, 3.0), (1, 2), NOT_REPRODUCED), ((3.0, 2.5, 3.5), (1, 2), NOT_REPRODUCED),
    ((3.0, 1.9, 3.5), (1, 2), UNDECIDABLE),
    # an interval open on one side reaches everywhere on that side, and stops on the other
    ((3.0, None, 3.5), (1, 2), UNDECIDABLE), ((3.0, 2.5, None), (1, 2), NOT_REPRODUCED),
    # no value: the bound alone may still exclude the claim, never confirm it
    ((None, None, None), (1, 2), UNDECIDABLE), ((None, 2.5, None), (1, 2), NOT_REPRODUCED),
    ((None, 1.2, None), (1, 2), UNDECIDABLE), ((None, 1.2, 1.8), (1, 2), UNDECIDABLE),
    # a claim with one side only
    ((-9.0, -9.0, -9.0), (OPEN, 2), REPRODUCED), ((3.0, 3.0, 3.0), (OPEN, 2), NOT_REPRODUCED),
    ((None, 5.0, None), (OPEN, 2), NOT_REPRODUCED), ((None, 5.0, None), (1, OPEN), UNDECIDABLE),
    # a sentence that is true or not
    ((1.0, 1.0, 1.0), (1, 1), REPRODUCED), ((0.0, 0.0, 0.0), (1, 1), NOT_REPRODUCED),
])  # fmt: skip
def test_judge(found, agree, verdict):
    """Property: the truth table of a value with its interval against the range that agrees.

    With every sign turned, which swaps low and high, it is the same; the reason names the interval.
    """
    value, low, high = (None if x is None else -x for x in found)
    for said in (judge(*found, *agree), judge(value, high, low, -agree[1], -agree[0])):
        assert said.split(": ")[0] == verdict and (": " in said) == (verdict == UNDECIDABLE)
    assert "no value, only a bound (at least 1.2 s)" in judge(None, 1.2, None, 1, 2, "s")
    assert judge(None, None, None, 1, 2) == f"{UNDECIDABLE}: the log gives no value"
    assert "(between 1.9 and 3.5 s)" in judge(3.0, 1.9, 3.5, 1, 2, "s")


def test_a_quantile_that_no_log_exceeds_is_none():
    """property: of 200 logs of which few give a value, the largest is no lower end of the rest."""
    found = np.full(200, np.nan)
    found[:6] = 2.45, 2.75, 2.85, 2.97, 3.01, 3.05
    assert claims.judge_logs(found, 2.8, 4.6)[1] == (None, None, None)
    found[:120] = np.linspace(1.0, 2.0, 120)
    value, low, high = claims.judge_logs(found, 2.8, 4.6)[1]
    assert 1.0 < low < value < 2.0 and high is None


def test_a_missing_value_or_bound_is_none(elsewhere):
    """Property: NaN and None are unresolved, never a number on disk; an infinite bound is open."""
    far, ledger = PUBLISHED["high"] * 100, claims.Ledger("90-test")
    for nothing in (None, math.nan):
        assert ledger.check(FIRST, nothing).startswith(UNDECIDABLE)
        assert pd.read_csv(elsewhere).loc[0, ["value", "low", "high"]].isna().all()
    assert ledger.check(FIRST, far, math.nan, math.nan) == NOT_REPRODUCED
    assert ledger.check(FIRST, far, -math.inf, far).startswith(UNDECIDABLE)
    inside = PUBLISHED["value"]  # known exactly, or to no bound
    assert ledger.check(FIRST, inside) == REPRODUCED
    assert ledger.check(FIRST, Estimate(inside, None, None)).startswith(UNDECIDABLE)


def test_conditions_stand_on_successes_and_failures():
    """Property: what the notebook's claims share comes first; what is open has no condition."""
    ledger = claims.Ledger("90-test", when="it rains")
    inside, outside = PUBLISHED["value"], PUBLISHED["high"] * 100
    assert ledger.check(FIRST, inside) == "reproduced if it rains"
    assert ledger.check(FIRST, outside, when="it blows") == "not reproduced if it rains, it blows"
    assert ledger.check(FIRST, None, inside, outside).startswith(f"{UNDECIDABLE}: ")
    assert claims.Ledger("90-test").check(FIRST, outside, when="dry") == "not reproduced if dry"


@pytest.mark.parametrize(("inside", "outside", "verdict"), [
    (180, 20, REPRODUCED), (179, 21, f"{OF_LOGS} 89.5 % of cases"),
    (21, 179, f"{OF_LOGS} 10.5 % of cases"), (20, 180, NOT_REPRODUCED), (180, 0, REPRODUCED),
    (0, 179, f"{OF_LOGS} 0 % of cases; 10.5 % leave it open"), (0, 180, NOT_REPRODUCED),
])  # fmt: skip
def test_most_logs_decide(inside, outside, verdict):
    """Property: nine logs of ten, for or against; an interval partly outside is neither."""
    low, high = PUBLISHED[["low", "high"]].astype(float)
    logs = np.full((200, 3), [low, low / 2, high])
    logs[:inside] = (low + high) / 2, low, high
    logs[200 - outside :] = 3 * high, 2 * high, np.nan
    assert claims.Ledger("90-test").check_logs(FIRST, logs) == verdict


def test_logs_of_true_and_false_give_their_share(elsewhere):
    """Property: with two outcomes the share of true logs is the value, and the words say so."""
    ledger, logs = claims.Ledger("90-test"), np.arange(400) < 100
    assert ledger.check_logs(YES_OR_NO, ~logs).endswith("gives it in 75 % of cases")
    assert in_table(ledger)[0]["our value"] == "in 75 % of logs"
    assert pd.read_csv(elsewhere)["value"].item() == 0.75


def test_logs_without_a_value_rank_last(elsewhere):
    """Property: the median is of all logs, not of those that happen to give a value."""
    logs = np.where(np.arange(300) < 200, np.arange(300.0), np.nan)
    claims.Ledger("90-test").check_logs(FIRST, logs)
    row = pd.read_csv(elsewhere).loc[0]
    assert row["value"] == pytest.approx(149.5, rel=0.01) and math.isnan(row["high"])


def test_a_second_run_strikes_out_the_first_and_keeps_other_notebooks(elsewhere):
    """Property: a notebook's own rows go, those of others stay, in the order of the papers."""
    value = claims.published()["value"]
    claims.Ledger("10-other").check(SECOND, value[SECOND])
    first = claims.Ledger("90-test")
    first.check(THIRD, value[THIRD])
    first.check(FIRST, value[FIRST])
    assert list(pd.read_csv(elsewhere)["id"]) == [FIRST, SECOND, THIRD]
    claims.Ledger("90-test").check(THIRD, value[THIRD])
    table = pd.read_csv(elsewhere)
    assert list(table.columns) == claims.COLUMNS
    assert table.set_index("id")["notebook"].to_dict() == {SECOND: "10-other", THIRD: "90-test"}
    assert {p.name for p in elsewhere.parent.iterdir()} == {"claims.csv", "claims.lock"}


def test_notebooks_that_run_at_once_lose_no_row(elsewhere):
    """Property: ledgers that write at the same time, from processes of their own, keep all rows."""
    ids = list(JUDGED.index[:60])
    code = "import sys; from analysis import claims; ledger = claims.Ledger(sys.argv[1])\n"
    code += "for claim in sys.argv[2:]: ledger.check(claim, 1.0)"
    halves = {"10-one": ids[::2], "20-other": ids[1::2]}
    running = [subprocess.Popen([sys.executable, "-c", code, n, *h]) for n, h in halves.items()]
    assert [one.wait() for one in running] == [0, 0]
    table = pd.read_csv(elsewhere).set_index("id")
    assert list(table.index) == ids
    assert all(set(table["notebook"][half]) == {name} for name, half in halves.items())


def test_the_same_checks_write_the_same_bytes(elsewhere):
    """Property: neither the order of the checks nor reading back what others wrote matters."""
    value, written = claims.published()["value"], []
    for order in ((FIRST, SECOND), (SECOND, FIRST)):
        for notebook in ("10-other", "90-test"):
            ledger = claims.Ledger(notebook)
            for claim in order if notebook == "90-test" else [THIRD]:
                ledger.check(claim, value[claim], 0.1 * value[claim] + 1 / 3, None)
        written.append(elsewhere.read_bytes())
    assert written[0] == written[1] and b"\r" not in written[0]


def test_unknown_claims_and_few_logs_are_wrong_usage(elsewhere):
    """Property: a misspelt id or fewer than 200 logs are refused, and nothing is written."""
    with pytest.raises(WrongUsage, match=r"no claim 'no-such-claim' in data/published/claims"):
        claims.Ledger("90-test").check("no-such-claim", 1.0)
    refused(WrongUsage, "199 logs", claims.Ledger("90-test").check_logs, FIRST, np.ones(199))
    assert not elsewhere.exists()


@pytest.mark.parametrize(("paper", "car", "verdict", "said"), [
    ("+++", "+++", REPRODUCED, (REPRODUCED, REPRODUCED)),
    ("---", "---", NOT_REPRODUCED, (NOT_REPRODUCED, NOT_REPRODUCED)),
    ("+++", "---", f"reproduced if {claims.ON_ATTITUDE}", (REPRODUCED, NOT_REPRODUCED)),
    ("?--", "?++", UNDECIDABLE,
     ("open; not reproduced at every other R", "open; reproduced at every other R")),
    ("+--", "+++", "reproduced if R is R₀ (not reproduced at every other R)",
     ("reproduced; not reproduced at every other R", REPRODUCED)),
    ("---", "-++", "not reproduced if R is R₀ (in a car reproduced at every other R)",
     (NOT_REPRODUCED, "not reproduced; reproduced at every other R")),
    ("+?-", "-++",
     f"reproduced if {claims.ON_ATTITUDE}, R is R₀ (not reproduced from 10 R₀)",
     ("reproduced; not reproduced from 10 R₀; open at 3 R₀",
      "not reproduced; reproduced at every other R")),
    ("+?-", "+++", "reproduced if every sensor errs, R is R₀ (not reproduced from 10 R₀)",
     ("reproduced; not reproduced from 10 R₀; open at 3 R₀", REPRODUCED)),
    ("+??", "+++", "reproduced if every sensor errs",
     ("reproduced; open at every other R", REPRODUCED)),
    ("?+?", "+-+",
     f"reproduced if {claims.INTEGRATED}, R is R₀ (not reproduced at 3 R₀)",
     ("open; reproduced at 3 R₀", "reproduced; not reproduced at 3 R₀"))])  # fmt: skip
def test_a_claim_judged_twice_says_where_it_turns(elsewhere, paper, car, verdict, said):
    """Property: what both give, or what one gives, with its condition; R is 1, 3, 10 times R_0."""
    low, high = PUBLISHED[["low", "high"]].astype(float)
    of = {"+": [(low + high) / 2] * 3, "-": [3 * high] * 3, "?": [high, low, 2 * high]}
    names = [1, 3, 10], ["value", "low", "high"]
    paper, car = (pd.DataFrame([of[k] for k in way], *names) for way in (paper, car))
    ledger = claims.Ledger("90-test")
    when = "every sensor errs" * ("sensor" in verdict)
    assert ledger.check_both(FIRST, paper, car, when, when).partition(":")[0] == verdict
    row = pd.read_csv(elsewhere).loc[0]
    assert (row["as_the_paper_did"], row["as_a_car_does"]) == said
    values = [paper["value"][1], car["value"][1]]
    assert row[["value", "car_value"]].tolist() == pytest.approx(values, rel=5e-3)
    assert in_table(ledger)[0]["as a car does"].endswith(said[1])


def test_what_is_not_judged_stands_in_the_register(elsewhere):
    """Property: a notebook lists its own such claims after what it judged; the checks take none."""
    register = claims.published()
    apart = register[register["why"].str.startswith(claims.NOT_JUDGED)]
    name = apart["notebook"].iloc[0]
    mine, ledger = apart[apart["notebook"] == name], claims.Ledger(name)
    ledger.check(FIRST, PUBLISHED["value"])
    assert [row["verdict"] for row in in_table(ledger)] == [REPRODUCED]
    counted = f"by construction: {len(mine)} of {len(mine) + 1} claims (figures/claims.csv)."
    assert ledger.table().endswith(counted)
    written = pd.read_csv(elsewhere).set_index("id")["verdict"]
    assert written.to_dict() == {FIRST: REPRODUCED, **mine["why"]}
    for check, found in ((ledger.check, 1.0), (ledger.check_logs, np.ones(200))):
        refused(WrongUsage, "is not judged", check, apart.index[0], found)


def test_verdicts_fill_in_what_is_to_come():
    """Property: every published claim has a verdict, in order; without a run it is not yet run."""
    assert (claims.verdicts()["verdict"] == NOT_YET).all()
    claims.Ledger("90-test").check(SECOND, claims.published().loc[SECOND, "value"])
    table = claims.verdicts()
    assert list(table.index) == list(claims.published().index)
    assert table["verdict"].value_counts().to_dict() == {REPRODUCED: 1, NOT_YET: len(table) - 1}
    assert table.loc[SECOND, "notebook"] == "90-test"
    assert table["outcome"].tolist() == table["verdict"].tolist()


def test_table_lays_published_beside_reproduced():
    """Property: the notebook's last table has a row a check, with numbers and verdict."""
    ledger = claims.Ledger("90-test")
    verdict = ledger.check(FIRST, 12.3456, 12.0, None)
    (row,) = in_table(ledger)
    assert (row["our value"], row["95 % interval"]) == ("12.3 °", "at least 12 °")
    assert (row["published"], PUBLISHED["unit"]) == (f"{PUBLISHED['value']:g} °", "deg")
    assert row["verdict"] == verdict and ledger.table(elsewhere=PUBLISHED["claim"][:20]) == ""
    assert bool(ledger.table(main=True)) == (PUBLISHED["main"] == "yes")
    assert claims.verdicts().loc[FIRST, "reproduced"] == "12.3 ° (at least 12 °)"


def test_a_notebook_run_by_hand_writes_no_verdict(monkeypatch):
    """Property: figures/claims.csv stays as it is, and a verdict that differs stands beside it."""
    monkeypatch.delenv("COMPENDIUM_FIGURES")
    path = FIGURES / "claims.csv"
    before, cited = path.read_bytes(), claims.verdicts()["verdict"]
    ledger = claims.Ledger("90-test")
    mine = ledger.check(FIRST, PUBLISHED["high"] + 1)
    assert in_table(ledger)[0]["verdict"] == f"{mine} (figures/claims.csv: {cited[FIRST]})"
    assert path.read_bytes() == before and claims.verdicts()["verdict"].equals(cited)


def claim_of(**of):
    """Id of the first judged claim with such columns."""
    return JUDGED.index[(JUDGED[list(of)] == pd.Series(of)).all(axis=1)][0]


@pytest.mark.parametrize(("claim", "found", "published", "agrees", "reproduced"), [
    (claim_of(unit="times", low=1.0, high=2.0), (1.5, 1.25, 1.75), "× 1", "between × 1 and 2",
     "× 1.5 (× 1.25 to 1.75)"),
    (claim_of(unit="times", low=0.0, high=1.0), (0.5,), "at most × 1", "at most × 1", "× 0.5"),
    (claim_of(unit="share", value=1.0, low=0.95), (0.983, 0.962, 0.995), "100 %",
     "between 95 and 100 %", "98.3 % (96.2 to 99.5 %)"),
    (claim_of(unit="share", low=0.0, high=0.1), (0.5, 0.5, 0.5), "6 %", "at most 10 %", "50 %"),
    *((YES_OR_NO, (said,), "yes", "yes", words) for said, words in SAID),
    (claim_of(unit="count", value=2493.0), (2319.0,), "2493", "2493", "2319"),
    (claim_of(unit="s", value=803.0), (None, 287.0, None), "803 s", "between 401.5 and 1204.5 s",
     "at least 287 s")])  # fmt: skip
def test_numbers_are_written_in_words(claim, found, published, agrees, reproduced):
    """Property: one way to write each unit; an interval without width, or open, is not two ends."""
    claims.Ledger("90-test").check(claim, *found)
    row = claims.verdicts().loc[claim]
    assert (row["published"], claims._agreement(JUDGED.loc[claim])) == (published, agrees)
    assert row["reproduced"] == reproduced


def test_no_number_of_the_verdicts_is_left_raw(monkeypatch):
    """Property: over all committed verdicts, no exponent and no interval of two equal ends."""
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(FIGURES))
    for words in claims.verdicts()[["published", "reproduced"]].to_numpy().ravel():
        assert not re.search(r"\de[+-]\d|nan|inf\b|\(([-\d.]+) to \1\)", words), words


def test_findings_are_one_for_each_notebook(elsewhere):
    """Property: in reading order, the last call counts; the verdicts beside them stay."""
    found, shown = elsewhere.with_name("findings.csv"), []
    claims.Ledger("90-test").check(FIRST, 1.0)
    before = elsewhere.read_bytes()
    for name, text_ in (("90-test", "Old."), ("10-other", 'A,\n"b".'), ("90-test", "New.")):
        shown.append(claims.finding(name, text_, when="Here.", figure="10-a", so="Do."))
    kept = {"10-other": 'A, "b".', "90-test": "New."}
    rows = [[name, said, "Here.", "10-a", "Do."] for name, said in kept.items()]
    assert claims.findings().to_numpy().tolist() == rows
    assert "**2. Do.**<br>New.<br>Here. [90-test]" in claims.learned(to_do=True)
    assert shown[-1] == "**Finding.** New. *Here.*" and elsewhere.read_bytes() == before
    with pytest.raises(WrongUsage, match="the finding of 90-test has 31 words: at most 30"):
        claims.finding("90-test", "word " * 31, when="Here.", figure="10-a")
    with pytest.raises(WrongUsage, match="the condition of 90-test has 66 words: at most 65"):
        claims.finding("90-test", "New.", when="word " * 66, figure="10-a")
    assert claims.findings()["sentence"].iloc[-1] == "New."
    assert found.read_bytes().startswith(b"notebook,sentence,condition,figure,so\n10-other,")


def test_the_index_lists_the_main_claims(monkeypatch):
    """Property: twelve of each paper, each in a row with its verdict."""
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(FIGURES))
    rows, main = claims.verdicts(), claims.published()["main"] == "yes"
    for paper, own in rows[main].groupby("paper"):
        lines = claims.of_paper(paper).splitlines()[2:]
        assert [line.split(" | ")[0].strip("| ") for line in lines] == list(own["claim"])
        said = zip(own["verdict"], lines, strict=True)
        assert len(own) == 12 and all(f"| {verdict} |" in line for verdict, line in said)


def test_a_computation_counts_once(monkeypatch):
    """Property: a claim that another one's computation decides is none of its own, nor history."""
    history = f"not testable: a sentence {claims.THAT_DAY}"
    same, why = ["", "", "b", "a", ""], ["", "", "", "", history]
    register = pd.DataFrame({"same_as": same, "why": why}, index=[*"abcde"]).replace("", pd.NA)
    register = register.assign(paper="a", where="", claim=[*"stuvw"], value=1.0, unit="count")
    register = register.assign(low=None, high=None, why=register["why"].fillna(""))
    found = [REPRODUCED, NOT_REPRODUCED, NOT_REPRODUCED, REPRODUCED, f"{NOT_TESTABLE}: x"]
    found = pd.DataFrame({"verdict": found}).reindex(columns=claims.COLUMNS)
    monkeypatch.setattr(claims, "published", lambda: register)
    path = claims._register("claims")
    path.parent.mkdir(parents=True)
    found.assign(id=register.index).to_csv(path, index=False)
    counts = claims.counts().sum()
    assert counts[counts > 0].to_dict() == {REPRODUCED: 1, NOT_REPRODUCED: 1}
    claimed, total, agree, _, differ, _, *others = map(int, re.findall(r"\d+", claims.counted()))
    assert (claimed, total) == (5, agree + differ + sum(others)) == (5, 2)


def test_errata_are_those_of_the_notebook():
    """Property: each erratum is in the notebook of its row: in a line, or counted in the last."""
    for name, rows in pd.read_csv(claims.DATA / "published" / "errata.csv").groupby("notebook"):
        told = claims.Ledger(name).errata()
        lines = max(sum(line.startswith("| ") for line in told.splitlines()) - 1, 0)
        counted = int(re.search(r"^(\d+) of \d+ errata", told, re.M)[1])
        assert (lines, lines + counted) == ((rows["changes"] == "a result").sum(), len(rows))
    assert claims.Ledger("90-test").errata().startswith("0 of 0 errata")
