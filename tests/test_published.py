"""Published: the numbers copied from the papers are complete, consistent and well formed."""

import math
import re

import numpy as np
import pandas as pd
import pytest

from analysis import DATA, ROOT

PUBLISHED = DATA / "published"
PAPERS = {"terrain", "comparison", "tracker"}
UNITS = {
    *(
        "1",
        "%",
        "deg",
        "deg/s",
        "deg/h",
        "deg/sqrt(s)",
        "s",
        "min",
        "h",
        "Hz",
        "m",
        "m/s^2",
        "km/h",
    ),
    *("W", "m^2*USD^0.586"),
    # Of numbers without one: a ratio, a fraction of one (shown in %), a count, a sentence.
    *("times", "share", "count", "yes or no"),
}
# Every figure and table of the papers, counted by hand.
ITEMS = {
    "terrain": (13, ["Table 1", "Table 2", "Table 3"]),
    "comparison": (38, ["Table I"]),
    "tracker": (6, ["Table I"]),
}


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


@pytest.mark.parametrize(
    ("table", "header"),
    [
        (CLAIMS, "id,paper,where,claim,quantity,value,unit,low,high,why,notebook"),
        (COVERAGE, "paper,item,notebook,figures,reason"),
        (ERRATA, "id,paper,where,printed,should_be,evidence,notebook"),
    ],
    ids=["claims", "coverage", "errata"],
)
def test_header_and_papers(table, header):
    """Property: the columns are those of the contract and every paper has rows."""
    assert ",".join(table.columns) == header
    assert set(table["paper"]) == PAPERS


@pytest.mark.parametrize("table", [CLAIMS, ERRATA], ids=["claims", "errata"])
def test_ids(table):
    """Property: ids are unique, kebab-case and begin with their paper."""
    ids = list(table["id"])
    assert len(set(ids)) == len(ids)
    for name, paper in zip(ids, table["paper"], strict=True):
        assert re.fullmatch(rf"{paper}(-[a-z0-9]+)+", name), name


def claim_faults(row):
    """List, in a sentence each, what is wrong with a row of claims.csv."""
    value, low = float(row["value"]), float(row["low"] or "-inf")
    high = float(row["high"] or "inf")
    untestable = row["why"].startswith("not testable: ")
    needs = r"needs the paper's own logs|the maker's data sheet is not at hand|no real log here has"
    yes = (row["value"], row["low"], row["high"], row["unit"]) == ("1", "1", "1", "yes or no")
    rules = {
        "where, claim, quantity, value, unit and why are filled in, without blanks around": all(
            row[c].strip() == row[c] != ""
            for c in ("where", "claim", "quantity", "value", "unit", "why")
        ),
        f"the unit is one of {', '.join(sorted(UNITS))}": row["unit"] in UNITS,
        "the published value lies between low and high": low <= value <= high,
        "low or high is given: else any number would agree": (
            untestable or math.isfinite(low) or math.isfinite(high)
        ),
        "a quantity '1 if ...' has value, low and high 1 and the unit 'yes or no'": (
            row["quantity"].startswith("1 if ") == (row["unit"] == "yes or no") == yes
        ),
        "what is 'not testable: ' says what it needs": (
            bool(re.search(needs, row["why"])) == untestable
        ),
    }
    return [rule for rule, kept in rules.items() if not kept]


@pytest.mark.parametrize("row", CLAIMS.to_dict("records"), ids=lambda row: row["id"])
def test_claim(row):
    """Property: a claim says what, where, how much and why, and its value lies in its range."""
    assert claim_faults(row) == []


def test_what_is_by_construction_says_of_which_kind():
    """Property: one of three kinds, and then the inputs, the identity or the two numbers."""
    apart = CLAIMS["why"][CLAIMS["why"].str.startswith("by construction")]
    kinds = r"by construction: (input handed back|identity|print against print): \S"
    assert apart.str.match(kinds).all()


def test_verdicts_come_from_the_notebook_of_the_register():
    """Property: where the register names a claim's notebook, its verdict is from there."""
    verdicts = pd.read_csv(ROOT / "figures" / "claims.csv").set_index("id")["notebook"]
    named = CLAIMS["notebook"][CLAIMS["notebook"] != ""]
    both = named.index.intersection(verdicts.index)
    assert len(both) > 200
    assert named[both].to_dict() == verdicts[both].to_dict()


def test_what_is_judged_could_have_failed():
    """Property: a claim that notebooks 10 to 14 judge says what would have made it fail."""
    verdicts = pd.read_csv(ROOT / "figures" / "claims.csv")
    mine = verdicts["id"][verdicts["notebook"].str.match("1[0-4]-")]
    why = CLAIMS["why"][CLAIMS.index.isin(mine)]
    why = why[~why.str.startswith(("by construction: ", "not testable: "))]
    assert len(why) > 40
    assert why.index[~why.str.contains("; fails if ")].tolist() == []


@pytest.mark.parametrize("table", [CLAIMS, COVERAGE, ERRATA], ids=["claims", "coverage", "errata"])
def test_cells_are_plain(table):
    """Property: one line a cell, ASCII only, so that every tool reads the registers alike."""
    for cell in table.to_numpy().ravel():
        assert cell.isascii(), cell
        assert "\n" not in cell, cell


def test_coverage_has_every_figure_and_table():
    """Published: each figure and table is listed once, in the papers' numbering."""
    expected = {
        (paper, item)
        for paper, (figures, tables) in ITEMS.items()
        for item in [*(f"Fig {k}" for k in range(1, figures + 1)), *tables]
    }
    listed = list(zip(COVERAGE["paper"], COVERAGE["item"], strict=True))
    assert len(listed) == len(set(listed))
    assert set(listed) == expected


def test_coverage_has_figures_or_a_reason():
    """Property: a row names our figures or says why not, and a figure comes from its notebook."""
    for row in COVERAGE.to_dict("records"):
        assert bool(row["figures"]) != bool(row["reason"]), row
        number = row["notebook"].split("-")[0]
        for figure in filter(None, row["figures"].split(";")):
            assert re.fullmatch(rf"{number}(-[a-z0-9]+)+", figure), row


def test_errata_say_their_kind():
    """Property: an erratum says whether it is a misprint, an inconsistency or unclear, and why."""
    for row in ERRATA.to_dict("records"):
        assert re.match(r"(misprint|inconsistency|unclear): \S", row["should_be"]), row["id"]
        for column in ("where", "printed", "evidence"):
            assert row[column], row["id"]
        assert re.fullmatch(r"\d\d(-[a-z]+)+", row["notebook"]), row["id"]


def test_symbols_are_names_of_the_package():
    """Property: each symbol has one row, and its name stands in the code as the table has it."""
    symbols = text_table("symbols.csv")
    assert list(symbols.columns) == ["symbol", "name", "meaning", "unit"]
    assert symbols["symbol"].is_unique and symbols["name"].is_unique
    code = " ".join(p.read_text("utf-8") for p in (ROOT / "analysis").rglob("*.py"))
    names = set(re.findall(r"\w+", code))
    assert [n for n in ", ".join(symbols["name"]).split(", ") if n not in names] == []


def test_unified_models_are_claims():
    """Published: Table I of the comparison paper holds the numbers of its 21 claims."""
    table = number_table("comparison-table-1.csv")
    assert len(table) == 7
    for row in table.itertuples():
        stem = f"comparison-{row.sensor.lower()}-{row.channel}"
        assert row.sigma_v_deg == claimed(f"{stem}-sigma-v")
        assert row.corr_time_s == claimed(f"{stem}-tau")
        assert row.sigma_b_deg == claimed(f"{stem}-sigma-b")
        if not math.isnan(row.drift_deg_h):
            assert row.drift_deg_h == claimed(f"{stem}-drift")
    pitch = (table["sensor"] == "MIDG") & (table["channel"] == "pitch")
    assert (table["corr_time_s"].map(math.isinf) == pitch).all()
    assert table["drift_deg_h"].count() == 2


def test_ceps_are_claims():
    """Published: the CEPs and specifications are those of the claims."""
    table = number_table("comparison-cep.csv")
    assert list(table["receiver"]) == ["Trimble Ag122", "MIDG", "Tokimec"]
    for row in table.itertuples():
        stem = f"comparison-cep-{row.receiver.split()[0].lower()}"
        assert row.cep_m == claimed(stem)
        assert row.spec_m == claimed(f"{stem}-spec")


def test_recovered_parameters_are_claims():
    """Published: Table 1 of the terrain paper holds the numbers of its six claims."""
    table = number_table("terrain-table-1.csv")
    for row, name in zip(table.itertuples(), ("n", "b", "tc"), strict=True):
        assert row.input == claimed(f"terrain-table1-{name}-input")
        assert row.recovered == claimed(f"terrain-table1-{name}-recovered")
        assert row.unit == CLAIMS.loc[f"terrain-table1-{name}-input", "unit"]


@pytest.mark.parametrize(("number", "sensors"), [(2, 2), (3, 4)])
def test_sensor_tables_are_claims(number, sensors):
    """Published: Tables 2 and 3 of the terrain paper hold the numbers of their claims."""
    table = number_table(f"terrain-table-{number}.csv")
    assert len(table) == sensors
    for row in table.itertuples():
        short = "".join(
            row.sensor.lower().split()[-2:]
            if "Landmark" in row.sensor
            else row.sensor.lower().split()[-1:]
        )
        assert row.arw_deg_sqrt_s == claimed(f"terrain-table{number}-{short}-n")
        assert row.b_deg_s == claimed(f"terrain-table{number}-{short}-b")


def test_operation_counts_are_claims_and_add_up():
    """Published: Table I of the tracker paper holds its claims' numbers; each total is a sum."""
    table = number_table("tracker-table-1.csv")
    filters = table[table["module"].str.endswith("KF")]
    assert len(filters) == 14
    counts = ["flops", "sums", "products"]
    for row in filters.to_dict("records"):
        module = row["module"].removesuffix(" KF").lower().replace(" ", "-")
        stem = f"tracker-table1-{module}-{row['portion'].lower().replace(' ', '-')}"
        for column, suffix in zip(counts, ("flops", "sum", "mul"), strict=True):
            assert row[column] == claimed(f"{stem}-{suffix}")
    for _, part in table.groupby("module"):
        total = part[part["portion"] == "Total"]
        if len(total):
            parts = part[part["portion"] != "Total"]
            for column in counts:
                assert parts[column].sum() == total[column].fillna(0).item()
    rest = {
        ("Load position", "Memory access"): "load-position",
        ("Static Filter", "Mean of buffer (worst case)"): "static-filter-mean",
        ("Yaw alignment", "Mean of buffer"): "yaw-alignment-mean",
        ("Yaw alignment", "Other processing"): "yaw-alignment-other",
        ("Yaw alignment", "Rotation matrix conversion"): "yaw-alignment-rotation",
        ("Yaw alignment", "Total"): "yaw-alignment-total",
    }
    others = table.drop(filters.index)
    assert set(zip(others["module"], others["portion"], strict=True)) == set(rest)
    for row in others.itertuples():
        name = rest[row.module, row.portion]
        assert row.flops == claimed(f"tracker-table1-{name}-flops")


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
    assert (cep["cep_m"] < cep["spec_m"]).all()
    assert cep["cep_m"].rank().equals(cep["spec_m"].rank())
    assert cep["cep_m"]["MIDG"] < cep["cep_m"]["Tokimec"]
    spec = (
        number_table("comparison-specifications.csv").set_index("sensor").drop(columns="price_usd")
    )
    assert (spec.loc["MIDG"] <= spec.loc["Tokimec"]).all()
