"""Published: the numbers copied from the papers are complete, consistent and well formed."""

import math
import re

import nbformat
import numpy as np
import pandas as pd
import pytest

from analysis import DATA, ROOT

PUBLISHED = DATA / "published"
# The last four have none: a ratio, a fraction of one (shown in %), a count, a sentence.
UNITS = "1, %, deg, deg/s, deg/h, deg/sqrt(s), s, min, h, Hz, m, m/s^2, km/h, W, m^2*USD^0.586"
UNITS = {*UNITS.split(", "), "times", "share", "count", "yes or no"}
FILLED = ("where", "claim", "quantity", "value", "unit", "why")
# Every figure and table of the papers, counted by hand.
TABLES = ["Table 1", "Table 2", "Table 3"]
ITEMS = {"terrain": (13, TABLES), "comparison": (38, ["Table I"]), "tracker": (6, ["Table I"])}


def text_table(name):
    """Read a register with every cell as text."""
    return pd.read_csv(PUBLISHED / name, dtype=str, keep_default_na=False)


def number_table(name):
    """Read a copied table, whose first line is a comment."""
    return pd.read_csv(PUBLISHED / name, comment="#")


CLAIMS = text_table("claims.csv").set_index("id", drop=False)
COVERAGE = text_table("coverage.csv")
ERRATA = text_table("errata.csv")


def claimed(claim):
    """Return the published number of a claim."""
    return float(CLAIMS.loc[claim, "value"])


REGISTERS = {"coverage": (COVERAGE, "paper,item,notebook,figures,reason")}
REGISTERS["errata"] = ERRATA, "id,paper,where,printed,should_be,evidence,notebook,changes"
OF_CLAIMS = "id,paper,where,claim,quantity,value,unit,low,high,why,notebook,main,same_as"
REGISTERS["claims"] = CLAIMS, OF_CLAIMS


@pytest.mark.parametrize("name", REGISTERS)
def test_register(name):
    """Property: the contract's columns, every paper; ids are unique, kebab-case, of their paper.

    One line a cell, ASCII only, so that every tool reads the registers alike.
    """
    table, header = REGISTERS[name]
    assert ",".join(table.columns) == header and set(table["paper"]) == set(ITEMS)
    for cell in table.to_numpy().ravel():
        assert cell.isascii() and "\n" not in cell, cell
    if "id" in table:
        assert table["id"].is_unique
        for claim, paper in zip(table["id"], table["paper"], strict=True):
            assert re.fullmatch(rf"{paper}(-[a-z0-9]+)+", claim), claim


def claim_faults(row):
    """List, in a sentence each, what is wrong with a row of claims.csv."""
    value, low = float(row["value"]), float(row["low"] or "-inf")
    high, untestable = float(row["high"] or "inf"), row["why"].startswith("not testable: ")
    needs = r"needs the paper's own (logs|code)|the maker's data sheet is not at hand"
    needs += r"|no real log here has"
    yes = (row["value"], row["low"], row["high"], row["unit"]) == ("1", "1", "1", "yes or no")
    rules = {
        "where, claim, quantity, value, unit and why are filled in, without blanks around":
            all(row[c].strip() == row[c] != "" for c in FILLED),
        f"the unit is one of {', '.join(sorted(UNITS))}": row["unit"] in UNITS,
        "the published value lies between low and high": low <= value <= high,
        "low or high is given: else any number would agree":
            untestable or math.isfinite(low) or math.isfinite(high),
        "a quantity '1 if ...' has value, low and high 1 and the unit 'yes or no'":
            row["quantity"].startswith("1 if ") == (row["unit"] == "yes or no") == yes,
        "what is 'not testable: ' says what it needs":
            bool(re.search(needs, row["why"])) == untestable}  # fmt: skip
    return [rule for rule, kept in rules.items() if not kept]


@pytest.mark.parametrize("row", CLAIMS.to_dict("records"), ids=lambda row: row["id"])
def test_claim(row):
    """Property: a claim says what, where, how much and why, and its value lies in its range."""
    assert claim_faults(row) == []


def test_what_is_by_construction_says_of_which_kind():
    """Property: one of three kinds, and then the inputs or numbers; no main claim is of them."""
    apart = CLAIMS[CLAIMS["why"].str.startswith("by construction")]
    kinds = r"by construction: (input handed back|identity|print against print): \S"
    assert apart["why"].str.match(kinds).all() and "yes" not in set(apart["main"])


def test_what_one_computation_decides_has_one_number():
    """cross-check: it names a claim of its paper that counts; outside the terrain paper, whose
    claims may be a ratio and the ratio less one, both have the same computed number.
    """
    same = CLAIMS["same_as"][CLAIMS["same_as"] != ""]
    first = CLAIMS.loc[same]
    assert set(first["same_as"]) == {""}
    assert first["paper"].tolist() == CLAIMS.loc[same.index, "paper"].tolist()
    value = pd.read_csv(ROOT / "figures" / "claims.csv").set_index("id")["value"]
    ours, theirs = value[same.index].to_numpy(), value[same].to_numpy()
    known = ~same.index.str.startswith("terrain-") & np.isfinite(ours)
    assert known.sum() >= 22 and (ours == theirs)[known].all()


@pytest.fixture(scope="module")
def verdicts():
    """Read the committed ledger."""
    return pd.read_csv(ROOT / "figures" / "claims.csv").set_index("id")


def test_verdicts_come_from_the_notebook_of_the_register(verdicts):
    """Property: where the register names a claim's notebook, its verdict is from there."""
    named = CLAIMS["notebook"][CLAIMS["notebook"] != ""]
    both = named.index.intersection(verdicts.index)
    assert len(both) > 200 and named[both].to_dict() == verdicts["notebook"][both].to_dict()


def test_what_is_judged_could_have_failed(verdicts):
    """Property: a claim that notebooks 10 to 14 judge says what would have made it fail."""
    judged = verdicts.index[verdicts["notebook"].str.match("1[0-4]-")]
    why = CLAIMS["why"][CLAIMS["notebook"].str.match("1[0-4]-") | CLAIMS.index.isin(judged)]
    why = why[~why.str.startswith(("by construction: ", "not testable: "))]
    assert len(why) >= 36 and why.index[~why.str.contains("; fails if ")].tolist() == []


def test_a_verdict_named_in_markdown_is_one_of_its_notebook(verdicts):
    """Property: no notebook says "not reproduced" where its ledger says so of no claim."""
    given = verdicts[["verdict", "as_the_paper_did", "as_a_car_does"]].fillna("").sum(axis=1)
    given = given.groupby(verdicts["notebook"]).sum()
    kinds = re.compile("not reproduced|reproduced|undecidable|not testable|by construction")
    named = 0
    for path in sorted((ROOT / "notebooks").glob("[1-9]*.ipynb")):
        cells = nbformat.read(path, 4)["cells"]
        text = "\n".join(c["source"] for c in cells if c["cell_type"] == "markdown")
        said = set(kinds.findall(text))
        assert said <= set(kinds.findall(given.get(path.stem, ""))), path.stem
        named += len(said)
    assert named >= 5
    held, not_held = (verdicts["verdict"].str.startswith(k).sum() for k in ("rep", "not rep"))
    many = verdicts["verdict"].str.startswith("reproduced if").sum()
    assert held > not_held and many > held / 3  # as the title of the index says


def test_coverage_has_every_figure_and_table():
    """Published: each figure and table is listed once, in the papers' numbering."""
    for paper, (figures, tables) in ITEMS.items():
        expected = [*(f"Fig {k}" for k in range(1, figures + 1)), *tables]
        assert sorted(COVERAGE["item"][COVERAGE["paper"] == paper]) == sorted(expected)


def test_coverage_has_figures_or_a_reason():
    """Property: a row names figures that are there, of its notebook, or says why not.

    It waits for no notebook that is there.
    """
    for row in COVERAGE.to_dict("records"):
        assert bool(row["figures"]) != bool(row["reason"]), row
        number = row["notebook"].split("-")[0]
        for figure in filter(None, row["figures"].split(";")):
            assert re.fullmatch(rf"{number}(-[a-z0-9]+)+", figure), row
            assert (ROOT / "figures" / f"{figure}.pdf").exists(), row
        there = (ROOT / "notebooks" / f"{row['notebook']}.ipynb").exists()
        assert not (there and row["reason"] == "not yet run"), row


def test_errata_say_their_kind():
    """Property: an erratum says whether it is a misprint, an inconsistency or unclear, and why."""
    assert ERRATA["should_be"].str.match(r"(misprint|inconsistency|unclear): \S").all()
    assert (ERRATA[["where", "printed", "evidence"]] != "").all(axis=None)
    assert ERRATA["notebook"].str.fullmatch(r"\d\d(-[a-z]+)+").all()


def test_symbols_are_names_of_the_package():
    """Property: each symbol has one row, and its name stands in the code as the table has it."""
    symbols = text_table("symbols.csv")
    assert list(symbols.columns) == ["symbol", "name", "meaning", "unit"]
    assert symbols["symbol"].is_unique and symbols["name"].is_unique
    code = " ".join(p.read_text("utf-8") for p in (ROOT / "analysis").rglob("*.py"))
    names = {"–", *re.findall(r"\w+", code)}  # a dash where the code has none
    assert [n for n in ", ".join(symbols["name"]).split(", ") if n not in names] == []


def named(stem):
    """Give the claims' stem of a row from what the row has under the names in it."""
    return lambda row: stem.format_map(row).split()[0].lower().replace("_", "")


def of_sensor(row):
    """Give the end of the claims' stem of a sensor of Table 2 or 3 of the terrain paper."""
    words = row["sensor"].lower().split()
    return "".join(words[-2 if "landmark" in words else -1 :])


def of_module(row):
    """Give the claims' stem of a row of Table I of the tracker paper."""
    usual = f"{row['module'].removesuffix(' KF')} {row['portion']}".lower().replace(" ", "-")
    return f"tracker-table1-{PORTIONS.get(row['portion'], usual)}"


PORTIONS = {
    "Memory access": "load-position", "Mean of buffer (worst case)": "static-filter-mean",
    "Mean of buffer": "yaw-alignment-mean", "Other processing": "yaw-alignment-other",
    "Rotation matrix conversion": "yaw-alignment-rotation"}  # fmt: skip
ENDS = {"arw_deg_sqrt_s": "-n", "b_deg_s": "-b"}
OF_FIT = {"sigma_v_deg": "-sigma-v", "corr_time_s": "-tau", "sigma_b_deg": "-sigma-b",
          "drift_deg_h": "-drift"}  # fmt: skip
OF_TABLE_1 = {"input": "-input", "recovered": "-recovered"}
# Table -> its rows, the stem of a row's claims, and the end of the claim of each column.
COPIED = {
    "comparison-table-1": (7, named("comparison-{sensor}-{channel}"), OF_FIT),
    "comparison-cep": (3, named("comparison-cep-{receiver}"), {"cep_m": "", "spec_m": "-spec"}),
    "terrain-table-1": (3, named("terrain-table1-{parameter}"), OF_TABLE_1),
    "terrain-table-2": (2, lambda row: f"terrain-table2-{of_sensor(row)}", ENDS),
    "terrain-table-3": (4, lambda row: f"terrain-table3-{of_sensor(row)}", ENDS),
    "tracker-table-1": (20, of_module, {"flops": "-flops", "sums": "-sum", "products": "-mul"}),
}


@pytest.mark.parametrize("name", COPIED)
def test_a_copied_table_holds_the_numbers_of_its_claims(name):
    """Published: each number of a table of the papers is that of one claim, in its unit."""
    rows, stem, ends = COPIED[name]
    table = number_table(f"{name}.csv")
    assert len(table) == rows
    for row in table.to_dict("records"):
        for column, end in ends.items():
            if row[column] == row[column]:
                assert row[column] == claimed(stem(row) + end)
                assert row.get("unit") in (None, CLAIMS.loc[stem(row) + end, "unit"])


def test_totals_of_operations_are_sums():
    """Published: in Table I of the tracker paper each filter's total is the sum of its portions."""
    table, counts = number_table("tracker-table-1.csv"), ["flops", "sums", "products"]
    assert table["module"].str.endswith("KF").sum() == 14
    for module in table["module"][table["portion"] == "Total"]:
        of = table[table["module"] == module]
        total = of["portion"] == "Total"
        assert of[total][counts].sum().equals(of[~total][counts].sum())


def test_the_text_prints_table_one_rounded():
    """Published: 20 of the 21 numbers in the text are Table I's, one is an erratum."""
    keys, columns = ["sensor", "channel"], ["sigma_v_deg", "corr_time_s", "sigma_b_deg"]
    words = pd.read_csv(PUBLISHED / "comparison-text-values.csv", comment="#", dtype=str)
    table = number_table("comparison-table-1.csv").set_index(keys)
    differ = []
    for where, row in words.set_index(keys).iterrows():
        for column in columns:
            half = 0.5 * 10.0 ** -len(row[column].partition(".")[2]) * (1 + 1e-9)
            printed, value = float(row[column]), table.loc[where, column]
            if printed != value and not abs(printed - value) <= half:
                differ.append((*where, column))
    assert differ == [("MIDG", "pitch", "sigma_b_deg")]


def test_print_agrees_with_print():
    """Published: the comparisons of printed numbers that hold by construction do hold."""
    table = number_table("comparison-table-1.csv")
    channel = table["sensor"].str.lower() + "-" + table["channel"]
    spread = dict(zip(channel, np.hypot(table["sigma_v_deg"], table["sigma_b_deg"]), strict=True))
    for name in ("midg-roll", "midg-pitch", "midg-yaw", "tokimec-roll", "tokimec-pitch"):
        for claim in ("std", "within-spec"):
            row = CLAIMS.loc[f"comparison-histogram-{name}-{claim}"]
            assert float(row["low"]) <= spread[name] <= float(row["high"]), row["id"]
    assert spread["tokimec-yaw"] > claimed("comparison-tokimec-yaw-fails-spec")
    for axis in ("roll", "pitch", "yaw"):
        assert spread[f"midg-{axis}"] < spread[f"tokimec-{axis}"]
    cep = number_table("comparison-cep.csv").set_index("receiver")
    assert (cep["cep_m"] < cep["spec_m"]).all() and cep["cep_m"].rank().equals(cep["spec_m"].rank())
    assert cep["cep_m"]["MIDG"] < cep["cep_m"]["Tokimec"]
    spec = number_table("comparison-specifications.csv").set_index("sensor")
    assert (spec.loc["MIDG"] <= spec.loc["Tokimec"]).drop("price_usd").all()
